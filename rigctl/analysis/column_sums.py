"""Functions of one column with each of many choices, by sums over the rows: no array of rows times choices is made.

Steps are sums of the readings past each place. Smooth functions (periods, rates) are interpolated between the nodes
of an even grid by six-point Lagrange polynomials: the rows are spread onto the grid once for all choices, as in a
non-uniform Fourier transform (Potts, Steidl and Tasche, in Modern Sampling Theory, 2001, 247).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator

import numpy as np
from scipy import sparse

from rigctl.analysis.sketch import Sketch
from rigctl.core.arrays import FloatArray

LARGE = 5000
"""Rows beyond which scans are sums."""

_POINTS = 6
_ROWS_AT_ONCE = 1 << 17
_CHOICES_AT_ONCE = 64
# Values of all choices at all nodes are kept up to so many: 64 MB.
_KEPT = 1 << 23


class ColumnSums(ABC):
    """Functions f (rows, choices, d) of a column, of which sums over the rows are asked."""

    choices: int
    dimension: int

    @abstractmethod
    def along(self, vectors: FloatArray) -> FloatArray:
        """Products with vectors (rows, q), shape (q, choices, d)."""

    @abstractmethod
    def squares(self, weight: FloatArray) -> FloatArray:
        """Sums of weight f f', weight (rows,), for each choice, (choices, d, d)."""

    @abstractmethod
    def sketched(self, sketch: Sketch, weight: FloatArray) -> FloatArray:
        """A sketch of weight f, shape (buckets, choices, d)."""

    @abstractmethod
    def of(self, place: int) -> FloatArray:
        """The functions of one choice, exactly, (rows, d)."""


class StepSums(ColumnSums):
    """1 where `values` (rows,) are past each of the rising `places`, else 0."""

    dimension = 1

    def __init__(self, values: FloatArray, places: FloatArray) -> None:
        self._values, self._places = values, places
        self.choices = len(places)
        # Of each row, how many places it is past.
        self._past = np.searchsorted(places, values, side="left").astype(np.int32)

    def along(self, vectors: FloatArray) -> FloatArray:
        """See `ColumnSums`."""
        sums = [np.bincount(self._past, vector, self.choices + 1) for vector in vectors.T]
        return self._beyond(np.array(sums, dtype=np.float64).reshape(-1, self.choices + 1))[:, :, None]

    def squares(self, weight: FloatArray) -> FloatArray:
        """See `ColumnSums`."""
        return np.asarray(self.along(weight[:, None])[0][:, :, None])

    def sketched(self, sketch: Sketch, weight: FloatArray) -> FloatArray:
        """See `ColumnSums`."""
        cell = sketch.bucket_of * (self.choices + 1) + self._past
        sums: FloatArray = np.asarray(
            np.bincount(cell, sketch.sign * weight, sketch.buckets * (self.choices + 1)), dtype=np.float64
        )
        return np.asarray(self._beyond(sums.reshape(sketch.buckets, -1))[:, :, None])

    def of(self, place: int) -> FloatArray:
        """See `ColumnSums`."""
        return np.asarray(self._values > self._places[place], dtype=np.float64)[:, None]

    def _beyond(self, sums: FloatArray) -> FloatArray:
        """Of each place, the sum of what is past it, from sums (k, choices + 1) of what lies between places."""
        return np.asarray(np.cumsum(sums[:, ::-1], axis=1)[:, ::-1][:, 1:])


