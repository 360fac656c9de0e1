"""What the derivatives of a model span: whether a function of the readings is among it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from rigctl.analysis.column_sums import LARGE
from rigctl.core.arrays import BoolArray, FloatArray, IntArray
from rigctl.experiments.table.model.start import span_of

SPANNED = 1e-7
"""A function is spanned by the model when less than this share of its norm lies outside."""

_FEW = 2048
# Of a square sum: hundredfold what counts as spanned, and a thousandfold what rounding leaves.
_FAR = 1e-12


class Functions:
    """Functions of the readings, (n, k) each, of which model after model is asked whether it spans them."""

    def __init__(self) -> None:
        self._all: list[FloatArray] = []
        self._joined = np.zeros((0, 0))

    def __len__(self) -> int:
        return len(self._all)

    def add(self, functions: Sequence[FloatArray]) -> range:
        """The places of further functions."""
        self._all += functions
        return range(len(self._all) - len(functions), len(self._all))

    def since(self, place: int) -> tuple[FloatArray, IntArray]:
        """All functions from a place on side by side, (n, columns), and each one's first column."""
        first = np.cumsum([0, *(each.shape[1] for each in self._all[place:])])
        if place:
            return np.concatenate(self._all[place:], axis=1), first[:-1]
        if self._joined.shape[1] != first[-1]:
            self._joined = np.concatenate(self._all, axis=1)
        return self._joined, first[:-1]


class Spanned:
    """The span of `jacobian` (n, m); its `basis` is (n, rank).

    Of a long table some rows are asked first: what is not spanned there is not spanned.
    """

    def __init__(self, jacobian: FloatArray) -> None:
        self.basis = span_of(jacobian)
        self.few: Spanned | None = Spanned(jacobian[some_of(self.rows)]) if self.rows > LARGE else None
        """The same of some rows of a long table, `some_of`."""
        self._held = np.zeros(0, dtype=bool)

    @property
    def rows(self) -> int:
        """Of the readings."""
        return len(self.basis)

    def holds(self, functions: FloatArray) -> bool:
        """Whether functions (n, k) lie in the span."""
        if self.few is None:
            return self._holds(functions)
        some = functions[some_of(self.rows)]
        if not self.few.holds(some):
            return False
        if np.ptp(some) == 0.0 and np.ptp(functions) == 0.0:
            return self._holds_constant
        return self._holds(functions)

    @cached_property
    def _holds_constant(self) -> bool:
        return self._holds(np.ones((self.rows, 1)))

    def held(self, functions: Functions, places: range) -> tuple[bool, ...]:
        """Which of some functions lie in the span, always the same collection; all that are new to it at once."""
        if len(self._held) < len(functions):
            self._held = np.concatenate([self._held, self._each_held(*functions.since(len(self._held)))])
        return tuple(self._held[places.start : places.stop].tolist())

    def _holds(self, functions: FloatArray) -> bool:
        return bool(self._each_held(functions, np.zeros(1, dtype=np.intp))[0])

    def _each_held(self, columns: FloatArray, first: IntArray) -> BoolArray:
        """Of functions side by side, each with a first column."""
        along = self.basis.T @ columns
        square = np.add.reduceat(np.einsum("nk,nk->k", columns, columns), first)
        inside = np.add.reduceat(np.einsum("rk,rk->k", along, along), first)
        # Mostly far outside, which a difference of squares tells in spite of its rounding.
        held = square - inside <= _FAR * square
        widths = np.diff([*first, columns.shape[1]])
        near = np.flatnonzero(np.repeat(held, widths))
        outside = columns[:, near] - self.basis @ along[:, near]
        left = np.zeros(columns.shape[1])
        left[near] = np.einsum("nk,nk->k", outside, outside)
        return np.asarray(held & (np.add.reduceat(left, first) <= SPANNED**2 * square))


def some_of(rows: int) -> IntArray:
    """Places of some rows, evenly spaced."""
    return np.linspace(0, rows - 1, _FEW).astype(np.intp)


def span_of_functions(functions: Sequence[FloatArray], rows: int) -> FloatArray:
    """A basis (n, t) of the span of some functions (n,), one after the other where they are long."""
    if not functions:
        return np.zeros((rows, 0))
    if rows <= LARGE:
        return span_of(np.stack(functions, axis=1))
    # Each function in one piece: a long one is read three times as fast.
    basis = np.array(functions)
    for place, function in enumerate(basis):
        earlier = basis[:place]
        # Twice is enough (Giraud, Langou and Rozloznik, Computers and Mathematics with Applications 50 (2005) 1069).
        for _ in range(2 if place else 0):
            function -= (earlier @ function) @ earlier
        function /= np.linalg.norm(function) or 1.0
    return basis.T
