"""Steady lines in one record: sines that stand out of its noise, fitted and taken out one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal, stats
from scipy.ndimage import median_filter

from rigctl.analysis.stability.segments import Bins, parts, welch
from rigctl.core.arrays import FloatArray

LOBE = 3
"""Bins on either side that a line reaches."""

MOST = 20

_NEIGHBOURS = 12
"""Bins on either side whose median is the noise under a line."""

_FIRST = 6
"""Nearer to zero a steep density is taken for a line."""

_ALPHA = 0.01
"""The probability of a false line in a record of noise."""

_HANN_VARIANCE = 1.5
"""Of a mean weighted by a Hann window, in that of a plain mean."""


@dataclass(frozen=True)
class SteadyLine:
    """A sine's frequency and its amplitude, half of peak to peak, with the standard uncertainty noise gives it."""

    frequency_hz: float
    amplitude: float
    sigma: float


def take_out_lines(samples: FloatArray, rate_hz: float) -> tuple[FloatArray, list[SteadyLine]]:
    """The samples without their lines, and the lines in the order of their evidence, at most `MOST`."""
    rest, lines = samples, list[SteadyLine]()
    while len(lines) < MOST:
        bins = welch(rest, rate_hz, samples.size // parts(samples.size))
        level = _level(bins)
        at = _outstanding(bins, level, [line.frequency_hz for line in lines])
        if at is None:
            break
        frequency_hz = _peak_hz(rest, rate_hz, bins.frequency_hz[at], bins.width_hz)
        rest, frequency_hz, amplitude = _without_sine(rest, rate_hz, frequency_hz)
        variance = _HANN_VARIANCE * float(level[at]) * rate_hz / samples.size
        lines.append(SteadyLine(frequency_hz, amplitude, variance**0.5))
    return rest, lines


def _level(bins: Bins) -> FloatArray:
    """The noise under each bin: the median of a density that falls steadily is the one in the middle."""
    middle = median_filter(bins.psd, 2 * _NEIGHBOURS + 1, mode="mirror")
    dof = bins.dof(1)
    return np.maximum(middle * dof / float(stats.chi2.median(dof)), np.finfo(float).tiny)


def _outstanding(bins: Bins, level: FloatArray, known_hz: list[float]) -> int | None:
    """The bin with the most significant line, none of those known; None for noise."""
    ratio = bins.psd / level
    # The last bin, at the Nyquist frequency, has half the degrees of freedom.
    ratio[:_FIRST], ratio[-1:] = 0.0, 0.0
    for known in known_hz:
        ratio[np.abs(bins.frequency_hz - known) <= (LOBE + 0.5) * bins.width_hz] = 0.0
    tried, at = np.count_nonzero(ratio), int(np.argmax(ratio))
    # The level is an estimate too: a median is worth two thirds of its values, neighbouring bins half of theirs.
    dof_of_level = bins.dof(1) * (2 * _NEIGHBOURS + 1) / 3.0
    p_value = float(stats.f.sf(ratio[at], bins.dof(1), dof_of_level))
    return at if tried and p_value * tried < _ALPHA else None


def _peak_hz(samples: FloatArray, rate_hz: float, near_hz: float, within_hz: float) -> float:
    """The peak of the whole record's spectrum near a frequency, between its bins."""
    whole = welch(samples, rate_hz, samples.size)
    near = np.flatnonzero(np.abs(whole.frequency_hz - near_hz) <= 1.5 * within_hz)
    at = int(np.clip(near[np.argmax(whole.psd[near])], 1, whole.psd.size - 2))
    left, middle, right = np.log(np.maximum(whole.psd[at - 1 : at + 2], np.finfo(float).tiny))
    bend = left - 2.0 * middle + right
    return float(whole.frequency_hz[at] + whole.width_hz * (0.5 * (left - right) / bend if bend < 0.0 else 0.0))


def _without_sine(samples: FloatArray, rate_hz: float, start_hz: float) -> tuple[FloatArray, float, float]:
    """The samples less the sine of least squares near `start_hz`, its frequency and amplitude.

    Weighted by a Hann window, which other lines reach across less than across an edge.
    """
    time_s = (np.arange(samples.size) - 0.5 * (samples.size - 1)) / rate_hz
    window = signal.windows.hann(samples.size, sym=False)
    centred = samples - float(window @ samples) / float(window.sum())
    frequency_hz = start_hz
    for _ in range(5):
        turn = 2.0 * np.pi * frequency_hz * time_s
        cosine, sine = np.cos(turn), np.sin(turn)
        columns = np.stack([cosine, sine])
        weighted = columns * window
        a, b = np.linalg.solve(weighted @ columns.T, weighted @ centred)
        left = centred - a * cosine - b * sine
        # By how much the frequency is off: its derivative is orthogonal to the sine, for time counts from the middle.
        slope = 2.0 * np.pi * time_s * (b * cosine - a * sine)
        step = float((window * slope) @ left) / max(float((window * slope) @ slope), np.finfo(float).tiny)
        # Beyond half a bin the linear step is no guide, and the spectrum's peak is nearer.
        if not 1e-6 < abs(step) * samples.size / rate_hz < 0.5:
            break
        frequency_hz += step
    return samples - a * cosine - b * sine, frequency_hz, float(np.hypot(a, b))
