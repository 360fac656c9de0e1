"""Functions of the data with each of many choices, by their moments: what a scan of a period or a place needs."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.core.arrays import FloatArray

_NAMES_KEPT = 2


class UnitColumns:
    """Columns (n, choices, d) brought to unit length; `size` (choices, d) is what they had.

    What is asked of them are sums over the rows, so that a choice costs no array of its own.
    """

    def __init__(self, columns: FloatArray) -> None:
        n, self.choices, self.dimension = columns.shape
        self.size = np.linalg.norm(columns, axis=0)
        self._columns = (columns / np.where(self.size > 0.0, self.size, 1.0)).reshape(n, -1)
        self._drawn: dict[object, NDArray[np.float32]] = {}
        self._made_again: Callable[[int], FloatArray] | None = None

    @cached_property
    def gram(self) -> FloatArray:
        """Products of each choice's columns with each other, (choices, d, d)."""
        return np.asarray(np.einsum("nki,nkj->kij", self.stack, self.stack, optimize=True))

    def along(self, vectors: FloatArray) -> FloatArray:
        """Products with vectors (n, q), shape (q, choices, d)."""
        return (vectors.T @ self._columns).reshape(-1, self.choices, self.dimension)

    def along_draws(self, draws: NDArray[np.float32], name: object) -> NDArray[np.float32]:
        """Products with draws of noise (draws, n), shape (draws, d, choices); kept for the last two by `name`."""
        if name not in self._drawn:
            # Draws that all models share, and one model's permuted residuals, are asked for in turn.
            while len(self._drawn) >= _NAMES_KEPT:
                del self._drawn[next(iter(self._drawn))]
            # Single precision: draws tell the number of trials to 16 % only, and are the largest arrays there are.
            columns = self.stack.transpose(0, 2, 1).astype(np.float32)
            self._drawn[name] = draws @ columns.reshape(len(columns), -1)
        # The last asked for is the last to go.
        self._drawn[name] = self._drawn.pop(name)
        return self._drawn[name].reshape(-1, self.dimension, self.choices)

    def columns(self, place: int) -> FloatArray:
        """Of one choice, (n, d)."""
        if self._made_again is None:
            return self.stack[:, place]
        return self._made_again(place) / np.where(self.size[place] > 0.0, self.size[place], 1.0)

    def let_go(self, made_again: Callable[[int], FloatArray]) -> None:
        """Keep the moments that have been asked for, and no columns: those of one choice as they were given, (n, d),
        are `made_again` when they are asked for."""
        self._columns, self._made_again = self._columns[:0].copy(), made_again

    @property
    def stack(self) -> FloatArray:
        """Of all choices, (n, choices, d)."""
        return self._columns.reshape(-1, self.choices, self.dimension)


class Scan:
    """Derivatives of the data by an effect's parameters with each of its choices, `columns` (n, choices, d)."""

    def __init__(self, columns: FloatArray) -> None:
        self.columns = columns
        self._white: tuple[object, UnitColumns] | None = None

    @cached_property
    def rms(self) -> FloatArray:
        """Of each column, (choices, d)."""
        return np.asarray(np.sqrt(np.mean(self.columns**2, axis=0)))

    def of(self, place: int) -> FloatArray:
        """The columns of one choice, (n, d)."""
        return self.columns[:, place]

    def whitened(self, noise: object, whiten: Callable[[FloatArray], FloatArray]) -> UnitColumns:
        """The columns whitened by `whiten`, at unit length; kept for as long as the same `noise` is asked for."""
        if self._white is None or self._white[0] is not noise:
            flat = self.columns.reshape(len(self.columns), -1)
            self._white = noise, UnitColumns(whiten(flat).reshape(self.columns.shape))
        return self._white[1]
