"""The columns of a recording of the frequency response."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.campaign.layout import (
    COMMON_FIELDS,
    Field,
    Layout,
    not_negative,
    positive,
    sign,
    whole_number,
)

STAGE, ACCEL = "stage_x_mm", "accel_v"
LASER_PREFIX, LASER_SUFFIX = "laser_", "_mm"


def is_head(name: str) -> bool:
    """Whether a column is a laser head's reading."""
    return name.startswith(LASER_PREFIX) and name.endswith(LASER_SUFFIX)


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
    own_clocks=True,
)
"""`direction` +1: the sensing axis along the stage's positive travel; -1: against it."""
