"""A simulated Keysight 34465A multimeter."""

from simulators.keysight_34465a.instrument import Simulated34465A
from simulators.keysight_34465a.settings import MeterSettings

__all__ = ["MeterSettings", "Simulated34465A"]
