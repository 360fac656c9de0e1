"""The temperature of the bench."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.worlds.bench_settings import TemperatureSettings

_DAY_S = 86400.0


class Room:
    """The room's temperature: its own course, and where somebody has brought it since.

    Brought to another temperature, the mean moves there in a straight line, and stays; the sun and the drift go on.
    """

    def __init__(self, settings: TemperatureSettings) -> None:
        self._settings = settings
        self._times_s = [0.0]
        self._offsets_k = [0.0]

    def bring_to(self, temperature_c: float, at_s: float) -> float:
        """Set out for a temperature [degC] at rig time `at_s`; returns when the bench has followed."""
        done_s = at_s + self._settings.room_s
        now_k = float(np.interp(at_s, self._times_s, self._offsets_k))
        wanted_k = temperature_c - float(_own_course_c(self._settings, np.array([done_s]))[0])
        # Sent elsewhere while under way, it never arrives where it was going.
        kept = sum(time_s < at_s for time_s in self._times_s)
        # Interpolation wants times that grow.
        self._times_s = [*self._times_s[:kept], at_s, max(done_s, at_s + 1e-3)]
        self._offsets_k = [*self._offsets_k[:kept], now_k, wanted_k]
        return done_s

    def temperature_c(self, times_s: FloatArray) -> FloatArray:
        """Degrees Celsius at rig times, shape as `times_s`."""
        return _own_course_c(self._settings, times_s) + np.interp(times_s, self._times_s, self._offsets_k)

    def warmer_k(self, times_s: FloatArray) -> FloatArray:
        """How far above its first mean it is."""
        return self.temperature_c(times_s) - self._settings.mean_c


def _own_course_c(settings: TemperatureSettings, times_s: FloatArray) -> FloatArray:
    """A mean, the sun's daily sine, the air conditioning's cycle, a drift."""
    days = times_s / _DAY_S
    waves = settings.daily_k * np.sin(2.0 * math.pi * days)
    if settings.cycle_k:
        waves += settings.cycle_k * np.sin(2.0 * math.pi * times_s / settings.cycle_s)
    return settings.mean_c + waves + settings.drift_k_per_day * days
