"""The spectrum of a noise record, two-sided, in bands of the logarithm of frequency down to one over its length.

A power law as steep as that of an electrostatic accelerometer's electronics leaks over the whole spectrum when it is
cut off, so each bin is the mean over sine tapers (Riedel and Sidorenko, IEEE Trans. Signal Proc. 43 (1995) 188), all
of which come from one transform; a straight line is removed first. What tapers and line make of a power law in the
lowest bins is `expected`, exactly: a fit needs neither to leave these bins out nor to believe them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rigctl.core.arrays import FloatArray, Int64Array
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import gauss_nodes

TAPERS = 5
"""Tapers per bin; the lowest have as many as their number."""

_EXACT_BINS = 24
_BANDS_PER_OCTAVE = 8
_FEWEST_SAMPLES = 256
_MAX_FILLED = 0.01
# The window of the lowest bins is worked out on fewer samples, out to this many bins beyond, in steps of 4 to zero.
_WINDOW_SAMPLES, _BEYOND, _GRADING = 512, 40, 16


@dataclass(frozen=True)
class NoiseSpectrum:
    """The two-sided density of a record in bands, shape (bands,) each.

    `density` [unit^2/Hz], with about `dof` degrees of freedom. Neighbours overlap: half the degrees of freedom that a
    band brings to what is fitted to all are its `weight`. A band holds the bins `first` to before `stop`, which are
    `bin_hz` apart. `filled` is the part of the samples that had to be interpolated.
    """

    frequency_hz: FloatArray
    density: FloatArray
    weight: FloatArray
    dof: FloatArray
    first: Int64Array
    stop: Int64Array
    bin_hz: float
    filled: float


def noise_spectrum(samples: FloatArray, sample_rate_hz: float) -> NoiseSpectrum:
    """The spectrum of a record, shape (samples,); up to a hundredth of NaN among them is filled by straight lines.

    Raises `DataError` for a record that is too short or has more gaps.
    """
    whole, filled = _without_gaps(samples)
    n = whole.size
    t = np.arange(n) - 0.5 * (n - 1)
    level = whole - whole.mean()
    # With a sample of zero before the first, the tapers' transforms are differences of this one.
    line = np.concatenate([[0.0], level - t * (t @ level) / (t @ t)])
    # A sine taper shifts by half a bin up and down: at twice the length all tapers are in one transform.
    transform = np.fft.rfft(line, 2 * (n + 1))
    last = (n + 1 - TAPERS) // 2
    sums = np.zeros(last)
    at = 2 * np.arange(1, last + 1)
    for taper in range(1, TAPERS + 1):
        below = transform[np.abs(at - taper)]
        below = np.where(at < taper, below.conj(), below)
        power = np.abs(below - transform[at + taper]) ** 2
        sums += np.where(np.arange(1, last + 1) >= taper, power, 0.0)
    used = np.minimum(TAPERS, np.arange(1, last + 1))
    density = sums / used / (2.0 * (n + 1) * sample_rate_hz)
    first, stop = _bands(last)
    index = first - 1
    count = stop - first
    # Tapers overlap in time, and in frequency over as many bins as there are tapers.
    weight = np.add.reduceat(1.0 / (1.0 + 0.5 / used), index)
    return NoiseSpectrum(
        frequency_hz=np.sqrt(first * (stop - 1.0)) * sample_rate_hz / (n + 1),
        density=np.add.reduceat(density, index) / count,
        weight=weight,
        dof=2.0 * (weight + used[index] - 1.0),
        first=first,
        stop=stop,
        bin_hz=sample_rate_hz / (n + 1),
        filled=filled,
    )


def expected(spectrum: NoiseSpectrum, exponent: float) -> FloatArray:
    """What the bands show of noise with the density (1 Hz / f)^`exponent`, 0 <= exponent < 3, shape (bands,)."""
    low = spectrum.stop <= _EXACT_BINS + 1
    high = ~low
    means = np.empty(spectrum.first.size)
    means[high] = _mean_power(spectrum.first[high], spectrum.stop[high], exponent)
    place, window = _low_window()
    summed = np.append(0.0, np.cumsum(window @ place**-exponent))
    first, stop = spectrum.first[low] - 1, spectrum.stop[low] - 1
    means[low] = (summed[stop] - summed[first]) / (stop - first)
    return np.asarray(means * spectrum.bin_hz**-exponent)


def _mean_power(first: Int64Array, stop: Int64Array, exponent: float) -> FloatArray:
    """Mean of k^-exponent over bins far from zero, with what the curvature adds within the tapers' window."""
    low, high = first - 0.5, stop - 0.5
    if abs(exponent - 1.0) < 1e-6:
        mean = np.log(high / low) / (stop - first)
    else:
        mean = (high ** (1.0 - exponent) - low ** (1.0 - exponent)) / ((1.0 - exponent) * (stop - first))
    # Mean square width of the window in bins, that of the tapers j / 2; less that of a bin of the integral.
    width = np.mean(np.arange(1, TAPERS + 1) ** 2) / 4.0 - 1.0 / 12.0
    return np.asarray(mean * (1.0 + 0.5 * exponent * (exponent + 1.0) * width / (low * high)))


