"""One pool of data whose noise comes from the scatter: its scale, and how it is correlated along an order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.correlated_groups import CorrelatedGroups, Factor, log_determinant
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.kernels import SlowNoise
from rigctl.workbench.verdict.neighbours import Neighbours
from rigctl.workbench.verdict.noise import Correlation, orthonormal
from rigctl.workbench.verdict.offsets import in_units
from rigctl.workbench.verdict.pool_order import LARGEST_POOL, PoolOrder
from rigctl.workbench.verdict.saturated import MOST_ROUNDING, Hidden, rounding_of, saturated

RATIOS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
"""Variance of the correlated part over the white part."""

EXPONENT_RANGE = (0.5, 3.0)
LOG_RATIOS = (-7.0, 12.0)
"""Between which exponents and logarithms of ratios are maximised."""

WHITE_ODDS = 3.0
"""Prior odds of white noise over all correlated kinds together, where effects are searched for."""

EVEN_ODDS = 1.0
"""The same where a fitted parameter's uncertainty must not be too small (decision 078)."""

_LIKELIHOOD = 1e-6
# Of the white part: rounding of eigenvalues is not to bring less than nothing.
_LEAST_VARIANCE = 1e-9
_NEGLIGIBLE = 1e-3
# Where everything is fitted: F has no law without a degree of freedom.
_FLOOR_DOF = 1.0
# Of the largest reading, where none has a resolution: what a fit in double precision leaves of an exact curve.
_ROUNDING = 1e-14
WHITE = Correlation("", 0.0)

F = TypeVar("F", bound=np.floating)


