"""The columns of a recording of the frequency response."""

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
    not_negative,
    positive,
    sign,
    slip_between,
    whole_number,
)
from rigctl.core.arrays import FloatArray

SAMPLES_MIN = 16
STAGE, ACCEL = "stage_x_mm", "accel_v"
LASER_PREFIX, LASER_SUFFIX = "laser_", "_mm"


def is_head(name: str) -> bool:
    """Whether a column is a laser head's reading."""
    return name.startswith(LASER_PREFIX) and name.endswith(LASER_SUFFIX)


def _units(run: Mapping[str, Any], columns: Columns, _: Mapping[str, float]) -> UnitFindings:
    """The stage's amplitude as it was asked for, each head's as the stage's: one in um would be a wrong result."""
    asked, stage = float(run.get("amplitude_mm", math.nan)), _swing(columns[STAGE])
    if slip := slip_between(stage, asked):
        said = f"{STAGE} swings by {stage:.4g}, amplitude_mm is {asked:g}"
        return UnitFindings(f"{said}: one of them is off by {slip:g}; write both in mm")
    for name in filter(is_head, columns):
        if slip := slip_between(swing := _swing(columns[name]), stage):
            said = f"{name} swings by {swing:.4g}, {STAGE} by {stage:.4g}"
            return UnitFindings(f"{said}: one of them is off by {slip:g}; write both in mm")
    return UnitFindings()


def _swing(column: FloatArray) -> float:
    """Half of peak to peak; a jump is no swing."""
    known = column[np.isfinite(column)]
    if known.size < SAMPLES_MIN:
        return math.nan
    low, high = np.percentile(known, [1.0, 99.0])
    return 0.5 * float(high - low)


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
    own_clocks=True,
)
"""`direction` +1: the sensing axis along the stage's positive travel; -1: against it."""
