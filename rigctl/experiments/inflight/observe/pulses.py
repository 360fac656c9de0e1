"""What short pulses cover of a run's samples."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray

BEFORE_S, AFTER_S = 3.0, 30.0
"""So long before and after its beginning a pulse covers samples."""


def covered(t_s: FloatArray, pulses_s: FloatArray) -> BoolArray:
    """Which samples are covered by pulses that begin at `pulses_s`."""
    hidden = np.zeros(len(t_s), dtype=bool)
    for begin_s in pulses_s:
        hidden |= (t_s > begin_s - BEFORE_S) & (t_s < begin_s + AFTER_S)
    return hidden


def without_pulses(samples: Mapping[str, FloatArray], pulses_s: FloatArray | None) -> Mapping[str, FloatArray]:
    """The samples with those that are covered missing; None for a run without pulses."""
    if pulses_s is None:
        return samples
    hidden = covered(samples["t_s"], pulses_s)
    return {name: column if name == "t_s" else np.where(hidden, np.nan, column) for name, column in samples.items()}
