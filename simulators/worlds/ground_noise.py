"""How the ground shakes: white acceleration with a microseism bump."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.worlds.bench_settings import GroundNoiseSettings
from simulators.worlds.recursion import SecondOrderSection

_BLOCK, _AHEAD = 512, 8
"""Rows that are drawn at a time, and so many times that before the next are wanted: few calls cost less than many."""


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
        angle = 2.0 * math.pi * settings.bump_frequency_hz * step_s
        # By the bilinear transform; of gain 1 at the peak.
        share = 1.0 / (1.0 + math.tan(0.5 * angle / quality))
        b, a = (1.0 - share) * np.array([1.0, 0.0, -1.0]), [1.0, -2.0 * share * math.cos(angle), 2.0 * share - 1.0]
        self._sections = [SecondOrderSection(b, np.array(a), 3) for _ in range(2)]
        if self._bump_rms > 0.0:
            ring_down_s = quality / (math.pi * settings.bump_frequency_hz)
            # Run in for ten ring-downs, to be stationary from the first row on.
            self._shaped(rng.standard_normal((math.ceil(10.0 * ring_down_s / step_s), 3)))

    def take(self, count: int) -> FloatArray:
        """The next `count` rows, shape (count, 3)."""
        missing = count - len(self._ready)
        if missing > 0:
            self._ready = np.concatenate([self._ready, self._blocks(max(math.ceil(missing / _BLOCK), _AHEAD))])
        taken, self._ready = self._ready[:count], self._ready[count:]
        return taken

    def _blocks(self, count: int) -> FloatArray:
        drawn = self._rng.standard_normal((count, 2 if self._bump_rms > 0.0 else 1, _BLOCK, 3))
        rows = self._white_rms * drawn[:, 0].reshape(-1, 3)
        return rows + self._shaped(drawn[:, 1].reshape(-1, 3)) if self._bump_rms > 0.0 else rows

    def _shaped(self, white: FloatArray) -> FloatArray:
        """The bump, from white noise of unit variance, (rows, 3)."""
        once, twice = self._sections
        return twice.filtered(once.filtered(np.ascontiguousarray(self._bump_rms * white.T))).T
