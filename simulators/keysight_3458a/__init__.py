"""A Keysight 3458A multimeter as its own language shows it."""

from simulators.keysight_3458a.dialect import GENTLE, Meter3458ADialect
from simulators.keysight_3458a.instrument import Simulated3458A
from simulators.keysight_3458a.settings import Meter3458ASimulatorSettings

__all__ = ["GENTLE", "Meter3458ADialect", "Meter3458ASimulatorSettings", "Simulated3458A"]
