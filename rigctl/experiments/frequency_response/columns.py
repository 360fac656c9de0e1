"""The columns of a recording of the frequency response."""

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
    not_negative,
    positive,
    sign,
    slip_between,
    time_slip,
    whole_number,
)

STAGE, ACCEL = "stage_x_mm", "accel_v"
LASER_PREFIX, LASER_SUFFIX = "laser_", "_mm"


def is_head(name: str) -> bool:
    """Whether a column is a laser head's reading."""
    return name.startswith(LASER_PREFIX) and name.endswith(LASER_SUFFIX)


def _units(run: Mapping[str, Any], columns: Columns, _: Mapping[str, float]) -> UnitFindings:
    """The stage's amplitude and frequency as they were asked for, each head's amplitude as the stage's."""
    asked, stage = float(run.get("amplitude_mm", math.nan)), swing_of(columns[STAGE])
    if slip := slip_between(stage, asked):
        said = f"{STAGE} swings by {stage:.4g}, amplitude_mm is {asked:g}"
        return UnitFindings(f"{said}: one of them is off by {slip:g}; write both in mm")
    asked_hz, seen_hz = float(run["frequency_hz"]), frequency_of(columns["t_s"], columns[STAGE])
    if slip := slip_between(asked_hz, seen_hz):
        return UnitFindings(time_slip(f"the stage moves at {seen_hz:.4g} Hz", f"frequency_hz is {asked_hz:g}", slip))
    for name in filter(is_head, columns):
        if slip := slip_between(swing := swing_of(columns[name]), stage):
            said = f"{name} swings by {swing:.4g}, {STAGE} by {stage:.4g}"
            return UnitFindings(f"{said}: one of them is off by {slip:g}; write both in mm")
    return UnitFindings()


def _period_s(run: Mapping[str, Any]) -> float:
    return 1.0 / float(run["frequency_hz"])


COLUMNS = Layout(
    fields={
        "mounting": Field(whole_number, required=True),
        "direction": Field(sign, required=True),
        "frequency_hz": Field(positive, required=True),
        "amplitude_mm": Field(not_negative),
        **COMMON_FIELDS,
    },
    samples_of=lambda _: ("t_s", STAGE, ACCEL),
    period_of=_period_s,
    units_of=_units,
    other_constants=("g_m_s2",),
    own_clocks=True,
)
"""`direction` +1: the sensing axis along the stage's positive travel; -1: against it."""
