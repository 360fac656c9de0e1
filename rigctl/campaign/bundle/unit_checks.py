"""Whether samples are in the unit that their column's name says: what was asked for against what is seen.

A factor of a thousand between the two is a slip of the unit, not a property of the bench.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray

Columns = Mapping[str, FloatArray]

SLIPS = (1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9)
SLIP_WITHIN = 1.4
"""How far an amplitude may be from a thousand times another to be taken for the same one."""

ALIKE_WITHIN = 1.5
"""What is asked and what is seen may differ by this factor without a word: peak to peak for amplitude is 2."""

SAMPLES_MIN = 16
SAMPLES_LOOKED_AT = 1_000_000
TURNS_PER_PERIOD_MIN = 0.1
PERIODS_MIN = 20.0

_AMPLITUDE_IN = {1e3: "um", 1e-3: "m", 1e6: "nm", 1e-6: "km", 1e9: "pm", 1e-9: "Mm"}
_TIME_IN = {1e3: "ms", 1e6: "us", 1e9: "ns", 1e-3: "ks", 1e-6: "Ms", 1e-9: "Gs"}


@dataclass(frozen=True)
class UnitFindings:
    """`slip`: a column that is not in its unit, and the mend; `remarks`: what differs otherwise."""

    slip: str | None = None
    remarks: tuple[str, ...] = ()


def slip_between(seen: float, asked: float) -> float | None:
    """The power of a thousand that lies between two quantities, None when there is none."""
    if not (seen > 0 and asked > 0):
        return None
    return next((slip for slip in SLIPS if 1 / SLIP_WITHIN < seen / asked / slip < SLIP_WITHIN), None)


def sensing_axis(run: Mapping[str, Any], columns: Columns, _: Mapping[str, float]) -> UnitFindings:
    """The stage's amplitude and frequency, seen in its own column."""
    t_s, stage = columns["t_s"][:SAMPLES_LOOKED_AT], columns["stage_x_mm"][:SAMPLES_LOOKED_AT]
    known = np.isfinite(stage)
    if known.sum() < SAMPLES_MIN:
        return UnitFindings()
    low, high = np.percentile(stage[known], [1.0, 99.0])
    swing = 0.5 * float(high - low)
    amplitude = float(run.get("amplitude_mm", math.nan))
    if slip := slip_between(swing, amplitude):
        return UnitFindings(
            f"stage_x_mm swings by {swing:.4g}, amplitude_mm is {amplitude:g}: one of them looks like"
            f" {_AMPLITUDE_IN[slip]}; write both in mm"
        )
    seen_hz = _frequency(t_s[known], stage[known] - 0.5 * float(low + high), 0.5 * swing)
    asked_hz = float(run["frequency_hz"])
    if slip := slip_between(asked_hz, seen_hz):
        return UnitFindings(_time_slip(f"the stage moves at {seen_hz:.4g} Hz", f"frequency_hz is {asked_hz:g}", slip))
    pairs = (("amplitude_mm", amplitude, swing), ("frequency_hz", asked_hz, seen_hz))
    return UnitFindings(None, tuple(_differs(*pair) for pair in pairs if not _alike(*pair[1:])))


def rotating_platform(run: Mapping[str, Any], columns: Columns, _: Mapping[str, float]) -> UnitFindings:
    """The sampling rate, and how often the platform turns in a period of its pattern."""
    step_s = _step(columns["t_s"])
    rate_hz = float(run.get("sample_rate_hz", math.nan))
    if slip := slip_between(step_s, 1 / rate_hz if rate_hz else math.nan):
        return UnitFindings(_time_slip(f"samples are {step_s:.4g} apart", f"sample_rate_hz is {rate_hz:g}", slip))
    period_s, t_s = float(run.get("modulation_period_s", math.nan)), columns["t_s"]
    if not period_s > 0 or "theta_deg" not in columns:
        return UnitFindings()
    angle = columns["theta_deg"]
    known = np.isfinite(angle)
    periods = float(t_s[-1] - t_s[0]) / period_s
    turns = np.count_nonzero(np.diff(np.sign(np.cos(np.radians(angle[known])))))
    if periods > PERIODS_MIN and 0 < turns < TURNS_PER_PERIOD_MIN * periods:
        return UnitFindings(
            f"the platform turns {turns} times in {periods:.4g} periods of {period_s:g} s: t_s or modulation_period_s"
            " looks like another unit; write both in seconds"
        )
    return UnitFindings()


def inflight(run: Mapping[str, Any], columns: Columns, constants: Mapping[str, float]) -> UnitFindings:
    """The sampling period, and how long the session lasts in orbits."""
    step_s = _step(columns["t_s"])
    period_s = float(run.get("sample_period_s", math.nan))
    if slip := slip_between(step_s, period_s):
        return UnitFindings(_time_slip(f"samples are {step_s:.4g} apart", f"sample_period_s is {period_s:g}", slip))
    asked_s = float(run.get("orbits", math.nan)) * constants.get("orbit_period_s", math.nan)
    lasts_s = float(columns["t_s"][-1] - columns["t_s"][0]) + step_s
    if slip := slip_between(lasts_s, asked_s):
        return UnitFindings(_time_slip(f"it lasts {lasts_s:.4g}", f"its orbits take {asked_s:.4g} s", slip))
    return UnitFindings()


def _step(t_s: FloatArray) -> float:
    return float(np.median(np.diff(t_s))) if t_s.size > 1 else math.nan


def _frequency(t_s: FloatArray, swing: FloatArray, threshold: float) -> float:
    """From the times at which it passes from one side to the other; NaN when it passes less than three times."""
    far = np.abs(swing) > threshold
    side, at_s = np.sign(swing[far]), t_s[far]
    passes_s = at_s[1:][np.diff(side) != 0]
    return 0.5 * (passes_s.size - 1) / float(passes_s[-1] - passes_s[0]) if passes_s.size > 2 else math.nan


def _time_slip(seen: str, asked: str, slip: float) -> str:
    return f"{seen}, {asked}: t_s looks like {_TIME_IN[slip]}; write it in seconds"


def _alike(asked: float, seen: float) -> bool:
    return not (asked > 0 and seen > 0) or 1 / ALIKE_WITHIN < seen / asked < ALIKE_WITHIN


def _differs(name: str, asked: float, seen: float) -> str:
    return f"{name} is {asked:.4g}, the stage shows {seen:.4g}"
