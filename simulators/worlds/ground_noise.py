"""How the ground shakes: white acceleration with a microseism bump."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import iirpeak, sosfilt

from rigctl.core.arrays import FloatArray
from simulators.worlds.bench_settings import GroundNoiseSettings

_BLOCK = 512


class GroundNoise:
    """A stream of ground acceleration [m/s2], three independent components, one row per `step_s`.

    It is stationary from its first row, never repeats, and each row depends on the generator's key and on its
    place in the stream alone, not on how many rows were taken at a time. The bump is white noise through two
    resonant sections.
    """

    def __init__(self, settings: GroundNoiseSettings, step_s: float, rng: np.random.Generator) -> None:
        self._rng = rng
        self._ready = np.empty((0, 3))
        # White noise of one-sided density S has variance S / (2 step).
        self._white_rms = settings.asd_m_s2_rthz / math.sqrt(2.0 * step_s)
        self._bump_rms = settings.bump_asd_m_s2_rthz / math.sqrt(2.0 * step_s)
        # Half of |H|^4 of a section of quality Q is reached sqrt(sqrt(2) - 1) of its own half width away.
        quality = math.sqrt(math.sqrt(2.0) - 1.0) * settings.bump_frequency_hz / settings.bump_width_hz
        b, a = iirpeak(settings.bump_frequency_hz, quality, fs=1.0 / step_s)
        self._sections = np.array([[*b, *a], [*b, *a]])
        self._state = np.zeros((2, 2, 3))
        if self._bump_rms > 0.0:
            ring_down_s = quality / (math.pi * settings.bump_frequency_hz)
            # Run in for ten ring-downs, to be stationary from the first row on.
            self._bump(math.ceil(10.0 * ring_down_s / step_s))

    def take(self, count: int) -> FloatArray:
        """The next `count` rows, shape (count, 3)."""
        missing = count - len(self._ready)
        if missing > 0:
            blocks = [self._block() for _ in range(math.ceil(missing / _BLOCK))]
            self._ready = np.concatenate([self._ready, *blocks])
        taken, self._ready = self._ready[:count], self._ready[count:]
        return taken

    def _block(self) -> FloatArray:
        rows = self._white_rms * self._rng.standard_normal((_BLOCK, 3))
        return rows + self._bump(_BLOCK) if self._bump_rms > 0.0 else rows

    def _bump(self, count: int) -> FloatArray:
        white = self._bump_rms * self._rng.standard_normal((count, 3))
        shaped, self._state = sosfilt(self._sections, white, axis=0, zi=self._state)
        return np.asarray(shaped, dtype=np.float64)
