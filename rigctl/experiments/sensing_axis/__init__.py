"""Finding an accelerometer's sensing axes by the two-phase null search (Lucente et al. 2022)."""

from rigctl.core.additions import Effects
from rigctl.core.experiments import Experiment

EXPERIMENT = Experiment(
    id="sensing-axis",
    campaign="procedures.sensing_axis.campaign",
    analysis="rigctl.experiments.sensing_axis.analysis",
    report="rigctl.report.experiments.sensing_axis",
    tables={
        "procedure": "procedures.sensing_axis.tables:Procedure",
        "targets": "procedures.sensing_axis.tables:Targets",
    },
    columns="rigctl.experiments.sensing_axis.columns:COLUMNS",
    # motion_m and angle_rad are those of sensor and cube alike, null_rad is theta0, which only the sensor has;
    # specific_force_m_s2 is what varies along the sensing axis, laser_m what one head reads of the motion.
    points=("motion_m", "angle_rad", "null_rad", "specific_force_m_s2", "sensor_output_v", "laser_m"),
    scopes=("recording", "axis", "axis-configuration", "head"),
    trial_run="rigctl.experiments.sensing_axis.trial_run:trial_run",
    signature="rigctl.report.figures.sensing_axis.signature:signature_plate",
    rank=1,
)

EFFECTS = Effects("sensing-axis", "sensing-axis", "rigctl.experiments.sensing_axis.effects")
