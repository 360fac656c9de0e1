"""Score tests of candidates on the residuals, with all fitted parameters free to move.

Whitened and linearised at a fit, z = W (y - f), J = W df/dp (priors are further rows), M = 1 - J J^+: the columns G
of a candidate count as far as no fitted parameter can imitate them. With Q an orthonormal basis of M G, T = |Q' z|^2
is to first order the fall of chi-square after adding the candidate and fitting everything again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from rigctl.analysis.decomposition import svd
from rigctl.analysis.lengths import lengths
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.verdict.noise import orthonormal

ABSORBED = 1e-2
"""Share of a column that no fitted parameter imitates, below which effects of second order dominate."""

# Relative singular value of unit columns: the same at which a fit calls a direction undetermined.
UNDETERMINED = 1e-8


@dataclass(frozen=True)
class Score:
    """The score test of one candidate.

    `statistic` T with `dimension` d and the noise's `dof`; `keep` per parameter; `estimate` and `sigma` (d,) at first
    order, 0 and infinity for parameters that are absorbed; `of` gives the basis.
    """

    statistic: float
    dimension: int
    dof: float
    p_value: float
    keep: FloatArray
    estimate: FloatArray
    sigma: FloatArray
    of: Callable[[], FloatArray]

    @property
    def basis(self) -> FloatArray:
        """Q, shape (n, d); d is 0 when all is absorbed."""
        return self.of()


class Projector:
    """The projection M orthogonal to the derivatives by the fitted parameters, for whitened data at a fit."""

    def __init__(
        self,
        jacobian: FloatArray,
        residuals: FloatArray,
        dof: FloatArray,
        data: int,
        between: Sequence[tuple[FloatArray, float]] = (),
    ) -> None:
        self.basis = orthonormal(jacobian, UNDETERMINED)
        self.left = self.free(residuals)
        self.data = data
        self._dof = dof
        self._between = between
        self.one_dof = float(dof[0]) if not between and dof.size and np.all(dof == dof[0]) else None

    def free(self, columns: FloatArray) -> FloatArray:
        """M columns."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def score(self, columns: FloatArray) -> Score:
        """Of a candidate's whitened columns (n, d)."""
        return self._score(columns, self.free(columns))

    def scores(self, candidates: Sequence[FloatArray]) -> list[Score]:
        """Of several, projected together."""
        ends = np.cumsum([columns.shape[1] for columns in candidates])[:-1]
        free = np.split(self.free(np.hstack(candidates)), ends, axis=1)
        return list(map(self._score, candidates, free))

    def _score(self, columns: FloatArray, free: FloatArray) -> Score:
        # Parameters' units differ by powers of ten: everything below is in columns of unit length.
        size = lengths(columns)
        keep = lengths(free) / np.where(size > 0.0, size, 1.0)
        seen = np.flatnonzero(keep > ABSORBED)
        estimate, sigma = np.zeros(len(size)), np.full(len(size), np.inf)
        if not len(seen):
            return Score(0.0, 0, np.inf, 1.0, keep, estimate, sigma, lambda: np.zeros((len(columns), 0)))
        left, s, right = _decomposed(free[:, seen] / size[seen])
        determined = s > ABSORBED * s[0]
        basis = left[:, determined]
        along = basis.T @ self.left
        root = right[determined].T / s[determined]
        estimate[seen] = root @ along / size[seen]
        sigma[seen] = np.sqrt(np.sum(root**2, axis=1)) / size[seen]
        statistic, dimension = float(along @ along), int(determined.sum())
        dof = self.dof_of(basis)
        p_value = float(p_of(statistic, dimension, dof))
        return Score(statistic, dimension, dof, p_value, keep, estimate, sigma, lambda: basis)

    def statistics(self, columns: FloatArray, counts: Sequence[int]) -> list[tuple[float, int]]:
        """Statistic and dimension of each of many candidates; their whitened columns, so many each, are side by side.

        From products of the columns alone, which takes a tenth of the time of scores.
        """
        shadow = self.basis.T @ columns
        size = lengths(columns)
        size = np.where(size > 0.0, size, 1.0)
        gram = (columns.T @ columns - shadow.T @ shadow) / np.outer(size, size)
        along, found = (columns.T @ self.left) / size, list[tuple[float, int]]()
        for last, count in zip(np.cumsum(counts), counts, strict=True):
            own = slice(last - count, last)
            seen = np.diag(gram)[own] > ABSORBED**2
            square, turn = np.linalg.eigh(gram[own, own][np.ix_(seen, seen)])
            determined = square > ABSORBED**2 * square.max(initial=0.0)
            parts = (turn[:, determined].T @ along[own][seen]) ** 2 / square[determined]
            found.append((float(parts.sum()), len(parts)))
        return found

    @cached_property
    def _of_dof(self) -> list[tuple[float, IntArray]]:
        """The data whose noise is known from so many degrees of freedom each."""
        known = np.unique(self._dof[np.isfinite(self._dof)])
        return [(float(dof), np.flatnonzero(self._dof == dof)) for dof in known]

    def dof_of(self, basis: FloatArray) -> float:
        """Degrees of freedom of the noise that a statistic on `basis` meets (Satterthwaite)."""
        return float(self.dof_of_each(basis[:, None, :])[0])

    def dof_of_each(self, bases: FloatArray) -> FloatArray:
        """The same for many bases (n, k, d); of what varies between shared offsets, these are the degrees."""
        if self.one_dof is not None:
            return np.full(bases.shape[1], self.one_dof)
        share = np.sum(bases[: self.data] ** 2, axis=2)
        spread = np.zeros(share.shape[1])
        for dof, members in self._of_dof:
            spread += np.sum(share[members], axis=0) ** 2 / dof
        total = np.sum(share, axis=0)
        for frame, dof in self._between:
            inside = np.einsum("ng,nkd->gkd", frame, bases[: self.data], optimize=True)
            # What varies between offsets only has no more degrees than there are offsets: the fewer count.
            spread = np.maximum(spread, np.sum(inside**2, axis=(0, 2)) ** 2 / dof)
        none = spread > 0.0
        return np.where(none, total**2 / np.where(none, spread, 1.0), np.inf)


