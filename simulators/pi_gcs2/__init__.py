"""A PI controller with one rotary axis, as GCS 2.0 shows it."""

from simulators.pi_gcs2.controller import SimulatedGcs2
from simulators.pi_gcs2.settings import Gcs2Dialect, Gcs2SimulatorSettings

__all__ = ["Gcs2Dialect", "Gcs2SimulatorSettings", "SimulatedGcs2"]
