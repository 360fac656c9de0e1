"""Where runs.csv and the constants state otherwise than the samples show: the samples count, and it is said."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rigctl.core.errors import ConfigError
from rigctl.experiments.rotating_platform.observe.cells import Cells
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, SampledPattern, named_pattern
from rigctl.experiments.rotating_platform.observe.stated_tilt import tilt_contradiction

# No scale factor is off by that much.
_OTHER_GAIN, _CERTAIN_SIGMA = 0.5, 5.0
# Rotations of other durations move the ends of dwells by less.
_OTHERWISE = 0.1


def contradictions(
    run_id: str, stated: Mapping[str, Any], cells: Cells, sampled: SampledPattern, command_v_per_m_s2: float
) -> list[str]:
    """Of the tilt at the input of axis Z and of the pattern, a line each."""
    duration_s = cells.periods * cells.samples / cells.sample_rate_hz
    tilt = tilt_contradiction(stated, cells.state[:, 0] * command_v_per_m_s2, duration_s)
    return [*([f"{run_id}: {tilt}"] if tilt else []), *_of_pattern(run_id, stated, sampled)]


def gain_contradictions(tilt_gain: float, sigma: float) -> list[str]:
    """Of the chains as they are believed to be, which make a gain of the commanded tilt of 1: a line, or none."""
    if abs(tilt_gain - 1.0) <= _OTHER_GAIN + _CERTAIN_SIGMA * sigma:
        return []
    what = "sign" if tilt_gain < 0.0 else "unit"
    return [
        f"the gain of the commanded tilt is {tilt_gain:.3g}, and 1 where both chains are as believed: "
        f"gain_q_a_v_per_m_s2, gain_dm1_z_v_per_m_s2, q_a_v or dm1_z_v has another {what}; mend the recording"
    ]


def _of_pattern(run_id: str, stated: Mapping[str, Any], sampled: SampledPattern) -> list[str]:
    name = str(stated["pattern"])
    shares = {each: _otherwise(each, stated, sampled) for each in ROTATIONS}
    # Where the table could not have been made as it is named, nothing is held against the name.
    if not shares.get(name, math.nan) > _OTHERWISE:
        return []
    alike = next((each for each, share in shares.items() if share <= _OTHERWISE), "custom")
    return [
        f"{run_id}: pattern is {name}, the platform rests at other times: that of theta_deg and moving counts; "
        f"correct runs.csv, it looks like {alike}"
    ]


def _otherwise(name: str, stated: Mapping[str, Any], sampled: SampledPattern) -> float:
    """The share of samples at rest by both tables that rest at the other stop; NaN where there is no such table."""
    try:
        pattern = named_pattern(name, sampled.pattern.period_s, stated.get("rotation_s"))
        sign = pattern.sampled(sampled.sample_rate_hz).sign
    except ConfigError:
        return math.nan
    both = (sign * sampled.sign)[(sign != 0) & (sampled.sign != 0)]
    # At which stop a table begins is anybody's choice.
    return min(float(np.mean(both < 0)), float(np.mean(both > 0))) if both.size else math.nan
