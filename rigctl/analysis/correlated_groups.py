"""Data that are correlated in groups: their correlation R = L L' by its Cholesky factors, group by group."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy import sparse

from rigctl.analysis.triangle_solve import solve_lower
from rigctl.core.arrays import FloatArray, IntArray

Factor = tuple[IntArray, FloatArray]
"""Which data a group has, (k,), and the lower triangle of its correlation, (k, k)."""

MANY = 16
"""So many groups that have no datum in common are one sparse matrix: a call for each would take longer."""


class CorrelatedGroups:
    """L of all groups, one after the other in the order of `factors`; `count` data in all.

    Columns are (count,) or (count, k), and stay as they are; without groups they come back themselves.
    """

    def __init__(self, factors: Sequence[Factor], count: int) -> None:
        self._parts = [
            _Together(groups, count) if len(groups) >= MANY else _OneByOne(groups)
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
        return self._each(columns, solve_lower)

    def solve_transposed(self, columns: FloatArray) -> FloatArray:
        return self._each(columns, partial(solve_lower, transposed=True))

    def times(self, columns: FloatArray) -> FloatArray:
        return self._each(columns, lambda factor, own: factor @ own)

    def transposed_times(self, columns: FloatArray) -> FloatArray:
        return self._each(columns, lambda factor, own: factor.T @ own)

    def _each(self, columns: FloatArray, turn: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
        turned = columns.astype(np.float64)
        for members, factor in self._factors:
            own = turned[members]
            # Many columns concern a few of the groups.
            used = np.flatnonzero(own.any(axis=0)) if own.ndim > 1 else None
            if used is None or len(used) == own.shape[1]:
                turned[members] = turn(factor, own)
            elif len(used):
                turned[members[:, None], used] = turn(factor, own[:, used])
        return turned


class _Together:
    """Many groups without a datum in common, as sparse matrices; others' rows are those of the identity."""

    def __init__(self, factors: Sequence[Factor], count: int) -> None:
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
