"""One-sided densities of half-overlapping stretches of a record, whose mean is Welch's estimate.

Not by `scipy.signal`, whose import takes longer than the spectra of an hour's record.
"""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray


def periodograms(samples: FloatArray, step_s: float, length: int) -> tuple[FloatArray, FloatArray]:
    """Frequencies [Hz], (bins,), and of each stretch of `length` samples about its mean, under a Hann window, the
    density in the samples' unit squared per Hz, (stretches, bins).

    Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70.
    """
    stretches = np.lib.stride_tricks.sliding_window_view(samples, length)[:: max(length - length // 2, 1)]
    window = np.hanning(length + 1)[:-1]
    spectra = np.fft.rfft((stretches - stretches.mean(axis=1, keepdims=True)) * window)
    densities = (spectra.real**2 + spectra.imag**2) * (2.0 * step_s / (window @ window))
    # Neither no frequency nor half the sampling rate has a twin among negative ones.
    densities[:, 0] *= 0.5
    if length % 2 == 0:
        densities[:, -1] *= 0.5
    return np.asarray(np.fft.rfftfreq(length, step_s)), np.asarray(densities)


def fast_length(least: int) -> int:
    """The next length that a transform takes fast: with no other factors than 2, 3 and 5."""
    fastest = 1 << (least - 1).bit_length()
    five = 1
    while five < fastest:
        three = five
        while three < fastest:
            twos = -(-least // three)
            fastest = min(fastest, three << (twos - 1).bit_length())
            three *= 3
        five *= 5
    return fastest