@lru_cache(maxsize=1)
def _low_window() -> tuple[FloatArray, FloatArray]:
    """Places of a quadrature, in bins, and what the lowest bins see there: (nodes,) and (_EXACT_BINS, nodes)."""
    n = _WINDOW_SAMPLES
    edges = np.append(4.0 ** -np.arange(_GRADING, 0.0, -1.0), np.arange(1.0, _EXACT_BINS + _BEYOND + 1.0))
    place, share = gauss_nodes(edges)
    t = np.arange(1, n + 1) / (n + 1)
    taper = np.sqrt(2.0 / (n + 1)) * np.sin(np.pi * np.arange(1, TAPERS + 1)[:, None] * t)
    line, _ = np.linalg.qr(np.stack([np.ones(n), t], axis=1))
    waves = np.exp(2j * np.pi * t[:, None] * np.concatenate([place, -place]))
    waves -= line @ (line.T @ waves)
    window = np.empty((_EXACT_BINS, place.size))
    for k in range(1, _EXACT_BINS + 1):
        rows = taper[: min(k, TAPERS)] * np.exp(-2j * np.pi * k * t)
        power = (np.abs(rows @ waves) ** 2).mean(axis=0) / (n + 1)
        window[k - 1] = (power[: place.size] + power[place.size :]) * share
    return place, window


def _bands(last: int) -> tuple[Int64Array, Int64Array]:
    """First bin and the one after the last of each band of the bins 1 to `last`."""
    edges = [1]
    while edges[-1] <= last:
        edges.append(max(edges[-1] + 1, round(edges[-1] * 2.0 ** (1.0 / _BANDS_PER_OCTAVE))))
    # None holds both bins that are worked out exactly and others.
    chosen = np.union1d(edges[:-1], [_EXACT_BINS + 1, last + 1])
    return chosen[:-1], chosen[1:]


def _without_gaps(samples: FloatArray) -> tuple[FloatArray, float]:
    """The samples with gaps filled by straight lines, and what part of them that was."""
    seen = np.isfinite(samples)
    filled = 1.0 - float(seen.mean()) if samples.size else 1.0
    if samples.ndim != 1 or samples.size < _FEWEST_SAMPLES or filled > _MAX_FILLED:
        raise DataError(
            f"a noise record of {samples.size} samples, {100.0 * filled:.2g} % of them missing, has no spectrum: "
            f"record at least {_FEWEST_SAMPLES} with less than {100.0 * _MAX_FILLED:g} % missing"
        )
    if filled == 0.0:
        return samples, 0.0
    index = np.arange(samples.size)
    return np.interp(index, index[seen], samples[seen]), filled
