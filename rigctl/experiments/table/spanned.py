"""What the derivatives of a model span: whether a function of the readings is among it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from rigctl.analysis.column_sums import LARGE
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.experiments.table.model.start import span_of

SPANNED = 1e-7
"""A function is spanned by the model when less than this share of its norm lies outside."""

_FEW = 2048
# Of a square sum: hundredfold what counts as spanned, and a thousandfold what rounding leaves.
_FAR = 1e-12


class Spanned:
    """The span of `jacobian` (n, m); its `basis` is (n, rank).

    Of a long table some rows are asked first: what is not spanned there is not spanned.
    """

    def __init__(self, jacobian: FloatArray) -> None:
        self.basis = span_of(jacobian)
        self.few: Spanned | None = Spanned(jacobian[some_of(self.rows)]) if self.rows > LARGE else None
        """The same of some rows of a long table, `some_of`."""

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

    def _holds(self, functions: FloatArray) -> bool:
        along, square = self.basis.T @ functions, np.vdot(functions, functions)
        # Mostly far outside, which a difference of squares tells in spite of its rounding.
        if square - np.vdot(along, along) > _FAR * square:
            return False
        outside = functions - self.basis @ along
        return bool(np.linalg.norm(outside) <= SPANNED * np.linalg.norm(functions))


def some_of(rows: int) -> IntArray:
    """Places of some rows, evenly spaced."""
    return np.linspace(0, rows - 1, _FEW).astype(np.intp)


def span_of_functions(functions: Sequence[FloatArray], rows: int) -> FloatArray:
    """A basis (n, t) of the span of some functions (n,), one after the other where they are long."""
    if not functions:
        return np.zeros((rows, 0))
    columns = np.stack(functions, axis=1)
    if rows <= LARGE:
        return span_of(columns)
    for place in range(columns.shape[1]):
        column, earlier = columns[:, place], columns[:, :place]
        # Twice is enough (Giraud, Langou and Rozloznik, Computers and Mathematics with Applications 50 (2005) 1069).
        for _ in range(2 if place else 0):
            column -= earlier @ (earlier.T @ column)
        column /= np.linalg.norm(column) or 1.0
    return columns
