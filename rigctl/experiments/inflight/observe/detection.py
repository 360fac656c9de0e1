"""What tells pulses from noise: their shape, the noise's density without them, where a filter's output stands out.

Not `scipy.signal`, whose import takes longer than a session is looked through.
"""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, IntArray

# Of crackling in orbit: e^(-t / 3 s) - e^(-t / 1 s).
RISE_S, FALL_S = 1.0, 3.0

SPECTRUM_S = 1024.0
"""Length of the segments of a density."""


def density_of(left: FloatArray, present: BoolArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies [Hz] and the one-sided density of samples, zero where not `present`.

    Welch's, of half-overlapping Hann segments about their means; a median over them, which pulses hardly lift, over
    what the median of as many normal powers is of their mean (Allen et al., Phys. Rev. D 85, 122006, appendix B).
    """
    length = min(round(SPECTRUM_S / step_s), len(left))
    segments = np.lib.stride_tricks.sliding_window_view(left, length)[:: length - length // 2]
    window = np.hanning(length + 1)[:-1]
    spectra = np.fft.rfft((segments - segments.mean(axis=1, keepdims=True)) * window)
    even = 2.0 * np.arange(1, (len(segments) - 1) // 2 + 1)
    of_median = 1.0 + float(np.sum(1.0 / (even + 1.0) - 1.0 / even))
    density = np.median(spectra.real**2 + spectra.imag**2, axis=0) * (2.0 * step_s / of_median / (window @ window))
    density[0] *= 0.5
    if length % 2 == 0:
        density[-1] *= 0.5
    # Missing samples count as zeros: the power is that of the part that is there.
    return np.asarray(np.fft.rfftfreq(length, step_s)), np.asarray(density / max(float(np.mean(present)), 1e-3))


def peaks_of(sigmas: FloatArray, threshold: float, apart: int) -> IntArray:
    """Where maxima are that reach the threshold, in order; of those fewer than `apart` samples apart the highest."""
    inner = sigmas[1:-1]
    maxima = 1 + np.flatnonzero((inner >= threshold) & (inner > sigmas[:-2]) & (inner >= sigmas[2:]))
    kept: list[int] = []
    for place in maxima[np.argsort(-sigmas[maxima], kind="stable")].tolist():
        if all(abs(place - other) >= apart for other in kept):
            kept.append(place)
    return np.array(sorted(kept), dtype=np.intp)
