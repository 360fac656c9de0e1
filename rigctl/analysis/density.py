"""The amplitude density of a stretch of samples, for whoever watches: quick, and of any quantity."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray

LONGEST_WINDOW = 4096


def amplitude_density(samples: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies and one-sided amplitude density of evenly spaced samples: the mean of overlapping Hann windows."""
    # Gaps are closed up: good enough for a level to watch, no spectrum to calculate with.
    values = samples[np.isfinite(samples)]
    size = min(len(values), LONGEST_WINDOW)
    if size < 16:
        return np.zeros(0), np.zeros(0)
    window = np.hanning(size)
    starts = range(0, len(values) - size + 1, max(size // 2, 1))
    parts = (values[start : start + size] for start in starts)
    power = [np.abs(np.fft.rfft(window * (part - part.mean()))) ** 2 for part in parts]
    # Twice, for the power of negative frequencies; the window's own power is divided out (Welch).
    scale = 2.0 / (rate_hz * float(np.sum(window**2)))
    # Without the bin at zero: its content was taken off with the mean.
    frequency_hz = np.asarray(np.fft.rfftfreq(size, 1.0 / rate_hz)[1:], dtype=np.float64)
    return frequency_hz, np.asarray(np.sqrt(scale * np.mean(power, axis=0))[1:], dtype=np.float64)


def median_density(frequency_hz: FloatArray, density: FloatArray, low_hz: float, high_hz: float) -> float | None:
    """The median between two frequencies, which lines such as the drive's do not move; None without any bin there."""
    band = (frequency_hz > low_hz) & (frequency_hz < high_hz)
    return float(np.median(density[band])) if band.any() else None
