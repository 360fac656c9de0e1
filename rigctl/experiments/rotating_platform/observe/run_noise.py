"""The noise of a run, estimated from its own periods: white and a power law, averaged over what the data leave open.

The four outputs of successive periods are a stationary series whose covariances follow from the weights of the
samples (`covariance`). Whittle's likelihood of its tapered transforms, with what the tapers make of a steep spectrum
and without what fits took off, weighs every spectrum of a grid of exponents and levels; the mean spectrum gives the
covariance. The lowest frequencies, where drifts are, have no say. Other runs of the channel in the same recording
count as a prior of limited weight, since they share its sensor: of the form, and of the level as far as their own
levels are alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from scipy import special

from rigctl.analysis.kept import Packed
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import Sided, covariances
from rigctl.experiments.rotating_platform.observe.estimators import coarser, weights
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern

SIDED: Sided = 2
"""Densities here are over both signs of the frequency."""

EXPONENTS = np.arange(0.4, 2.61, 0.2)
RATIOS = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 25)])
"""Of the power law over the white part at `AT_HZ`."""

AT_HZ = 0.01
# Runs of a channel share one sensor, so that the others weigh much; it was 60 once (decision 022).
PRIOR_TRANSFORMS = 250.0
"""So many transforms the other runs count for at most."""

TAPERS = 3
# Lower frequencies of the series belong to drifts, some of which are effects.
_LOWEST_PLACE = 3
# The four outputs of a period.
_FOR_A_TRANSFORM = 4.0
# Of logarithms: levels of one sensor may differ by a third from run to run.
_USUAL_BETWEEN = 0.1
_FINE, _LONG = 1200, 1 << 16
_NEGLIGIBLE = 1e-4
# Of one over the record: what is slower is a level to it, which the baseline has free.
_BEYOND_RECORD = 0.2
_NOTHING_LEFT = 1e-6


@dataclass(frozen=True)
class Likelihood:
    """Of one run: `log` (exponents, ratios) with the white level [unit^2/Hz] at its best in `white`; `transforms`."""

    log: FloatArray
    white: FloatArray
    transforms: float

    def packed(self) -> Packed:
        """To be kept."""
        return Packed({"transforms": self.transforms}, {"log": self.log, "white": self.white})

    @classmethod
    def unpacked(cls, kept: Packed) -> Likelihood:
        """What was packed, bit for bit."""
        return cls(kept.arrays["log"], kept.arrays["white"], float(kept.head["transforms"]))


@dataclass(frozen=True)
class RunNoise:
    """The mean two-sided spectrum of a run: a white level, and that of each of `EXPONENTS` at `AT_HZ` [unit^2/Hz].

    `dof`: degrees of freedom of its level at the modulation's frequency.
    """

    white: float
    red: FloatArray
    dof: float

    def __call__(self, frequency_hz: FloatArray) -> FloatArray:
        """The density [unit^2/Hz] at positive frequencies."""
        logs = np.log(np.asarray(frequency_hz, dtype=np.float64) / AT_HZ)
        density = np.full(logs.shape, self.white)
        for exponent, level in zip(EXPONENTS, self.red, strict=True):
            if level > 0.0:
                density += level * np.exp(-exponent * logs)
        return density


@dataclass(frozen=True)
class Scatter:
    """Of further outputs of a period: their weights (outputs, samples), variances [unit^2], degrees of freedom."""

    weights: FloatArray
    variance: FloatArray
    dof: FloatArray


def likelihood(
    sampled: SampledPattern, per_group: int, series: FloatArray, fitted: FloatArray, scatter: Scatter
) -> Likelihood:
    """Of what a fit has left of the outputs, shape (4, groups), and of the bins' `scatter`.

    `fitted` (4, groups, columns) are orthonormal columns of that fit: what of a wave lies in them is lost. Where all
    of it does, nothing is left but rounding: that tells nothing. Raises `DataError` where what is left is no noise.
    """
    groups = series.shape[1]
    shape = (len(EXPONENTS), len(RATIOS))
    lowest = min(_LOWEST_PLACE, max(groups // 6, 1))
    numbers = np.arange(lowest, groups // 2 + 1)
    cost, power = np.zeros(shape), np.zeros(shape)
    count = 0.0
    waves = _tapered_waves(groups, lowest)
    # Output by output: what is slow is in the bias, and so is what was fitted to it.
    lost = (np.abs(np.tensordot(waves, fitted, axes=([2], [1]))) ** 2).sum(axis=(1, 3))
    share = 1.0 - lost / (np.abs(waves) ** 2).sum(axis=(1, 2))[:, None]
    share = np.where(share > _NOTHING_LEFT, share, 0.0)
    if share.any():
        drawn = np.einsum("jkg,ag->jka", waves, series)
        white, red = _spectra(sampled, per_group, groups, lowest)
        factor = np.linalg.inv(np.linalg.cholesky(white))
        # A transform at the Nyquist place is real: half a datum. Tapers overlap: neighbours are not independent.
        weight = np.where(numbers * 2 == groups, 0.5, 1.0) / (1.0 + 0.5 / TAPERS)
        count += float(weight @ share.sum(axis=1))
        for row, density in enumerate(red):
            # White and red are made diagonal together, so that a further ratio costs a division.
            strength, turn = np.linalg.eigh(factor @ density @ factor.conj().swapaxes(1, 2))
            ways = turn.conj().swapaxes(1, 2) @ factor
            seen = np.einsum("jba,jka->jkb", ways, drawn)
            # What of white noise in each of them comes from which output adds up to one.
            of_output = (ways * (white @ ways.conj().swapaxes(1, 2)).swapaxes(1, 2)).real
            left = np.einsum("jba,ja->jb", of_output, share)
            grown = 1.0 + np.maximum(strength, 0.0)[None] * RATIOS[:, None, None]
            power[row] += np.einsum("j,rjb->r", weight, (np.abs(seen) ** 2).mean(axis=1)[None] / grown)
            cost[row] += np.einsum("j,jb,rjb->r", weight, left, np.log(grown))
    transform, frequency, share_hz = _transforms(sampled.sample_rate_hz, scatter.weights)
    seen_power = np.abs(transform) ** 2
    plain = seen_power @ share_hz
    for row, exponent in enumerate(EXPONENTS):
        coloured = seen_power @ (share_hz * (frequency / AT_HZ) ** -exponent)
        expected = plain + RATIOS[:, None] * coloured
        power[row] += (0.5 * scatter.dof * scatter.variance / expected).sum(axis=1)
        cost[row] += (0.5 * scatter.dof * np.log(expected / plain)).sum(axis=1)
    count += 0.5 * float(scatter.dof.sum())
    if not count > 0.0:
        return Likelihood(np.zeros(shape), np.full(shape, np.nan), 0.0)
    level = power / count
    if not (np.isfinite(level).all() and np.isfinite(cost).all() and (level > 0.0).all()):
        raise DataError("what its fit leaves is nil or no number")
    # The white level at its best for each shape, its likelihood concentrated out.
    return Likelihood(-count * np.log(level) - cost, level, count / 4.0)


def run_noise(own: Likelihood, others: Sequence[Likelihood], period_s: float) -> RunNoise:
    """The noise of a run, given what the other runs of its channel say."""
    known = [each for each in others if each.transforms > 0.0]
    transforms = sum(each.transforms for each in known)
    if own.transforms + transforms == 0.0:
        raise DataError("the runs are too short to tell their noise: record more periods")
    log = np.zeros(own.log.shape)
    if known:
        log += min(1.0, PRIOR_TRANSFORMS / transforms) * np.sum([each.log for each in known], axis=0)
    white, log_level, count = _level(own, known)
    log += log_level
    weight = np.exp(log - log.max())
    # Without a red part all exponents are the same white noise, which counts once.
    weight[:, 0] /= len(EXPONENTS)
    weight = np.where(weight > _NEGLIGIBLE * weight.max(), weight, 0.0)
    share = weight / weight.sum()
    # The level is judged where it matters: at the modulation frequency.
    at = np.log(white * (1.0 + RATIOS * (AT_HZ * period_s) ** EXPONENTS[:, None]))
    spread = float((share * (at - float((share * at).sum())) ** 2).sum())
    return RunNoise(
        white=float((share * white).sum()),
        red=np.asarray((share * white * RATIOS).sum(axis=1)),
        # A level from nu degrees of freedom has a logarithm of variance 2 / nu.
        dof=2.0 / (1.0 / max(count, 2.0) + spread),
    )


def _level(own: Likelihood, known: Sequence[Likelihood]) -> tuple[FloatArray, FloatArray, float]:
    """The white level on the grid, the run's own log likelihood there, and what squares stand behind the level.

    A level is the mean of so many exponentials. Those of the other runs are a prior, an inverse gamma whose spread is
    that between their levels beyond what chance makes: a run of a few periods has its channel's level.
    """
    count = _FOR_A_TRANSFORM * own.transforms
    if not known:
        return own.white, own.log, count
    counts = np.array([_FOR_A_TRANSFORM * each.transforms for each in known])
    logs = (
        np.stack([np.log(each.white) for each in known])
        + np.log(counts / np.exp(special.digamma(counts)))[:, None, None]
    )
    between = _between_levels(logs, special.polygamma(1, counts), np.sum([each.log for each in known], axis=0))
    weight = 1.0 / (special.polygamma(1, counts) + between)
    level = np.exp(np.tensordot(weight, logs, axes=1) / weight.sum())
    prior = 1.0 / (between + 1.0 / weight.sum())
    if count == 0.0:
        return level, np.zeros(own.log.shape), prior
    both = (count * own.white + prior * level) / (count + prior)
    log = own.log + count * np.log(own.white) + prior * np.log(level) - (count + prior) * np.log(both)
    return both, log, count + prior


def _between_levels(logs: FloatArray, variance: FloatArray, likelihood_log: FloatArray) -> float:
    """The variance between logarithms of levels beyond their own, where the runs together are most likely.

    By moments (DerSimonian and Laird, Control. Clin. Trials 7 (1986) 177), with one run's worth of what levels of one
    sensor differ by.
    """
    values = logs.reshape(len(logs), -1)[:, int(likelihood_log.argmax())]
    weight = 1.0 / variance
    scatter = float(weight @ (values - weight @ values / weight.sum()) ** 2)
    spare = len(values) - 1
    scale = weight.sum() - float(weight @ weight) / weight.sum()
    found = max(0.0, (scatter - spare) / scale) if spare else 0.0
    return (_USUAL_BETWEEN + spare * found) / (spare + 1)


def white_sizes(sampled: SampledPattern, per_group: int) -> FloatArray:
    """Standard deviations of the four outputs of a group in white noise of one unit^2/Hz, (4,)."""
    rows, rate_hz = _grouped(sampled, per_group)
    return np.asarray(np.sqrt(rate_hz * (rows**2).sum(axis=1)))


def joint_covariance(noise: RunNoise, sampled: SampledPattern, per_group: int, which: Sequence[int]) -> FloatArray:
    """Covariance of the four outputs of the groups numbered `which`, output by output; (4 groups, 4 groups)."""
    groups = max(which) + 1
    lags = np.tensordot(np.array([noise.white, *noise.red]), _lags(sampled, per_group, groups), axes=1)
    numbers = np.asarray(which)
    apart = numbers[:, None] - numbers[None, :]
    ahead = lags[np.abs(apart)]
    both = np.where((apart >= 0)[:, :, None, None], ahead, ahead.swapaxes(2, 3))
    size = numbers.size
    return np.asarray(both.transpose(2, 0, 3, 1).reshape(4 * size, 4 * size))


def covariance_within(noise: RunNoise, rate_hz: float, rows: FloatArray) -> FloatArray:
    """Covariance of outputs of a period that do not see a constant, by their weights, shape (outputs, samples)."""
    transform, frequency, share_hz = _transforms(rate_hz, rows)
    return np.asarray(((transform.conj() * (share_hz * noise(frequency))) @ transform.T).real)


def _transforms(rate_hz: float, rows: FloatArray) -> tuple[ComplexArray, FloatArray, FloatArray]:
    """Of weights, shape (outputs, samples), at twice as many frequencies; these, and the width each stands for."""
    length = 2 * rows.shape[1]
    transform = np.fft.rfft(rows, length)[:, 1:]
    frequency = np.arange(1, transform.shape[1] + 1) * rate_hz / length
    share_hz = np.full(frequency.size, 2.0 * rate_hz / length)
    # The Nyquist frequency belongs to both signs once.
    share_hz[-1] *= 0.5
    return transform, frequency, share_hz


@lru_cache(maxsize=64)
def _grouped(sampled: SampledPattern, per_group: int) -> tuple[FloatArray, float]:
    """The joint fit's weights of a group of periods on a coarse enough time base, and its rate."""
    most = min(_FINE, max(_LONG // per_group, _FINE // 8))
    coarse, rate_hz = coarser(weights(sampled, "joint-ls"), sampled.sample_rate_hz, most)
    return np.tile(coarse, (1, per_group)) / per_group, rate_hz


@lru_cache(maxsize=64)
def _tapered_waves(groups: int, lowest: int) -> ComplexArray:
    """Waves at the places j / groups under sine tapers, straight lines taken off, (places, tapers, groups)."""
    at = np.arange(groups)
    number = np.arange(1, TAPERS + 1)[:, None]
    tapers = np.sqrt(2.0 / (groups + 1.0)) * np.sin(np.pi * number * (at + 1.0) / (groups + 1.0))
    places = np.arange(lowest, groups // 2 + 1) / groups
    rows = tapers * np.exp(-2j * np.pi * places[:, None, None] * at)
    line, _ = np.linalg.qr(np.stack([np.ones(groups), at], axis=1))
    return np.asarray(rows - (rows @ line) @ line.T)


@lru_cache(maxsize=64)
def _spectra(sampled: SampledPattern, per_group: int, groups: int, lowest: int) -> tuple[ComplexArray, ComplexArray]:
    """What `_tapered_waves` show of the outputs on average: of white noise (places, 4, 4), of each power law.

    Tapers leak: where a density is steep they show more than it is. So these are no densities at the places but sums
    over the outputs' covariances.
    """
    spectrum = np.abs(np.fft.fft(_tapered_waves(groups, lowest), 2 * groups)) ** 2
    products = np.fft.ifft(spectrum.mean(axis=1))[:, :groups]
    # The conjugate is added below: lag zero would count twice.
    products[:, 0] *= 0.5

    half = np.tensordot(products, _lags(sampled, per_group, groups), axes=([1], [1])).swapaxes(0, 1)
    white, *red = half + half.conj().swapaxes(2, 3)
    return np.asarray(white), np.stack(red)


@lru_cache(maxsize=64)
def _lags(sampled: SampledPattern, per_group: int, groups: int) -> FloatArray:
    """Covariances of the outputs with those of groups before, for white noise of level 1 and for each of `EXPONENTS`
    with level 1 at `AT_HZ`; shape (1 + exponents, groups, 4, 4)."""
    rows, rate_hz = _grouped(sampled, per_group)
    length_s = groups * rows.shape[1] / rate_hz

    def density(exponent: float, frequency_hz: FloatArray) -> FloatArray:
        return np.asarray((np.asarray(frequency_hz) / AT_HZ) ** -exponent)

    densities = [partial(density, float(exponent)) for exponent in (0.0, *EXPONENTS)]
    from_hz = _BEYOND_RECORD / length_s
    return covariances(rows, rate_hz, densities, sided=SIDED, lags=groups - 1, from_hz=from_hz)
