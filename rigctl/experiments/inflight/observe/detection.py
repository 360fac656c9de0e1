"""What tells pulses from noise: their shape, the noise's density without them, where a filter's output stands out.

Peaks not by `scipy.signal`, whose import takes longer than a session is looked through.
"""

from __future__ import annotations

import numpy as np

from rigctl.analysis.periodograms import periodograms
from rigctl.core.arrays import BoolArray, FloatArray, IntArray

# Of crackling in orbit: e^(-t / 3 s) - e^(-t / 1 s).
RISE_S, FALL_S = 1.0, 3.0

SPECTRUM_S = 1024.0
"""Length of the segments of a density."""


def density_of(left: FloatArray, present: BoolArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies [Hz] and the one-sided density of samples, zero where not `present`.

    Of Welch's stretches the median, which pulses hardly lift, over what the median of as many normal powers is of
    their mean (Allen et al., Phys. Rev. D 85, 122006, appendix B).
    """
    f_hz, densities = periodograms(left, step_s, min(round(SPECTRUM_S / step_s), len(left)))
    even = 2.0 * np.arange(1, (len(densities) - 1) // 2 + 1)
    of_median = 1.0 + float(np.sum(1.0 / (even + 1.0) - 1.0 / even))
    # Missing samples count as zeros: the power is that of the part that is there.
    share = max(float(np.mean(present)), 1e-3)
    return f_hz, np.asarray(np.median(densities, axis=0) / (of_median * share))


def peaks_of(sigmas: FloatArray, threshold: float, apart: int) -> IntArray:
    """Where maxima are that reach the threshold, in order; of those fewer than `apart` samples apart the highest."""
    inner = sigmas[1:-1]
    maxima = 1 + np.flatnonzero((inner >= threshold) & (inner > sigmas[:-2]) & (inner >= sigmas[2:]))
    kept: list[int] = []
    for place in maxima[np.argsort(-sigmas[maxima], kind="stable")].tolist():
        if all(abs(place - other) >= apart for other in kept):
            kept.append(place)
    return np.array(sorted(kept), dtype=np.intp)
