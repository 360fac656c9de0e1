"""The temperature of the bench."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simulators.worlds.bench_settings import TemperatureSettings

FloatArray = NDArray[np.float64]

_DAY_S = 86400.0


def temperature_c(settings: TemperatureSettings, times_s: FloatArray) -> FloatArray:
    """Degrees Celsius at rig times: a mean, the sun's daily sine, a drift."""
    days = times_s / _DAY_S
    return settings.mean_c + settings.daily_k * np.sin(2.0 * math.pi * days) + settings.drift_k_per_day * days
