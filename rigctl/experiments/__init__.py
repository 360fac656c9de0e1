"""One package each: its declaration, effects, observables, model and result; `EXPERIMENTS` has them all."""

from rigctl.core.experiments import EXPERIMENTS, Experiment

__all__ = ["EXPERIMENTS", "Experiment"]