class Pool:
    """One pool whose noise comes from the scatter."""

    def __init__(
        self,
        given: Observations,
        order: PoolOrder,
        required: FloatArray,
        possible: Callable[[IntArray], Sequence[Hidden]],
    ) -> None:
        self.order = order
        self.where = where = order.where
        rounding = rounding_of(required, where, given.sigma)
        seen = rounding < MOST_ROUNDING
        fitted = in_units(given, where, required[where][:, seen])
        hidden = [Hidden(in_units(given, where, each.columns), each.effect_of) for each in possible(where)]
        self.basis = saturated(fitted, hidden, rounding[seen])
        self.dof = max(len(where) - self.basis.shape[1], _FLOOR_DOF)
        exact = _ROUNDING * float(np.max(np.abs(given.value[where]) / given.sigma[where]))
        typical = float(np.sqrt(np.mean(given.sigma[where] ** 2)))
        self.least_scale: float = max(exact, given.pools[given.pool_of[where[0]]].least_sigma / typical)
        self._looks = [_Look(order, each, self.basis) for each in order.looked_at(self.basis.shape[1])]
        self._free = sum(each.free for each in self._looks)
        self._correlations = self._looks[0].correlations
        self._penalties = np.sum([each.penalties for each in self._looks], axis=0)

    def estimate(
        self, residuals: FloatArray, white_odds: float = WHITE_ODDS
    ) -> tuple[float, list[tuple[float, Correlation]]]:
        """Scale, and correlations with their weights, `residuals` (n,) in units of the given sigma.

        Weights are restricted likelihoods; white noise is `white_odds` times as likely beforehand as all other kinds.
        """
        return next(self.estimates(residuals[:, None], white_odds))

    def estimates(
        self, several: FloatArray, white_odds: float = WHITE_ODDS
    ) -> Iterator[tuple[float, list[tuple[float, Correlation]]]]:
        """The same of `several` residuals (n, k), one after the other."""
        if self._free <= 0:
            yield from [(1.0, [(1.0, WHITE)])] * several.shape[1]
            return
        least = max(self._free * self.least_scale**2, float(np.finfo(float).tiny))
        rss = np.sum([each.rss(several) for each in self._looks], axis=0)
        for residuals, each in zip(several.T, np.maximum(rss, least).T, strict=True):
            yield self._weighted(residuals, each, white_odds)

    def _weighted(
        self, residuals: FloatArray, rss: FloatArray, white_odds: float
    ) -> tuple[float, list[tuple[float, Correlation]]]:
        """Scale, and correlations with their weights, from the square sum of each trial."""
        # Minus twice the restricted log likelihood of each, at its own best scale.
        cost = self._free * np.log(rss) + self._penalties
        weight = np.exp(-0.5 * (cost - cost.min()))
        # The first trial is white noise; the others share what is left of the odds.
        weight[1:] /= white_odds * max(len(self._correlations) - 1, 1)
        weight = np.where(weight > _NEGLIGIBLE * weight.max(), weight, 0.0)
        # The mean is of covariances sigma^2 R, and each trial has a sigma of its own: rss over what is free.
        weight *= rss / weight.sum()
        scale = float(np.sqrt(weight.sum() / self._free))
        shares = weight / weight.sum()
        weighted = [(float(w), each) for w, each in zip(shares, self._correlations, strict=True) if w > 0.0]
        return scale if self.sees_all else self._scale_of_all(residuals, weighted), weighted

    def _scale_of_all(self, residuals: FloatArray, correlations: list[tuple[float, Correlation]]) -> float:
        """The scale that all data have in noise that a part of them has told."""
        groups = CorrelatedGroups(self._factors(correlations), len(self.where))
        white, basis = groups.solve(residuals), np.linalg.qr(groups.solve(self.basis))[0]
        left = white - basis @ (basis.T @ white)
        return max(float(np.sqrt(_square_sum(left) / self.dof)), self.least_scale)

    @property
    def tried(self) -> Sequence[Whitenings]:
        """The correlations that are tried, in what `seen` gives."""
        return self._looks[-1].tried

    @property
    def sees_all(self) -> bool:
        """Whether that is all data, each by itself."""
        return len(self._looks[-1].neighbours.first) == len(self.where)

    def seen(self, given: Observations, columns: FloatArray) -> FloatArray:
        """Columns (n, ...) of the data in units of the given sigma; of many data blocks of neighbours."""
        flat = in_units(given, self.where, columns[self.where].reshape(len(self.where), -1))
        return self._looks[-1].neighbours.of(flat.reshape(len(self.where), *columns.shape[1:]))

    def white_scale(self, residuals: FloatArray) -> float:
        """The scale if the noise were white, `residuals` in units of the given sigma."""
        if not self.sees_all:
            return self._scale_of_all(residuals, [])
        if self._free <= 0:
            return 1.0
        rss = float(self._looks[0].tried[0].rss(residuals[:, None])[0, 0])
        return max(float(np.sqrt(rss / self._free)), self.least_scale)

    def factors(self, correlations: list[tuple[float, Correlation]]) -> list[Factor]:
        """Cholesky factors of the weighted mean of R, group by group, and which data; none for white noise."""
        return [(self.where[members], factor) for members, factor in self._factors(correlations)]

    def _factors(self, correlations: list[tuple[float, Correlation]]) -> list[Factor]:
        told = [
            (weight, replace(each, ratio=self.order.strength(each.kernel, each.ratio)))
            for weight, each in correlations
        ]
        return self.order.factors(tuple(_strengths(told)))

    def slow(self, correlations: list[tuple[float, Correlation]]) -> SlowNoise | None:
        """The law of the weighted mean of R; None for white noise."""
        strengths = tuple(_strengths(correlations))
        if not strengths or self.order.name is None:
            return None
        return SlowNoise(self.where, self.order.name, strengths, self.order.time_scales)

    def likeliest(self, residuals: FloatArray, now: Correlation) -> tuple[float, Correlation]:
        """Scale and correlation of residuals, in units of the given sigma, at the least -2 log L of its kind."""
        best = now
        if now.kernel and len(residuals) <= LARGEST_POOL:
            best = self._likeliest_correlation(residuals, now)
        return self._scale_of(self._whitened(residuals, best)[0]), best

    def _scale_of(self, white: FloatArray) -> float:
        """The likeliest, of residuals without their correlation."""
        return max(float(np.sqrt(_square_sum(white) / len(white))), self.least_scale)

    def _likeliest_correlation(self, residuals: FloatArray, now: Correlation) -> Correlation:
        from scipy import optimize

        shortest, longest = self.order.time_scales
        # What is faster than that looks white to these data, and what is slower a level.
        low, high = (shortest / 4.0, 8.0 * longest) if now.kind == "exp" else EXPONENT_RANGE

        def correlation(place: FloatArray) -> Correlation:
            shape = float(np.clip(np.exp(place[1]), low, high))
            return Correlation(f"{now.kind} {shape!r}", float(np.exp(np.clip(place[0], *LOG_RATIOS))))

        def cost(each: Correlation) -> float:
            white, determinant = self._whitened(residuals, each)
            scale = self._scale_of(white)
            return 2.0 * len(white) * float(np.log(scale)) + _square_sum(white) / scale**2 + determinant

        def cost_at(place: FloatArray) -> float:
            return cost(correlation(place))

        start = [max(float(np.log(now.ratio)), LOG_RATIOS[0]), float(np.log(now.shape))]
        found = optimize.minimize(cost_at, start, method="Nelder-Mead", tol=_LIKELIHOOD)
        return min(now, correlation(np.asarray(found.x, dtype=np.float64)), key=cost)

    def _whitened(self, residuals: FloatArray, correlation: Correlation) -> tuple[FloatArray, float]:
        """Residuals without their correlation, and the logarithm of its determinant."""
        factors = self._factors([(1.0, correlation)])
        white = CorrelatedGroups(factors, len(residuals)).solve(residuals)
        return white, 2.0 * sum(log_determinant(factor) for _, factor in factors)


