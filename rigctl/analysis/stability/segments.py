"""Welch's method (scipy): powers of Hann segments that overlap by half, and what their means are worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from rigctl.core.arrays import FloatArray

_LONG_RECORD = 4096

FIRST_BIN = 3
"""Mean and trend are taken off a segment; below the third bin their place shows."""

# Squared correlations of the powers of neighbouring Hann bins, and of neighbouring segments.
_BINS, _SEGMENTS = (4.0 / 9.0, 1.0 / 36.0), 1.0 / 36.0


@dataclass(frozen=True, eq=False)
class Bins:
    """The mean one-sided density of `segments` segments, in unit^2/Hz."""

    frequency_hz: FloatArray
    psd: FloatArray
    segments: int

    @property
    def width_hz(self) -> float:
        """From bin to bin."""
        return float(self.frequency_hz[1])

    def dof(self, bins: int) -> float:
        """The degrees of freedom of the mean of so many neighbouring bins."""
        neighbours = 1.0 + sum(2.0 * c * max(0.0, 1.0 - k / bins) for k, c in enumerate(_BINS, 1))
        overlap = 1.0 + 2.0 * _SEGMENTS * (1.0 - 1.0 / self.segments)
        return 2.0 * self.segments * bins / (neighbours * overlap)


def parts(samples: int) -> int:
    """Into how many a record is divided: 16, a short one 4; with those between, that overlap, 31 or 7 segments."""
    return 16 if samples >= _LONG_RECORD else 4


def welch(samples: FloatArray, rate_hz: float, length: int) -> Bins:
    """The density from segments of `length` samples."""
    frequency_hz, psd = signal.welch(samples, rate_hz, "hann", length, length // 2, detrend=signal.detrend)
    segments = 1 + (samples.size - length) // (length - length // 2)
    return Bins(np.asarray(frequency_hz, np.float64), np.asarray(psd, np.float64), segments)
