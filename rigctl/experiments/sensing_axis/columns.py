"""The columns of a sensing-axis recording, and whether a run's samples are in their units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rigctl.campaign.driven import frequency_of, swing_of
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

ALIKE_WITHIN = 1.5
"""What is asked and what is seen may differ by this factor without a word: peak to peak for amplitude is 2."""

_AMPLITUDE_IN = {1e3: "um", 1e-3: "m", 1e6: "nm", 1e-6: "km", 1e9: "pm", 1e-9: "Mm"}


def _units(run: Mapping[str, Any], columns: Columns, _: Mapping[str, float]) -> UnitFindings:
    """The stage's amplitude and frequency, seen in its own column."""
    stage = columns["stage_x_mm"]
    swing, seen_hz = swing_of(stage), frequency_of(columns["t_s"], stage)
    amplitude = float(run.get("amplitude_mm", math.nan))
    if slip := slip_between(swing, amplitude):
        return UnitFindings(
            f"stage_x_mm swings by {swing:.4g}, amplitude_mm is {amplitude:g}: one of them looks like"
            f" {_AMPLITUDE_IN[slip]}; write both in mm"
        )
    asked_hz = float(run["frequency_hz"])
    if slip := slip_between(asked_hz, seen_hz):
        return UnitFindings(time_slip(f"the stage moves at {seen_hz:.4g} Hz", f"frequency_hz is {asked_hz:g}", slip))
    pairs = (("amplitude_mm", amplitude, swing), ("frequency_hz", asked_hz, seen_hz))
    remarks = (f"{name} is {a:.4g}, the stage shows {b:.4g}" for name, a, b in pairs if not _alike(a, b))
    return UnitFindings(None, tuple(remarks))


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
    other_constants=("g_m_s2", "gain_v_per_m_s2"),
    own_clocks=True,
)