def _strengths(correlations: list[tuple[float, Correlation]]) -> list[tuple[str, float]]:
    """How strong each kernel is in the weighted mean of R."""
    strengths: dict[str, float] = {}
    for weight, each in correlations:
        if each.kernel:
            strengths[each.kernel] = strengths.get(each.kernel, 0.0) + weight * each.ratio
    return list(strengths.items())


def _square_sum(values: FloatArray) -> float:
    """Never 0: data without any scatter have a logarithm too."""
    return max(float(np.sum(np.square(values))), float(np.finfo(float).tiny))


class _Look:
    """Blocks of neighbouring data of a pool and the correlations that are tried in them, with what `saturates` all
    data projected out."""

    def __init__(self, order: PoolOrder, neighbours: Neighbours, saturates: FloatArray) -> None:
        self.neighbours = neighbours
        basis = orthonormal(neighbours.of(saturates), 1e-9)
        count = len(neighbours.first)
        self.free = count - basis.shape[1]
        self.tried = [Whitenings([WHITE], np.zeros((1, count)), None, basis)]
        for name in order.kernels:
            # One decomposition serves all strengths of a kernel: 1 + q K has the eigenvectors of K.
            strength, vectors = order.decomposed(name, neighbours)
            tried = [Correlation(name, q) for q in RATIOS]
            strengths = np.outer([order.strength(name, q) for q in RATIOS], strength)
            self.tried.append(Whitenings(tried, strengths, vectors, basis))
        self.correlations = [each for tried in self.tried for each in tried.correlations]
        self.penalties = np.concatenate([tried.penalty for tried in self.tried])

    def rss(self, residuals: FloatArray) -> FloatArray:
        """Weighted square sums of what is left of `residuals` (pool, k) by each correlation, (correlations, k)."""
        here = self.neighbours.of(residuals)
        return np.concatenate([tried.rss(here) for tried in self.tried])


class Whitenings:
    """Correlations R = U (1 + strength) U' with one U, and what restricted likelihood needs of them.

    `strengths` (trials, n); `vectors` U, None for the unit matrix.
    """

    def __init__(
        self,
        correlations: Sequence[Correlation],
        strengths: FloatArray,
        vectors: FloatArray | None,
        basis: FloatArray,
    ) -> None:
        self.correlations = correlations
        self._vectors = vectors
        self._precision = 1.0 / np.maximum(1.0 + strengths, _LEAST_VARIANCE)
        self._basis = basis if vectors is None else vectors.T @ basis
        grams = np.stack([self._basis.T @ (each[:, None] * self._basis) for each in self._precision])
        self._inverse = np.linalg.inv(grams)
        self.penalty = np.linalg.slogdet(grams)[1] - np.sum(np.log(self._precision), axis=1)

    def turned(self, columns: NDArray[F]) -> NDArray[F]:
        """U' columns, shape (n, ...), as precise as these."""
        if self._vectors is None:
            return columns
        return np.tensordot(self._vectors.astype(columns.dtype), columns, axes=(0, 0))

    def turned_back(self, columns: NDArray[F]) -> NDArray[F]:
        """U columns, shape (n, k), as precise as these."""
        return columns if self._vectors is None else self._vectors.astype(columns.dtype) @ columns

    def coloured(self, white: FloatArray, scale: FloatArray) -> FloatArray:
        """Noise of which `scale` (n,) makes turned data white, from white noise (n, draws).

        By the symmetric root of R, the same whichever way the eigenvectors point.
        """
        turned = self.turned(white) / scale[:, None]
        return turned if self._vectors is None else self._vectors @ turned

    def strengths(self) -> Iterator[tuple[FloatArray, float]]:
        """Of each trial what makes turned data white, (n,), and the logarithm of the determinant of R."""
        for precision in self._precision:
            yield np.sqrt(precision), -float(np.sum(np.log(precision)))

    def rss(self, residuals: FloatArray) -> FloatArray:
        """Weighted square sums of what the saturated design leaves of `residuals` (n, k), (trials, k)."""
        turned = self.turned(residuals)
        weighted = self._precision[:, :, None] * turned
        along = self._basis.T @ weighted
        taken = np.sum(along * (self._inverse @ along), axis=1)
        return np.asarray(np.sum(weighted * turned, axis=1) - taken)
