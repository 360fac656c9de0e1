"""The noise of a run, taken from what the sine fit left of it and never assumed white.

A fit takes degrees of freedom where its columns lie. A spectral bin whose vector w keeps the fraction
m = w^H M w / w^H w outside the fitted space (M the residual projector) has the expectation m S(f), so
dividing by m unbiases it and m is its share of the two degrees of freedom of a whole bin; a bin under a
fitted line has m = 0 and says nothing. The window is the fit's own (rectangular, trend removed), so that
leakage from steep noise enters the estimate as it enters the fitted amplitudes.

Spectra pool by joining their bins: a run driven at another frequency shows the noise at this one's line.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.sine_fit import HarmonicBasis
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import DataError

# Accelerometer noise lies between white (0) and a random walk (-2); a local slope beyond needs evidence.
_SLOPE_PRIOR, _SLOPE_PRIOR_SIGMA = -0.8, 2.0
# A bin of which the fit left less would be multiplied by more than five, errors of the fit included.
_MIN_KEPT = 0.2
_SAME_FREQUENCY = 1e-6
# Cells of a compact spectrum: narrow beside a microseism bump, a fixed fraction of the frequency above.
_CELL_HZ, _CELLS_PER_E_FOLD = 2.0**-8, 128
_MAX_POOL_BINS = 8192
_LOW_BINS = 20
"""The first bins of a run, from which the noise below 1/T is extrapolated."""


@dataclass(frozen=True)
class NoiseLevel:
    """One-sided noise density at a frequency, as well known as a chi-squared of `dof` degrees of freedom.

    `psd` is in unit^2/Hz. The in-phase and the quadrature amplitude of a line fitted over T seconds have the
    variance psd / T each, so an amplitude divided by its estimated sigma follows Student's t with `dof`.
    """

    psd: float
    dof: float


@dataclass(frozen=True)
class Spectrum:
    """Spectral bins of one or several runs in order of frequency.

    `frequency_hz`, `psd` (one-sided, unit^2/Hz, unbiased by the fit) and `weight`, the degrees of freedom in
    units of a whole bin's two; all of shape (bins,).
    """

    frequency_hz: FloatArray
    psd: FloatArray
    weight: FloatArray

    def compact(self, duration_s: float = 0.0) -> Spectrum:
        """Merge bins within cells of 4 mHz, above 0.5 Hz of f / 128; single precision.

        Those that `mean_variance` of a run of `duration_s` asks for stay single.
        """
        linear = self.frequency_hz / _CELL_HZ
        # Both scales meet at 0.5 Hz with one slope: there a cell of 4 mHz is f / 128.
        logarithmic = np.log(np.maximum(linear / _CELLS_PER_E_FOLD, 1e-300)) + 1.0
        cell = np.floor(np.where(linear < _CELLS_PER_E_FOLD, linear, _CELLS_PER_E_FOLD * logarithmic))
        lowest = self.frequency_hz * duration_s <= _LOW_BINS + 0.5
        new = np.diff(cell, prepend=-1.0) > 0.0
        new |= lowest
        new[1:] |= lowest[:-1]
        merged = self._merged(np.flatnonzero(new))
        return Spectrum(*(_single(each) for each in (merged.frequency_hz, merged.psd, merged.weight)))

    def _merged(self, first: IntArray) -> Spectrum:
        """Join the bins from each of `first` to the next."""
        if not first.size:
            return self
        weight = np.add.reduceat(self.weight, first)
        psd = np.add.reduceat(self.weight * self.psd, first) / weight
        return Spectrum(np.add.reduceat(self.weight * self.frequency_hz, first) / weight, psd, weight)

    def level(self, frequency_hz: float, *, target_dof: float = 12.0) -> NoiseLevel:
        """Give the noise at `frequency_hz` from the nearest bins that hold `target_dof` degrees of freedom.

        The bins are described by a local power law, fitted by Whittle likelihood, so that a slope does not
        bias the level; the more runs were pooled, the narrower the band. Raises `DataError` without bins.
        """
        distance = np.abs(self.frequency_hz - frequency_hz)
        order = np.argsort(distance, kind="stable")
        gathered = np.cumsum(2.0 * self.weight[order])
        if not gathered.size or gathered[-1] < 1.0:
            raise DataError(
                f"no spectral bins left near {frequency_hz:g} Hz to take the noise from: "
                "record longer, or pool other runs"
            )
        last = min(int(np.searchsorted(gathered, target_dof)), gathered.size - 1)
        # By distance and not by count: bins equally far on the other side belong to it, else a slope would bias.
        near = distance <= distance[order[last]] * (1.0 + 1e-9)
        return _local_power_law(frequency_hz, self.frequency_hz[near], self.psd[near], self.weight[near])

    def mean_variance(self, duration_s: float) -> float:
        """The variance of the mean over `duration_s`, from the lowest bins; a lower bound where noise is not white.

        A record ends at 1/T and most of the noise of its mean lies below. Raises `DataError` without bins there.
        """
        low = self.frequency_hz * duration_s <= _LOW_BINS
        if not low.any():
            raise DataError(f"no spectral bins below {_LOW_BINS / duration_s:g} Hz: record longer")
        level = _local_power_law(1.0 / duration_s, self.frequency_hz[low], self.psd[low], self.weight[low])
        # White noise of one-sided density S has a mean over T of variance S / 2T.
        return level.psd / (2.0 * duration_s)


def spectrum(residuals: FloatArray, basis: HarmonicBasis) -> Spectrum:
    """Give the noise bins of one channel's residuals, shape (samples,), of a fit with `basis`.

    Missing samples are fine, and times on no uniform grid too: their bins end at the 1024th. Raises `DataError`
    when the shape differs.
    """
    if residuals.shape != (basis.samples,):
        raise DataError(
            f"residuals have shape {residuals.shape}, the basis {basis.samples} samples: pass one channel"
        )
    kept = basis.kept_fraction
    use = kept > _MIN_KEPT
    # One-sided: twice the periodogram |sum x|^2 dt / N.
    scale = 2.0 * basis.sample_period_s / basis.samples
    psd = scale * basis.power(residuals)[use] / kept[use]
    return Spectrum(basis.bin_frequency_hz[use], psd, kept[use])


def pooled_psd(spectra: Iterable[Spectrum]) -> Spectrum:
    """Join the bins of several runs of one channel into one spectrum; raises `DataError` for none.

    Bins of one frequency become one of their summed weight, which loses nothing: their weighted mean is all
    that a chi-squared likelihood asks of them.
    """
    pool = list(spectra)
    if not pool:
        raise DataError("no spectra to pool: give at least one run")
    frequency_hz = np.concatenate([each.frequency_hz for each in pool])
    order = np.argsort(frequency_hz, kind="stable")
    frequency_hz = frequency_hz[order]
    weight = np.concatenate([each.weight for each in pool])[order]
    power = weight * np.concatenate([each.psd for each in pool])[order]
    first = np.flatnonzero(np.diff(frequency_hz, prepend=-1.0) > _SAME_FREQUENCY * frequency_hz)
    together = np.add.reduceat(weight, first) if first.size else weight
    psd = np.add.reduceat(power, first) / together if first.size else power
    return Spectrum(frequency_hz[first], psd, together)


class NoisePool:
    """The joined spectra of runs that share their noise, taken in one after the other in bounded memory."""

    def __init__(self) -> None:
        self._waiting: list[Spectrum] = []
        self._bins = 0

    def add(self, spectrum: Spectrum) -> None:
        """Join the bins of one more run."""
        self._waiting.append(spectrum)
        self._bins += spectrum.weight.size
        # Joined now and then: sorting everything for each new run would cost as the square of their number.
        if self._bins > 16 * _MAX_POOL_BINS:
            self._waiting = [self.spectrum]
            self._bins = self._waiting[0].weight.size

    @property
    def spectrum(self) -> Spectrum:
        """All bins so far; those of runs of many lengths merged within cells. `DataError` for no runs."""
        pool = pooled_psd(self._waiting)
        return pool.compact() if pool.weight.size > _MAX_POOL_BINS else pool


def _single(values: FloatArray) -> FloatArray:
    return values.astype(np.float32).astype(np.float64)


def _local_power_law(at_hz: float, frequency_hz: FloatArray, psd: FloatArray, weight: FloatArray) -> NoiseLevel:
    """Fit S = exp(a) (f / at)^b by Fisher scoring of the Whittle likelihood with a prior on the slope b."""
    floor = np.finfo(float).tiny
    # A channel without noise has no logarithm to fit.
    if not np.any(psd > floor):
        return NoiseLevel(0.0, float(2.0 * weight.sum()))
    design = np.stack([np.ones_like(frequency_hz), np.log(frequency_hz / at_hz)])
    prior = np.diag([0.0, _SLOPE_PRIOR_SIGMA**-2])
    centre = np.array([0.0, _SLOPE_PRIOR])
    weighted = design * weight
    # The expected information of a Whittle likelihood does not depend on the level: it is inverted once.
    covariance = np.linalg.inv(weighted @ design.T + prior)
    estimate = np.array([np.log(weight @ psd / weight.sum()), 0.0])

    def cost(p: FloatArray) -> float:
        log_s = p @ design
        return float(weight @ (log_s + psd * np.exp(-log_s)) + 0.5 * (p - centre) @ prior @ (p - centre))

    current = cost(estimate)
    for _ in range(60):
        step = covariance @ (weighted @ (psd * np.exp(-estimate @ design) - 1.0) - prior @ (estimate - centre))
        # Scoring may overshoot where few bins scatter widely.
        while (trial := cost(estimate + step)) > current and np.abs(step).max() > 1e-9:
            step = step / 2.0
        estimate, current = estimate + step, trial
        if np.abs(step).max() < 1e-6:
            break
    variance = np.diag(covariance)
    # Second-order bias of the estimate (Cordeiro and McCullagh 1991) beyond that of a log chi-squared.
    leverage = np.einsum("ib,ij,jb->b", design, covariance, design)
    bias = 0.5 * (variance[0] - covariance[0] @ weighted @ leverage)
    return NoiseLevel(psd=float(np.exp(estimate[0] - bias)), dof=2.0 / float(variance[0]))
