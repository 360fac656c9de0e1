"""The multipoint tumble test of accelerometers on a dividing head (IEEE Std 1293), an experiment for rigctl."""

from rigctl.core.additions import Effects
from rigctl.core.experiments import Experiment

EXPERIMENT = Experiment(
    id="tumble-test",
    campaign="tumble_test.procedure",
    analysis="tumble_test.study",
    report="tumble_test.report",
    tables={"procedure": "tumble_test.procedure:Procedure"},
    columns="tumble_test.observables:COLUMNS",
    # The head's angle error, the rise of its turning axis, what a sensor indicates (E / K1), what it puts out.
    points=("tumble_angle_rad", "tumble_elevation_rad", "tumble_indicated_m_s2", "tumble_output_v"),
    scopes=("recording", "channel"),
    trial_run="tumble_test.positions:trial_run",
)

EFFECTS = Effects("tumble-test", experiment="tumble-test", module="tumble_test.effects")
