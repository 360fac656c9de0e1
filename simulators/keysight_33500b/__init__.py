"""A Keysight 33500B waveform generator with two outputs, in its own bytes."""

from simulators.keysight_33500b.instrument import Simulated33500B
from simulators.keysight_33500b.settings import GeneratorSettings

__all__ = ["GeneratorSettings", "Simulated33500B"]
