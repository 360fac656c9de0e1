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
