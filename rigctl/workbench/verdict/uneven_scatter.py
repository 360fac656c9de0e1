"""Scatter that is not the same everywhere: along the fitted level, a column of numbers, or from word to word.

Asked is whether the size of residuals goes with a condition by rank (Spearman), or differs by word (Kruskal and
Wallis): that takes any law that rises or falls, and no tail of the noise makes it say more than it should. What is
found is sized as sigma = s exp(g C) (Cook and Weisberg, Biometrika 70 (1983) 1) and taken out before the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import special

from rigctl.core.arrays import FloatArray
from rigctl.workbench.scatter import LEAST_DOF, LEVEL, UnevenScatter
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.noise import orthonormal
from rigctl.workbench.verdict.offsets import own_sigma
from rigctl.workbench.verdict.score import UNDETERMINED

MOST = 3
ROUNDS = 3
SAME_ORDER = 0.99
"""Rank correlation from which two conditions put the readings in one order."""

_LEAST_FREE = 1e-3
# Within e^20 the law says all that anybody can have measured.
_STEEPEST = 20.0


def uneven_scatter(attempt: Attempt, alpha: float) -> tuple[UnevenScatter, ...]:
    """Along what the scatter of a fitted model's residuals changes, the most significant first.

    `alpha` is the level over all conditions together. Nothing where noise is not told by the scatter of one series.
    """
    given = attempt.model.observations
    if len(given.series) != 1 or not attempt.estimator.from_scatter or attempt.result.dof < LEAST_DOF:
        return ()
    numbers, words = _conditions(attempt)
    ranks, same_as = _in_different_orders(numbers)
    unit, sigma, count = _Unit(attempt), np.ones(len(given.value)), len(ranks) + len(words)
    found: list[UnevenScatter] = []
    while (ranks or words) and len(found) < MOST:
        size = np.abs(independent_residuals(attempt, sigma))
        of_size = _ranks(size)
        p_values = {name: _p_of_rank(ranks[name], of_size) for name in ranks}
        p_values |= {name: _p_of_words(codes, of_size) for name, codes in words.items()}
        along = min(p_values, key=lambda name: p_values[name])
        corrected = min(count * p_values[along], 1.0)
        if not corrected < alpha:
            break
        kind: type[_Law] | type[_Sizes] = _Sizes if along in words else _Law
        values = words.pop(along) if along in words else numbers[along]
        ranks.pop(along, None)
        law, before = kind(values, size), sigma
        for _ in range(ROUNDS):
            # Where readings scatter little, a fit that took all for equal is off by what others scatter.
            sigma = before * law.of(values)
            law = kind(values, np.abs(independent_residuals(attempt, sigma)) * law.of(values))
        sigma = before * law.of(values)
        told = law.told(along, given.levels.get(along, ()), unit)
        p_value, same = p_values[along], tuple(same_as.get(along, ()))
        found.append(replace(told, p_value=p_value, p_value_corrected=corrected, same_as=same))
    return tuple(found)


class _Unit:
    """Of what is told: the series', or stated uncertainties where there are any; whitened residuals times `scale`."""

    def __init__(self, attempt: Attempt) -> None:
        given, noise = attempt.model.observations, attempt.noise
        self.of_stated = any(pool.stated for pool in given.pools)
        # What is a reading's own: offsets that readings share are no scatter.
        sigma = own_sigma(given, noise.total_sigma()) / (given.sigma if self.of_stated else 1.0)
        self.scale = float(np.sqrt(np.mean(sigma**2)))
        self.name = "" if self.of_stated else given.series[0].unit

    def told(self, along: str, **sizes: Any) -> UnevenScatter:
        """What is found, without its p-values."""
        return UnevenScatter(along, (), 1.0, 1.0, self.name, self.of_stated, **sizes)


def independent_residuals(attempt: Attempt, sigma: FloatArray | None = None) -> FloatArray:
    """Whitened residuals, each as large as if its own reading had not drawn the fit to it, (n,).

    With `sigma` (n,), in units of the noise as it was taken, the fit weighs by it, and residuals are in units of it.
    """
    white = attempt.whitened()
    basis = attempt.projector.basis[: len(white)]
    if sigma is not None:
        basis, white = orthonormal(basis / sigma[:, None], UNDETERMINED), white / sigma
        white = white - basis @ (basis.T @ white)
    free = 1.0 - np.sum(basis**2, axis=1)
    # One that decides its own fit alone says nothing, and is left as it is.
    return np.asarray(white / np.sqrt(np.where(free > _LEAST_FREE, free, 1.0)))