def _decomposed(columns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The singular value decomposition; of one column it is its length."""
    if columns.shape[1] > 1:
        return svd(columns)
    length = float(np.linalg.norm(columns))
    return columns / length, np.array([length]), np.ones((1, 1))


def p_of(statistic: FloatArray | float, dimension: IntArray | float, dof: FloatArray | float) -> FloatArray:
    """Probability of a larger T: F(d, dof), chi-square where the noise is known."""
    d = np.maximum(dimension, 1)
    exact = special.chdtrc(d, statistic)
    # Both tails are worked out for all; that of F has no infinite degrees of freedom.
    nu = np.minimum(dof, 1e9)
    return np.asarray(np.where(np.isfinite(dof), special.fdtrc(d, nu, np.asarray(statistic) / d), exact))


def smallest_p(statistics: NDArray[np.floating], dimensions: IntArray) -> FloatArray:
    """Smallest p of each draw, from statistics (draws, trials); of no dimensions is no trial."""
    smallest = np.ones(len(statistics))
    for d in np.unique(dimensions[dimensions > 0]):
        # Of equal dimension the largest has the smallest p: one tail is worked out instead of all.
        alike = dimensions == d
        largest = (statistics if alike.all() else statistics[:, alike]).max(axis=1)
        smallest = np.minimum(smallest, _chi_square_tail(int(d), largest.astype(np.float64)))
    return smallest


def _chi_square_tail(d: int, statistics: FloatArray) -> FloatArray:
    """Probability of a larger chi-square of d degrees of freedom."""
    if d > 1:
        return np.asarray(special.chdtrc(d, statistics))
    # In closed form: the general one takes thirty times as long, and is asked for in every draw. Rounding may leave a
    # statistic a little below zero.
    return np.asarray(special.erfc(np.sqrt(0.5 * np.maximum(statistics, 0.0))))


def corrected(p_value: float, n_eff: float) -> float:
    """The probability that the smallest of so many trials is as small as that."""
    # Sidak's formula, in a form that keeps small probabilities exact.
    return float(-np.expm1(n_eff * np.log1p(-min(p_value, 1.0 - 1e-16))))


def single(corrected_p: float, n_eff: float) -> float:
    """The p-value of one of so many trials that is `corrected` to this."""
    return float(-np.expm1(np.log1p(-min(corrected_p, 1.0 - 1e-16)) / n_eff))


def likeness(a: FloatArray, b: FloatArray) -> float:
    """Canonical correlation of two candidates: the cosine of the smallest angle between their spans."""
    if not a.shape[1] or not b.shape[1]:
        return 0.0
    return float(svd(a.T @ b)[1][0])


def contained(inner: FloatArray, outer: FloatArray) -> float:
    """How far the span of `inner` lies within that of `outer`: the cosine of the largest angle."""
    if not inner.shape[1] or inner.shape[1] > outer.shape[1]:
        return 0.0
    return float(svd(inner.T @ outer)[1][-1])


def contained_at_most(bases: Sequence[FloatArray]) -> FloatArray:
    """Of each of some orthonormal `bases` (n, d) a bound on how far it lies within each other one, (bases, bases)."""
    if not bases:
        return np.zeros((0, 0))
    dimensions = np.array([each.shape[1] for each in bases])
    joined = np.hstack(bases)
    first = np.concatenate([[0], np.cumsum(dimensions)[:-1]])
    # The mean squared cosine is no less than the smallest, and needs no singular values.
    overlap = np.add.reduceat(np.add.reduceat((joined.T @ joined) ** 2, first, axis=0), first, axis=1)
    return np.asarray(np.sqrt(overlap / dimensions[:, None]))
