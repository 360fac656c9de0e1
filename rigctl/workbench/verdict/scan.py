"""Score tests of many choices of one effect at once: the periods, rates and places of a scan.

What `score.Projector.score` does for one candidate, by moments: with u the whitened columns of a choice at unit
length and B a basis of what is fitted, the Gram matrix of what B leaves of them is u'u - (B'u)'(B'u). Nothing of the
size of the data is made for a choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.summed_columns import SummedColumns
from rigctl.analysis.unit_columns import UnitColumns
from rigctl.core.arrays import BoolArray, FloatArray, IntArray
from rigctl.workbench.verdict.score import ABSORBED, Projector, Score, p_of, smallest_p

TOGETHER = 32
"""So many choices of an effect are scored together."""

# Numbers, draws by choices by columns, that fit into the processor's cache.
_AT_ONCE = 1 << 18


@dataclass(frozen=True)
class OwnNoise:
    """The scale of the noise as it is once a candidate is in, for what an effect explains inflates it before.

    `frame` (n, p) spans all that is projected out where the noise is estimated, `dof` are the degrees of freedom of
    its scale, and `least` of its variance stays whatever is explained.
    """

    frame: FloatArray
    dof: float
    least: float = 0.0

    def variance(self, explained: FloatArray | float, rest: FloatArray | float) -> FloatArray:
        """Once so much of the square sum is explained and `rest` degrees of freedom are left; before, it was 1."""
        return np.maximum(np.maximum(self.dof - explained, 1e-9 * self.dof) / rest, self.least)


class Draws:
    """Noise drawn for many scans: `values` (draws, n + priors), and a `name` under which products may be kept."""

    def __init__(self, values: NDArray[np.float32], name: object) -> None:
        self.values, self.name = values, name
        self._fitted: tuple[Projector, NDArray[np.float32]] | None = None

    def fitted(self, projector: Projector) -> NDArray[np.float32]:
        """Products with what is fitted, (draws, rank), kept for the last: the scans beside one model share them."""
        if self._fitted is None or self._fitted[0] is not projector:
            self._fitted = projector, self.values @ projector.basis.astype(np.float32)
        return self._fitted[1]


def asked_along(projector: Projector, own: OwnNoise | None) -> FloatArray:
    """The vectors (n, q) whose products with columns tell scores: what is fitted, what is left, what tells noise."""
    left = projector.left[: projector.data]
    vectors = [projector.basis[: projector.data], left[:, None]]
    if own is not None:
        vectors += [own.frame, (left - own.frame @ (own.frame.T @ left))[:, None]]
    return np.hstack(vectors)


class ScanScores:
    """The scores of an effect's choices, whose whitened columns are `unit` ones times `scale`.

    `along` are the vectors that `asked_along` gives, for those who ask about many scans. `asked` are the places of
    the choices that are scored, by default of all.
    """

    def __init__(
        self,
        projector: Projector,
        unit: UnitColumns | SummedColumns,
        scale: float,
        own: OwnNoise | None,
        along: FloatArray | None = None,
        asked: IntArray | None = None,
    ) -> None:
        self._unit, self._projector = unit, projector
        self._fitted, rank = projector.basis[: projector.data], projector.basis.shape[1]
        products = unit.along(asked_along(projector, own) if along is None else along)
        self._shadow, to_left = products[:rank], products[rank]
        gram = unit.gram - np.einsum("mki,mkj->kij", self._shadow, self._shadow, optimize=True)
        # A difference of squares: rounding may leave it a little below zero.
        self._keep = np.sqrt(np.maximum(np.einsum("kii->ki", gram), 0.0))
        self._seen = self._keep > ABSORBED
        self._root, self._determined = inverse_root(gram, self._seen)
        self._along = np.einsum("kij,ki->kj", self._root, to_left)
        self._dof = self._dof_of_each()
        self._p_values: FloatArray = np.asarray(p_of(self.statistic, self.dimension, self._dof))
        if own is not None:
            self._judge_by_own_noise(own, products[rank + 1 : -1], products[-1])
        self._size = np.where(unit.size > 0.0, unit.size * scale, 1.0)
        self._asked = np.arange(len(self._along)) if asked is None else asked

    @property
    def scores(self) -> list[Score]:
        """Of all choices that are asked about."""
        return [self.score(number) for number in range(len(self._asked))]

    @cached_property
    def strongest(self) -> int:
        """The number of the choice with the largest statistic, the first of equals."""
        return int(np.argmax(self.statistic[self._asked]))

    @property
    def largest(self) -> float:
        """The largest statistic of what is asked about."""
        return float(np.max(self.statistic[self._asked]))

    def score(self, number: int) -> Score:
        """Of one choice that is asked about."""
        place = int(self._asked[number])
        seen, dimension = self._seen[place], int(self.dimension[place])
        determined, root = seen & (dimension > 0), self._root[place]
        return Score(
            float(self.statistic[place]),
            dimension,
            float(self._dof[place]),
            float(self._p_values[place]) if dimension else 1.0,
            self._keep[place],
            np.where(determined, root @ self._along[place] / self._size[place], 0.0),
            np.where(determined, np.sqrt(np.sum(root**2, axis=1)) / self._size[place], np.inf),
            # Asked for once or more; of a few data it is no burden to keep.
            cache(partial(self._basis, place)),
        )

    @cached_property
    def statistic(self) -> FloatArray:
        """T of each choice."""
        return np.asarray(np.sum(self._along**2, axis=1))

    @cached_property
    def dimension(self) -> IntArray:
        """Of each choice."""
        return np.asarray(self._determined.sum(axis=1), dtype=np.intp)

    def smallest_p(self, draws: Draws) -> FloatArray:
        """The smallest p over the choices in each draw of noise."""
        data = self._projector.data
        along = self._unit.along_draws(np.ascontiguousarray(draws.values[:, :data]), draws.name)
        fitted = draws.fitted(self._projector)
        shadow = self._shadow.transpose(0, 2, 1).astype(np.float32).reshape(len(self._shadow), -1)
        # T = x' R R' x with x what is left of a draw along the columns: no basis is made for a choice.
        form = np.einsum("kij,klj->ilk", self._root, self._root).astype(np.float32)
        counts = np.isin(np.arange(len(form[0, 0])), self._asked) & (self.dimension > 0)
        form[:, :, ~counts] = 0.0
        # T = 0 of what does not count has p = 1 in any dimension: it is left among the others.
        dimension = np.where(counts, self.dimension, np.max(self.dimension))
        smallest, at_once = [], max(_AT_ONCE // shadow.shape[1], 1)
        for first in range(0, len(fitted), at_once):
            rows = slice(first, first + at_once)
            free = along[rows] - (fitted[rows] @ shadow).reshape(-1, *along.shape[1:])
            smallest.append(smallest_p(_quadratic(free, form), dimension))
        return np.concatenate(smallest)

    def _dof_of_each(self) -> FloatArray:
        one = self._projector.one_dof
        dof = np.full(len(self._along), one) if one is not None else self._projector.dof_of_each(self.bases)
        return np.where(self.dimension > 0, dof, np.inf)

    @property
    def bases(self) -> FloatArray:
        """Orthonormal columns of every choice, zero where a dimension is absorbed, (n, choices, d)."""
        stack = np.stack([self._unit.columns(place) for place in range(self._unit.choices)], axis=1)
        stack = stack - np.einsum("nm,mki->nki", self._fitted, self._shadow, optimize=True)
        return np.asarray(np.einsum("nki,kij->nkj", stack, self._root, optimize=True))

    def _basis(self, place: int) -> FloatArray:
        """Of one choice, (n + priors, dimension)."""
        basis = self._projector.basis
        free = -basis @ self._shadow[:, place]
        free[: self._projector.data] += self._unit.columns(place)
        return np.asarray(free @ self._root[place][:, self._determined[place]])

    def _judge_by_own_noise(self, own: OwnNoise, in_frame: FloatArray, to_outside: FloatArray) -> None:
        """P-values with the scale that the noise has with each choice in, from products (p, k, d)."""
        fitted, left = self._fitted, self._projector.left[: self._projector.data]
        outside = left - own.frame @ (own.frame.T @ left)
        explained = to_outside - np.einsum("m,mki->ki", outside @ fitted, self._shadow)
        inside = in_frame - np.einsum("pm,mki->pki", own.frame.T @ fitted, self._shadow, optimize=True)
        inside = np.einsum("pki,kij->pkj", inside, self._root, optimize=True)
        below = np.einsum("rm,mki->rki", self._projector.basis[self._projector.data :], self._shadow)
        below = np.einsum("rki,kij->rkj", below, self._root)
        taken = np.maximum(self._determined - np.sum(below**2, axis=0) - np.sum(inside**2, axis=0), 0.0)
        taken = np.sum(np.where(self._determined, taken, 0.0), axis=1)
        explained = np.sum(np.einsum("ki,kij->kj", explained, self._root) ** 2, axis=1)
        used = (self.dimension > 0) & (own.dof - taken >= 1.0)
        rest = np.where(used, own.dof - taken, 1.0)
        # As in `Attempt._by_own_noise`, for all choices at once.
        p_values = p_of(self.statistic / own.variance(explained, rest), self.dimension, rest)
        self._dof = np.where(used, rest, self._dof)
        self._p_values = np.where(used, p_values, self._p_values)


def inverse_root(gram: FloatArray, seen: BoolArray) -> tuple[FloatArray, BoolArray]:
    """What makes columns with these Gram matrices (k, d, d) orthonormal, (k, d, d), and which are determined."""
    both = seen[:, :, None] & seen[:, None, :]
    square, vectors = np.linalg.eigh(np.where(both, gram, 0.0))
    s = np.sqrt(np.maximum(square, 0.0))
    # Eigenvalues rise: the last is the largest.
    determined = (s > ABSORBED * s[:, -1:]) & (s[:, -1:] > 0.0)
    root = np.where(determined[:, None, :], vectors / np.where(determined, s, 1.0)[:, None, :], 0.0)
    return np.asarray(root), np.asarray(determined)


def _quadratic(columns: NDArray[np.float32], form: NDArray[np.float32]) -> NDArray[np.float32]:
    """x' F x of each choice: columns (draws, d, k), forms (d, d, k)."""
    total = np.zeros((len(columns), columns.shape[2]), dtype=np.float32)
    for i in range(len(form)):
        part = form[i, i] * columns[:, i]
        for j in range(i):
            part += (2.0 * form[i, j]) * columns[:, j]
        part *= columns[:, i]
        total += part
    return total
