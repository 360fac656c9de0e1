"""An Aerotech Ensemble with one linear axis, as its ASCII command interface shows it."""

from simulators.aerotech_ensemble.dialect import GENTLE, EnsembleDialect
from simulators.aerotech_ensemble.instrument import SimulatedEnsemble
from simulators.aerotech_ensemble.settings import EnsembleSimulatorSettings

__all__ = ["GENTLE", "EnsembleDialect", "EnsembleSimulatorSettings", "SimulatedEnsemble"]
