"""In-flight calibration of a drag-free differential accelerometer: sessions, estimates, model, result."""

from rigctl.core.additions import Effects
from rigctl.core.experiments import Experiment

EXPERIMENT = Experiment(
    id="inflight-calibration",
    campaign="procedures.inflight.campaign",
    analysis="rigctl.experiments.inflight.analysis",
    report="rigctl.report.experiments.inflight",
    tables={"procedure": "procedures.inflight.tables:Calibration"},
    columns="rigctl.experiments.inflight.columns:COLUMNS",
    points=("gradient_1_s2", "off_centring_m", "mass_force_m_s2", "measured_m_s2"),
    trial_run="rigctl.experiments.inflight.model.flight:trial_run",
    rank=3,
)

EFFECTS = Effects("inflight-calibration", "inflight-calibration", "rigctl.experiments.inflight.effects")