def _conditions(attempt: Attempt) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Columns of numbers that vary, the level before them, and codes of columns of words; (n,) each."""
    given = attempt.model.observations
    columns = {name: given.of_runs(name) for name in given.covariates}
    usable = {name: values for name, values in columns.items() if np.isfinite(values).all() and np.ptp(values) > 0.0}
    words = {name: values for name, values in usable.items() if name in given.levels}
    # Of stated uncertainties another question is asked: are they too small by a factor, or by something added?
    numbers = {name: values for name, values in usable.items() if name not in words and not _is_stated(values, given)}
    level = given.value - attempt.unexplained()
    varies = np.ptp(level) > 1e-9 * np.abs(level).max(initial=0.0)
    return ({LEVEL: level} if varies else {}) | numbers, words


def _is_stated(values: FloatArray, given: Observations) -> bool:
    return bool(np.array_equal(values, given.sigma))


def _in_different_orders(numbers: Mapping[str, FloatArray]) -> tuple[dict[str, FloatArray], dict[str, list[str]]]:
    """Ranks by conditions without those that put the readings in the order of one before, and which these are."""
    kept: dict[str, FloatArray] = {}
    same_as: dict[str, list[str]] = {}
    for name, values in numbers.items():
        ranks = _ranks(values)
        first = next((each for each in kept if abs(float(kept[each] @ ranks)) > SAME_ORDER), None)
        if first is None:
            kept[name], same_as[name] = ranks, []
        else:
            same_as[first].append(name)
    return kept, same_as


def _ranks(values: FloatArray) -> FloatArray:
    """Centred ranks of unit length, ties at their mean."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(count) - 0.5 * (count + 1))[place.ravel()]
    ranks = ranks - ranks.mean()
    return np.asarray(ranks / (float(np.linalg.norm(ranks)) or 1.0))


def _p_of_rank(one: FloatArray, other: FloatArray) -> float:
    """Of a rank correlation, two-sided, by Student's t."""
    correlation, dof = float(one @ other), len(one) - 2
    t = abs(correlation) * np.sqrt(dof / max(1.0 - correlation**2, np.finfo(float).tiny))
    return float(2.0 * special.stdtr(dof, -t))


def _p_of_words(codes: FloatArray, ranks: FloatArray) -> float:
    """Of Kruskal and Wallis' statistic, by chi-square."""
    places = np.unique(codes, return_inverse=True)[1].ravel()
    count = np.bincount(places)
    statistic = (len(ranks) - 1) * float(np.sum(np.bincount(places, ranks) ** 2 / count))
    return float(special.chdtrc(len(count) - 1, statistic))


class _Sizes:
    """A sigma for each word."""

    def __init__(self, codes: FloatArray, size: FloatArray) -> None:
        self._known, places = np.unique(codes, return_inverse=True)
        square = np.bincount(places.ravel(), size**2) / np.bincount(places.ravel())
        self._sigma = np.sqrt(np.maximum(square, np.finfo(float).tiny))

    def of(self, codes: FloatArray) -> FloatArray:
        """The standard deviation there."""
        return np.asarray(self._sigma[np.searchsorted(self._known, codes)])

    def told(self, along: str, levels: Sequence[str], unit: _Unit) -> UnevenScatter:
        """As a finding."""
        pairs = zip(self._known, self._sigma, strict=True)
        return unit.told(along, by_word={levels[int(code)]: unit.scale * float(sigma) for code, sigma in pairs})


class _Law:
    """sigma = s exp(g z) at the greatest likelihood, z the condition in standard deviations from its mean."""

    def __init__(self, values: FloatArray, size: FloatArray) -> None:
        from scipy import optimize

        self._mean, self._spread = float(values.mean()), float(values.std())
        z = (values - self._mean) / self._spread
        most = _STEEPEST / float(np.abs(z).max())
        squares = np.maximum(size**2, np.finfo(float).tiny)

        def cost(growth: float) -> float:
            return float(special.logsumexp(np.log(squares) - 2.0 * growth * z))

        found = optimize.minimize_scalar(cost, bounds=(-most, most), method="bounded")
        self._growth = float(found.x)
        self._scale = float(np.sqrt(np.mean(squares * np.exp(-2.0 * self._growth * z))))
        # Noise with heavy tails tells its size less well than normal noise, whose squares have a variance of 2.
        even = squares / (self._scale * np.exp(self._growth * z)) ** 2
        self._sigma = float(np.sqrt(max(2.0, float(even.var())) / (z @ z)) / 2.0)
        self._ends = float(values.min()), float(values.max())

    def of(self, values: FloatArray | float) -> FloatArray:
        """The standard deviation there."""
        return np.asarray(self._scale * np.exp(self._growth * (np.asarray(values) - self._mean) / self._spread))

    def told(self, along: str, levels: Sequence[str], unit: _Unit) -> UnevenScatter:
        """As a finding."""
        del levels
        low, high = ((float(end), unit.scale * float(self.of(end))) for end in self._ends)
        ratio = high[1] / low[1]
        spread = self._sigma * (self._ends[1] - self._ends[0]) / self._spread
        growth = f"{self._growth / self._spread:.4g} * ({along} - {self._mean:.6g})"
        law = f"{unit.scale * self._scale:.4g} * exp({growth})"
        return unit.told(along, low=low, high=high, ratio=(ratio, ratio * spread), law=law)
