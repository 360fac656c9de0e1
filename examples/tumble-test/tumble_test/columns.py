"""The columns of a recording: runs.csv, and a run's samples."""

from __future__ import annotations

from rigctl.campaign import layout
from rigctl.campaign.layout import Field, Layout
from rigctl.campaign.unit_checks import UnitFindings
from tumble_test.positions import OUTS

COLUMNS = Layout(
    fields={
        "mounting": Field(layout.whole_number, required=True),
        "out": Field(layout.one_of(*OUTS), required=True),
        "clocking_deg": Field(layout.angle_deg, required=True),
        "angle_deg": Field(layout.angle_deg, required=True),
        "approach": Field(layout.sign),
        "sweep": Field(layout.whole_number),
        **layout.COMMON_FIELDS,
    },
    samples_of=lambda _: ("t_s",),
    flaw_of_run=lambda _: None,
    period_of=lambda _: 0.0,
    units_of=lambda *_: UnitFindings(),
)
