"""The columns of a sensing-axis recording, and whether a run's samples are in their units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rigctl.campaign.layout import (
    COMMON_FIELDS,
    Columns,
    Field,
    Layout,
    UnitFindings,
    angle_deg,
    not_negative,
    one_of,
    positive,
    sign,
    slip_between,
    time_slip,
    whole_number,
)
from rigctl.core.arrays import FloatArray

ALIKE_WITHIN = 1.5
"""What is asked and what is seen may differ by this factor without a word: peak to peak for amplitude is 2."""

SAMPLES_MIN = 16
# Enough to know amplitude and frequency, whatever the length of a run.
SAMPLES_LOOKED_AT = 1_000_000

_AMPLITUDE_IN = {1e3: "um", 1e-3: "m", 1e6: "nm", 1e-6: "km", 1e9: "pm", 1e-9: "Mm"}


def _units(run: Mapping[str, Any], columns: Columns, _: Mapping[str, float]) -> UnitFindings:
    """The stage's amplitude and frequency, seen in its own column."""
    t_s, stage = columns["t_s"][:SAMPLES_LOOKED_AT], columns["stage_x_mm"][:SAMPLES_LOOKED_AT]
    known = np.isfinite(stage)
    if known.sum() < SAMPLES_MIN:
        return UnitFindings()
    # A jump of the encoder is no swing.
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
        return UnitFindings(time_slip(f"the stage moves at {seen_hz:.4g} Hz", f"frequency_hz is {asked_hz:g}", slip))
    pairs = (("amplitude_mm", amplitude, swing), ("frequency_hz", asked_hz, seen_hz))
    remarks = (f"{name} is {a:.4g}, the stage shows {b:.4g}" for name, a, b in pairs if not _alike(a, b))
    return UnitFindings(None, tuple(remarks))


def _frequency(t_s: FloatArray, swing: FloatArray, threshold: float) -> float:
    """From the times at which it passes from one side to the other; NaN when it passes less than three times."""
    # Near the middle, noise would pass from side to side many times.
    far = np.abs(swing) > threshold
    side, at_s = np.sign(swing[far]), t_s[far]
    passes_s = at_s[1:][np.diff(side) != 0]
    # Passes are half a period apart.
    return 0.5 * (passes_s.size - 1) / float(passes_s[-1] - passes_s[0]) if passes_s.size > 2 else math.nan


def _alike(asked: float, seen: float) -> bool:
    return not (asked > 0 and seen > 0) or 1 / ALIKE_WITHIN < seen / asked < ALIKE_WITHIN


COLUMNS = Layout(
    fields={
        "axis": Field(one_of("X", "Y", "Z"), required=True),
        "configuration": Field(one_of("pendulum", "flag"), required=True),
        "mounting": Field(whole_number, required=True),
        "theta_deg": Field(angle_deg, required=True),
        "approach": Field(sign),
        "frequency_hz": Field(positive, required=True),
        "amplitude_mm": Field(not_negative),
        **COMMON_FIELDS,
    },
    samples_of=lambda _: ("t_s", "stage_x_mm", "accel_v"),
    units_of=_units,
    period_of=lambda run: 1 / float(run["frequency_hz"]),
    own_clocks=True,
)
