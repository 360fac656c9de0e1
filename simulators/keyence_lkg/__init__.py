"""Simulated Keyence LK-G controllers: the LK-G3001 and the LK-G5000 with their heads."""

from simulators.keyence_lkg.dialect import Lkg3001Dialect
from simulators.keyence_lkg.lkg3001 import Lkg3001Settings, SimulatedLkg3001
from simulators.keyence_lkg.lkg5000 import Lkg5000Settings, SimulatedLkg5000

__all__ = ["Lkg3001Dialect", "Lkg3001Settings", "Lkg5000Settings", "SimulatedLkg3001", "SimulatedLkg5000"]
