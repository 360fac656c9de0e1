"""In-flight calibration of a drag-free differential accelerometer: sessions, estimates, model, result."""

from rigctl.experiments.declaration import Experiment

EXPERIMENT = Experiment(
    id="inflight-calibration",
    application="rigctl.kinds.inflight",
    tables={"procedure": "procedures.inflight:Calibration"},
    procedures={"monte-carlo": "procedures.inflight:MonteCarlo"},
    columns="rigctl.campaign.bundle_layout:INFLIGHT",
    points=("gradient_1_s2", "off_centring_m", "mass_force_m_s2", "measured_m_s2"),
    effects="rigctl.effects.inflight",
    trial_run="rigctl.experiments.inflight.flight:trial_run",
    rank=3,
)
