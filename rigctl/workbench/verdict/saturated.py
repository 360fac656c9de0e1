"""The saturated design: all that is fitted and what might be hidden, as far as the data have room for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from rigctl.analysis.decomposition import svd
from rigctl.core.arrays import BoolArray, FloatArray, IntArray
from rigctl.workbench.verdict.noise import orthonormal

# With a third left the estimate scattered twice as much, and the power was halved (decision 014).
SATURATED_SHARE = 2.0 / 3.0
"""At least this share of a pool's data is left to tell its noise."""

# Of a column of unit length: what is left less of lies in the span already.
_INDEPENDENT = 1e-3
# Of a length: columns that are centred already are all as long, and rounding is not to choose between them.
_EARLIER = 1e-7
ROUNDING = 1e-9
"""Of a column's length: the rounding of a derivative by differences, at most."""

MOST_ROUNDING = 1e-3
"""Of a part of a column: with more of it the part says nothing."""

_SURE = 10.0
"""Columns with no more than so many times that rounding are told apart together."""


@dataclass(frozen=True)
class Hidden:
    """What might be hidden: `columns` (data, k), and which of several effects each belongs to, (k,), rising."""

    columns: FloatArray
    effect_of: IntArray

    @classmethod
    def of(cls, effects: Sequence[tuple[FloatArray, bool]], data: int) -> Hidden:
        """Columns (data, d), and whether they are one effect or each is one."""
        columns = np.hstack([np.zeros((data, 0)), *(each for each, _ in effects)])
        begins = [np.arange(each.shape[1]) * (not whole) == np.arange(each.shape[1]) for each, whole in effects]
        return cls(columns, np.cumsum(np.concatenate([np.zeros(0), *begins]), dtype=np.intp))

    def keep(self, columns: FloatArray, kept: BoolArray) -> Hidden:
        """The columns that are kept, at other data or in other units."""
        return Hidden(columns[:, kept], self.effect_of[kept])


def saturated(required: FloatArray, possible: Sequence[Hidden], rounding: FloatArray | None = None) -> FloatArray:
    """Orthonormal basis of all that is fitted and, as far as enough data remain, of all that might be hidden.

    Each of the `required` columns is known to `rounding` of its length, if that is given. `possible` in the order of
    precedence; what finds no room there stays in the noise estimate. An effect goes in
    with all of its span or not at all: of words the choice would else depend on which the others are counted from.
    """
    data = len(required)
    basis = orthonormal(required, ROUNDING) if rounding is None else _beyond_rounding(required, rounding)
    # At least eight are left: below, a scale says next to nothing.
    most = int(min(data * (1.0 - SATURATED_SHARE), data - 8))
    for hidden in possible:
        room = most - basis.shape[1]
        norms = np.linalg.norm(hidden.columns, axis=0)
        if room > 0 and norms.any():
            seen = norms > 0.0
            unit = hidden.columns / np.where(seen, norms, 1.0)
            basis = np.hstack([basis, _further(basis, hidden.keep(unit, seen), room)])
    return basis


def _beyond_rounding(required: FloatArray, rounding: FloatArray) -> FloatArray:
    """Orthonormal basis of what the required columns are but for their rounding.

    A column that is another one but for its rounding would add a direction that is rounding only.
    """
    sure = rounding <= _SURE * ROUNDING
    basis = orthonormal(required[:, sure], ROUNDING)
    for number in sorted(np.flatnonzero(~sure), key=lambda each: rounding[each]):
        column = required[:, number]
        left = column - basis @ (basis.T @ column)
        left -= basis @ (basis.T @ left)
        length = float(np.linalg.norm(left))
        if length > rounding[number] * np.linalg.norm(column):
            basis = np.column_stack([basis, left / length])
    return basis


def _further(basis: FloatArray, hidden: Hidden, room: int) -> FloatArray:
    """What effects of unit columns add to a basis, those first that add most by direction, while there is room."""
    first, widths = np.unique(hidden.effect_of, return_index=True, return_counts=True)[1:]
    left = hidden.columns
    if widths.max() == 1:
        # With pivoting the columns that add most come first.
        left = (left - basis @ (basis.T @ left)) * (1.0 - _EARLIER * np.arange(left.shape[1]))
        further, triangle, _ = qr(left, mode="economic", pivoting=True)
        return np.asarray(further[:, : min(room, int(np.sum(np.abs(np.diag(triangle)) > _INDEPENDENT)))])
    spans = [
        orthonormal(left[:, a : a + width], _INDEPENDENT) if width > 1 else left[:, [a]]
        for a, width in zip(first, widths, strict=True)
    ]
    left, widths = np.hstack(spans), np.array([span.shape[1] for span in spans])
    left = left - basis @ (basis.T @ left)
    first = np.concatenate([[0], np.cumsum(widths)[:-1]])
    taken, waiting = [np.zeros((len(basis), 0))], np.ones(len(spans), dtype=bool)
    while room > 0:
        share = np.add.reduceat(np.sum(left**2, axis=0), first) / widths * (1.0 - _EARLIER * np.arange(len(spans)))
        place = int(np.argmax(np.where(waiting, share, 0.0)))
        if not waiting[place] or share[place] <= _INDEPENDENT**2:
            break
        waiting[place] = False
        directions, size, _ = svd(left[:, first[place] : first[place] + widths[place]])
        added = directions[:, size > _INDEPENDENT]
        if added.shape[1] <= room:
            room -= added.shape[1]
            taken.append(added)
            left = left - added @ (added.T @ left)
    return np.hstack(taken)


def rounding_of(columns: FloatArray, where: IntArray, sigma: FloatArray) -> FloatArray:
    """Of the columns (n, k) at some of the data the share that the rounding of numerical derivatives may be, (k,)."""
    whole = np.linalg.norm(columns / sigma[:, None], axis=0)
    here = np.linalg.norm(columns[where] / sigma[where][:, None], axis=0)
    return np.asarray(ROUNDING * np.divide(whole, here, out=np.full(len(here), np.inf), where=here > 0.0))


def above_rounding(columns: FloatArray, where: IntArray, sigma: FloatArray) -> BoolArray:
    """Which of the columns (n, k) are larger at some of the data than the rounding of numerical derivatives, (k,).

    Scaled to unit length, a column of rounding errors would be projected out like a signal.
    """
    return rounding_of(columns, where, sigma) < MOST_ROUNDING
