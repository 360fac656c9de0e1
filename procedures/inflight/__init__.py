"""Campaigns in orbit."""

from rigctl.core.additions import Procedure

MONTE_CARLO = Procedure(
    "inflight-calibration",
    "monte-carlo",
    table="procedures.inflight.tables:MonteCarlo",
    plan="procedures.inflight.monte_carlo:plan",
)
