"""An Aerotech Soloist with its one linear axis: the Ensemble's language, in which the axis is never named."""

from simulators.aerotech_soloist.dialect import GENTLE, SoloistDialect
from simulators.aerotech_soloist.instrument import SimulatedSoloist
from simulators.aerotech_soloist.settings import SoloistSimulatorSettings

__all__ = ["GENTLE", "SimulatedSoloist", "SoloistDialect", "SoloistSimulatorSettings"]
