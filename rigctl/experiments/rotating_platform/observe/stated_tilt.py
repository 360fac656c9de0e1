"""Whether the tilt that runs.csv states is the one that was commanded: the samples count, and it is said."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray

# Of the level, or of an amplitude, which means round off.
_LEVEL, _AMPLITUDE = 0.05, 0.5
_LEAST_V = 0.02


def tilt_contradiction(stated: Mapping[str, Any], volts: FloatArray, duration_s: float) -> str | None:
    """`v_z_v` and `external` of a run against means of dm1_z_v over parts of it; None where they agree.

    An amplitude is told by a whole `external_period_s` at least.
    """
    level_v = float(stated.get("v_z_v", np.nan))
    if not (np.isfinite(level_v) and volts.size and np.isfinite(volts).all()):
        return None
    external = str(stated.get("external") or "constant")
    if external == "constant":
        found_v, share, word = float(volts[int(np.argmax(np.abs(volts - level_v)))]), _LEVEL, ""
    elif not duration_s >= float(stated.get("external_period_s", np.nan)):
        return None
    else:
        found_v, share, word = 0.5 * float(np.ptp(volts)), _AMPLITUDE, "an amplitude of "
    if abs(found_v - level_v) <= max(share * abs(level_v), _LEAST_V):
        return None
    return (
        f"v_z_v is {level_v:g} V ({external}), dm1_z_v has {word}{found_v:.3g} V: dm1_z_v counts; correct "
        "runs.csv, or mark the run invalid if dm1_z_v is wrong"
    )
