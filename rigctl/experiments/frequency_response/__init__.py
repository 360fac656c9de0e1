"""Sensitivity, linearity and frequency response of an accelerometer on an oscillating stage, lasers as the reference.

The primary method is that of ISO 16063-11, method 3: sines are fitted to the sampled displacement and to the sampled
output, and the complex sensitivity is the quotient of output and acceleration.
"""

from rigctl.core.additions import Effects
from rigctl.core.experiments import Experiment

EXPERIMENT = Experiment(
    id="frequency-response",
    campaign="procedures.frequency_response.campaign",
    analysis="rigctl.experiments.frequency_response.analysis",
    report="rigctl.report.experiments.frequency_response",
    tables={"procedure": "procedures.frequency_response.tables:Procedure"},
    columns="rigctl.experiments.frequency_response.columns:COLUMNS",
    # What acts along the sensing axis, and what the sensor puts out.
    points=("shaken_force_m_s2", "shaken_output_v"),
    trial_run="rigctl.experiments.frequency_response.chain:trial_run",
    rank=5,
)

EFFECTS = Effects("frequency-response", "frequency-response", "rigctl.experiments.frequency_response.effects")