class SmoothSums(ColumnSums):
    """Functions `at` (values (m,), places) -> (m, places, d) of a column's `values` (rows,), interpolated from so
    many `nodes` across their range."""

    def __init__(
        self,
        values: FloatArray,
        choices: int,
        at: Callable[[FloatArray, slice], FloatArray],
        nodes: int,
    ) -> None:
        self._values, self._at, self.choices = values, at, choices
        low, high = float(values.min()), float(values.max())
        self._low, self._distance = low, (high - low) / nodes
        # Three more on either side, so that every value has three nodes below and three above.
        self._nodes: FloatArray = low + self._distance * np.arange(-_POINTS // 2, nodes + _POINTS // 2 + 1.0)
        self._table: FloatArray | None = None
        self.dimension = at(self._nodes[:1], slice(0, 1)).shape[2]

    def along(self, vectors: FloatArray) -> FloatArray:
        """See `ColumnSums`."""
        spread = self._spread(vectors)
        return np.concatenate([np.tensordot(spread.T, table, axes=1) for table in self._tables()], axis=1)

    def squares(self, weight: FloatArray) -> FloatArray:
        """See `ColumnSums`."""
        spread = self._spread(weight[:, None])[:, 0]
        return np.concatenate(
            [np.einsum("m,mki,mkj->kij", spread, table, table, optimize=True) for table in self._tables()]
        )

    def sketched(self, sketch: Sketch, weight: FloatArray) -> FloatArray:
        """See `ColumnSums`."""
        shape = (sketch.buckets, len(self._nodes))
        at = (self._values - self._low) / self._distance + _POINTS // 2
        below = np.floor(at).astype(np.intp)
        share = at - below
        signed = sketch.sign * weight
        # Between two nodes along a line: as good as a sketch.
        to = np.tile(sketch.bucket_of, 2), np.concatenate([below, below + 1])
        onto = sparse.coo_matrix((np.concatenate([signed * (1.0 - share), signed * share]), to), shape).tocsr()
        blocks = []
        for table in self._tables():
            block: FloatArray = np.asarray(onto @ table.reshape(len(table), -1), dtype=np.float64)
            blocks.append(block.reshape(sketch.buckets, *table.shape[1:]))
        return np.concatenate(blocks, axis=1)

    def of(self, place: int) -> FloatArray:
        """See `ColumnSums`."""
        return self._at(self._values, slice(place, place + 1))[:, 0]

    def _tables(self) -> Iterator[FloatArray]:
        """The functions at the nodes, (nodes, choices, d), some choices at a time."""
        if self._table is not None:
            yield self._table
        elif len(self._nodes) * self.choices * self.dimension <= _KEPT:
            self._table = self._at(self._nodes, slice(0, self.choices))
            yield self._table
        else:
            for first in range(0, self.choices, _CHOICES_AT_ONCE):
                yield self._at(self._nodes, slice(first, first + _CHOICES_AT_ONCE))

    def _spread(self, vectors: FloatArray) -> FloatArray:
        """Sums at the nodes, (nodes, q), of vectors (rows, q) times each row's interpolation weights."""
        total = np.zeros((len(self._nodes), vectors.shape[1]))
        for first in range(0, len(vectors), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            at = (self._values[rows] - self._low) / self._distance
            cell = np.floor(at).astype(np.int32)
            # A node lies three before where it is counted from, and the first of a value's six two before that value.
            where = (cell + 1)[:, None] + np.arange(_POINTS, dtype=np.int32)
            weights = _lagrange(at - cell)
            ends = np.arange(0, weights.size + 1, _POINTS, dtype=np.int32)
            onto = sparse.csr_matrix((weights.ravel(), where.ravel(), ends), (len(at), len(total)))
            total += onto.T @ vectors[rows]
        return total


def _lagrange(beyond: FloatArray) -> FloatArray:
    """Weights (n, 6) of six nodes for values so far `beyond` (n,) the third of them, from 0 to 1."""
    powers = np.ones((_POINTS, len(beyond)))
    for power in range(1, _POINTS):
        np.multiply(powers[power - 1], beyond, out=powers[power])
    return np.asarray(powers.T @ _COEFFICIENTS)


def _coefficients() -> FloatArray:
    """Of the powers of that distance, (6, 6): each weight is 1 at its own node and 0 at the others."""
    nodes = np.arange(_POINTS) - 2.0
    return np.asarray(np.linalg.inv(np.vander(nodes, _POINTS, increasing=True)))


_COEFFICIENTS = _coefficients()
