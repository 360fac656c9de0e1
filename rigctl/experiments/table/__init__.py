"""Anybody's calibration: a table of readings, and an expression for what is believed of them."""

from rigctl.core.experiments import Experiment

EXPERIMENT = Experiment(
    id="table",
    analysis="rigctl.experiments.table.analysis",
    report="rigctl.report.experiments.table",
    points=("response",),
    question="rigctl.experiments.table.study:require_fit",
    trial_run="rigctl.experiments.table.trial_run:trial_run",
    rank=4,
)
