"""Telling acceleration from an accelerometer's own bias by half turns back and forth (Lenoir et al. 2013)."""

from rigctl.core.additions import Effects
from rigctl.core.experiments import Experiment

EXPERIMENT = Experiment(
    id="rotating-platform",
    campaign="procedures.rotating_platform.campaign",
    analysis="rigctl.experiments.rotating_platform.analysis",
    report="rigctl.report.experiments.rotating_platform",
    tables={"procedure": "procedures.rotating_platform.tables:Procedure"},
    columns="rigctl.experiments.rotating_platform.columns:COLUMNS",
    # force_m_s2 acts along a sensing axis, reading_m_s2 is the calibrated reading, bias included.
    points=("platform_angle_rad", "force_m_s2", "reading_m_s2"),
    scopes=("recording", "channel"),
    trial_run="rigctl.experiments.rotating_platform.trial_run:trial_run",
    signature="rigctl.report.figures.rotating_platform.signature:signature_plate",
    rank=2,
)

EFFECTS = Effects("rotating-platform", "rotating-platform", "rigctl.experiments.rotating_platform.effects")
