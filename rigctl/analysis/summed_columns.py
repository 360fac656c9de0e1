"""The columns of a scan of a long table by sums alone: what `unit_columns` does with the columns at hand."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.column_sums import ColumnSums
from rigctl.analysis.sketch import Sketch
from rigctl.analysis.unit_columns import UnitColumns
from rigctl.core.arrays import FloatArray


class SummedScan:
    """Functions of a column less what an orthonormal `space` (rows, t) has of them; see `unit_columns.Scan`.

    The space is made whenever it is needed: many scans of a long table would keep gigabytes.
    """

    def __init__(self, functions: ColumnSums, rows: int, space: Callable[[], FloatArray]) -> None:
        self._functions, self._rows, self._space = functions, rows, space
        self._white: tuple[object, SummedColumns] | None = None

    @cached_property
    def rms(self) -> FloatArray:
        """Of each column, (choices, d)."""
        weight = np.ones(self._rows)
        whole = SummedColumns(self._functions, self._space, self._shadow, weight)
        return np.asarray(whole.size / np.sqrt(len(weight)))

    def of(self, place: int) -> FloatArray:
        """The columns of one choice, (rows, d)."""
        columns, space = self._functions.of(place), self._space()
        for _ in range(2 if space.shape[1] else 0):
            columns = columns - space @ (space.T @ columns)
        return columns

    def whitened(self, noise: object, whiten: Callable[[FloatArray], FloatArray]) -> SummedColumns:
        """The columns whitened by `whiten`, row by row, at unit length; kept while the same `noise` is asked for."""
        if self._white is None or self._white[0] is not noise:
            weight = whiten(np.ones((self._rows, 1)))[:, 0]
            self._white = noise, SummedColumns(self._functions, self._space, self._shadow, weight)
        return self._white[1]

    @cached_property
    def _shadow(self) -> FloatArray:
        """What the space has of each column, (t, choices, d)."""
        return self._functions.along(self._space())


class SummedColumns:
    """Functions less their `shadow` (t, choices, d) on a `space` (rows, t), times `weight` (rows,), brought to unit
    length; `size` (choices, d) is what they had. See `unit_columns.UnitColumns`."""

    def __init__(
        self, functions: ColumnSums, space_of: Callable[[], FloatArray], shadow: FloatArray, weight: FloatArray
    ) -> None:
        self.choices, self.dimension = functions.choices, functions.dimension
        self._functions, self._space, self._shadow = functions, space_of, shadow
        # Of readings that weigh alike one number is kept.
        self._weight = weight if np.ptp(weight) > 0.0 else weight[:1].copy()
        square, space = weight**2, space_of()
        crossed = functions.along(square[:, None] * space)
        across = np.einsum("tki,tkj->kij", shadow, crossed)
        own = space.T @ (square[:, None] * space)
        gram = functions.squares(square) - across - across.transpose(0, 2, 1)
        gram += np.einsum("tki,ts,skj->kij", shadow, own, shadow, optimize=True)
        self.size = np.sqrt(np.maximum(np.einsum("kii->ki", gram), 0.0))
        self._scale = 1.0 / np.where(self.size > 0.0, self.size, 1.0)
        self.gram: FloatArray = gram * self._scale[:, :, None] * self._scale[:, None, :]
        self._sketch: tuple[Sketch, UnitColumns] | None = None

    def along(self, vectors: FloatArray) -> FloatArray:
        """Products with vectors (rows, q), shape (q, choices, d)."""
        alike = len(self._weight) == 1
        weighted = vectors if alike else self._weight[:, None] * vectors
        beside = np.tensordot(weighted.T @ self._space(), self._shadow, axes=1)
        found = (self._functions.along(weighted) - beside) * self._scale
        return np.asarray(found * self._weight[0] if alike else found)

    def along_draws(self, draws: NDArray[np.float32], name: object) -> NDArray[np.float32]:
        """Products with draws of noise (draws, rows), shape (draws, d, choices)."""
        del name
        return self.along(draws.T.astype(np.float64)).astype(np.float32).transpose(0, 2, 1)

    def columns(self, place: int) -> FloatArray:
        """Of one choice, exactly but for its size, (rows, d)."""
        free = self._functions.of(place) - self._space() @ self._shadow[:, place]
        return np.asarray(self._weight[:, None] * free * self._scale[place])

    def sketched(self, sketch: Sketch) -> UnitColumns:
        """A sketch of them, kept for the last."""
        if self._sketch is None or self._sketch[0] is not sketch:
            space = sketch.of(self._weight[:, None] * self._space())
            weight = np.broadcast_to(self._weight, sketch.sign.shape)
            columns = self._functions.sketched(sketch, weight) - np.tensordot(space, self._shadow, axes=1)
            self._sketch = sketch, UnitColumns(columns)
        return self._sketch[1]
