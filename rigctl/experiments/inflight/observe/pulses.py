"""What short pulses cover of a run's samples."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigctl.core.arrays import FloatArray

BEFORE_S, AFTER_S = 3.0, 30.0
"""So long before and after its beginning a pulse covers samples."""


def without_pulses(samples: Mapping[str, FloatArray], pulses_s: FloatArray | None) -> Mapping[str, FloatArray]:
    """The samples without those that pulses beginning at `pulses_s` cover; None for a run without pulses."""
    if pulses_s is None:
        return samples
    t_s = samples["t_s"]
    hidden = np.zeros(len(t_s), dtype=bool)
    for begin_s in pulses_s:
        hidden |= (t_s > begin_s - BEFORE_S) & (t_s < begin_s + AFTER_S)
    return {name: column if name == "t_s" else np.where(hidden, np.nan, column) for name, column in samples.items()}
