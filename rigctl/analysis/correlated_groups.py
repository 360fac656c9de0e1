"""Data that are correlated in groups: their correlation R = L L' by its Cholesky factors, group by group."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy import sparse

from rigctl.analysis.relaxation_factor import RelaxationFactor
from rigctl.analysis.triangle_solve import solve_lower
from rigctl.core.arrays import FloatArray, IntArray

Triangle = FloatArray | RelaxationFactor
"""The lower triangle of a correlation, (k, k)."""

Factor = tuple[IntArray, Triangle]
"""Which data a group has, (k,), and the triangle of its correlation."""

MANY = 16
"""So many groups that have no datum in common are one sparse matrix: a call for each would take longer."""


class CorrelatedGroups:
    """L of all groups, one after the other in the order of `factors`; `count` data in all.

    Columns are (count,) or (count, k), and stay as they are; without groups they come back themselves.
    """

    def __init__(self, factors: Sequence[Factor], count: int) -> None:
        self._parts = [
            _OneByOne(groups) if (small := _matrices(groups)) is None else _Together(small, count)
            for groups in _apart(factors, count)
        ]

    def solve(self, columns: FloatArray) -> FloatArray:
        """L^-1 columns: independent where columns are correlated like this."""
        for part in self._parts:
            columns = part.solve(columns)
        return columns

    def solve_transposed(self, columns: FloatArray) -> FloatArray:
        """L'^-1 columns."""
        for part in reversed(self._parts):
            columns = part.solve_transposed(columns)
        return columns

    def times(self, columns: FloatArray) -> FloatArray:
        """L columns, the inverse of `solve`."""
        for part in reversed(self._parts):
            columns = part.times(columns)
        return columns

    def transposed_times(self, columns: FloatArray) -> FloatArray:
        """L' columns."""
        for part in self._parts:
            columns = part.transposed_times(columns)
        return columns


def log_determinant(triangle: Triangle) -> float:
    """Of a triangle."""
    if isinstance(triangle, RelaxationFactor):
        return triangle.log_determinant()
    return float(np.sum(np.log(np.diag(triangle))))


def variances(triangle: Triangle) -> FloatArray:
    """The diagonal of L L', (k,)."""
    return triangle.variances if isinstance(triangle, RelaxationFactor) else np.sum(triangle**2, axis=1)


def _matrices(factors: Sequence[Factor]) -> list[tuple[IntArray, FloatArray]] | None:
    """The factors of many groups that are plain matrices; None for others."""
    plain = [(where, each) for where, each in factors if not isinstance(each, RelaxationFactor)]
    return plain if len(plain) == len(factors) >= MANY else None


def _apart(factors: Sequence[Factor], count: int) -> list[list[Factor]]:
    """The factors in their order, cut where a group shares data with one since the last cut."""
    parts: list[list[Factor]] = []
    taken = np.ones(count, dtype=bool)
    for members, factor in factors:
        if taken[members].any():
            parts.append([])
            taken = np.zeros(count, dtype=bool)
        taken[members] = True
        parts[-1].append((members, factor))
    return parts


class _OneByOne:
    """Few groups, each with a triangle of its own."""

    def __init__(self, factors: Sequence[Factor]) -> None:
        self._factors = factors

    def solve(self, columns: FloatArray) -> FloatArray:
        return self._each(columns, RelaxationFactor.solve, solve_lower)

    def solve_transposed(self, columns: FloatArray) -> FloatArray:
        return self._each(columns, RelaxationFactor.solve_transposed, partial(solve_lower, transposed=True))

    def times(self, columns: FloatArray) -> FloatArray:
        return self._each(columns, RelaxationFactor.times, lambda factor, own: factor @ own)

    def transposed_times(self, columns: FloatArray) -> FloatArray:
        return self._each(columns, RelaxationFactor.transposed_times, lambda factor, own: factor.T @ own)

    def _each(
        self,
        columns: FloatArray,
        of_relaxations: Callable[[RelaxationFactor, FloatArray], FloatArray],
        of_matrix: Callable[[FloatArray, FloatArray], FloatArray],
    ) -> FloatArray:
        turned = columns.astype(np.float64)
        for members, factor in self._factors:
            own = turned[members]
            if isinstance(factor, RelaxationFactor):
                turned[members] = of_relaxations(factor, own)
                continue
            # Many columns concern a few of the groups.
            used = np.flatnonzero(own.any(axis=0)) if own.ndim > 1 else None
            if used is None or len(used) == own.shape[1]:
                turned[members] = of_matrix(factor, own)
            elif len(used):
                turned[members[:, None], used] = of_matrix(factor, own[:, used])
        return turned


class _Together:
    """Many groups without a datum in common, as sparse matrices; others' rows are those of the identity."""

    def __init__(self, factors: Sequence[tuple[IntArray, FloatArray]], count: int) -> None:
        triangles = [factor for _, factor in factors]
        inverses = [solve_lower(each, np.eye(len(each))) for each in triangles]
        members = [where for where, _ in factors]
        self._triangle, self._inverse = (_joined(members, blocks, count) for blocks in (triangles, inverses))

    def solve(self, columns: FloatArray) -> FloatArray:
        return np.asarray(self._inverse @ columns)

    def solve_transposed(self, columns: FloatArray) -> FloatArray:
        return np.asarray(self._inverse.T @ columns)

    def times(self, columns: FloatArray) -> FloatArray:
        return np.asarray(self._triangle @ columns)

    def transposed_times(self, columns: FloatArray) -> FloatArray:
        return np.asarray(self._triangle.T @ columns)


def _joined(members: Sequence[IntArray], blocks: Sequence[FloatArray], count: int) -> sparse.csr_matrix:
    alone = np.setdiff1d(np.arange(count), np.concatenate(members))
    down = [np.repeat(where, len(where)) for where in members]
    across = [np.tile(where, len(where)) for where in members]
    values = np.concatenate([*(block.ravel() for block in blocks), np.ones(len(alone))])
    places = np.concatenate([*down, alone]), np.concatenate([*across, alone])
    joined = sparse.csr_matrix((values, places), (count, count))
    joined.eliminate_zeros()
    return joined
