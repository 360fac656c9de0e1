"""P-values where few degrees of freedom are left: what noise of any direction would show, its size estimated anew.

The number of independent trials is counted for noise of known size. With few degrees of freedom whatever is
significant explains nearly all that is left, and neighbours in a scan, which seldom do so together, count as separate
trials. Directions drawn evenly in the space of the residuals tell exactly how often the best of all candidates is as
good (Langsrud, Statistics and Computing 15 (2005) 53: rotation tests).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy import special

from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.permuted import Tail
from rigctl.workbench.verdict.scan import OwnNoise
from rigctl.workbench.verdict.score import Projector
from rigctl.workbench.verdict.trials import Family

FEW = 12.0
"""Degrees of freedom of the noise, up to which p-values are held to rotations: beyond, the number of trials does as
well or errs to the safe side."""

ROTATIONS = 2000
# Rotations by candidates by dimensions would not fit into memory all at once.
_AT_ONCE = 250
_FLOOR = 1e-9
"""Of a square sum: as much of it is left at least to tell the noise."""


class Rotated:
    """Residuals that a fit leaves in other directions, each `family` of candidates judged as it is in the data.

    `own` tells the noise of the data, which are independent and of one pool; `seed` fixes the directions.
    """

    def __init__(self, projector: Projector, own: OwnNoise, families: Mapping[str, Family], seed: int) -> None:
        # A stream of its own, see `trials`.
        drawn = np.random.default_rng([seed, 8]).standard_normal((ROTATIONS, len(projector.left)))
        left = drawn - (drawn @ projector.basis) @ projector.basis.T
        smallest = {name: _smallest(left, own, family) for name, family in families.items()}
        self._tails = {name: Tail(np.sort(each)) for name, each in smallest.items()}
        found = [_ranks(each) for each in smallest.values()]
        self._of_all = Tail(np.sort(np.min(found, axis=0)))

    def corrected(self, family: str, p_value: float) -> float:
        """The probability that noise alone shows as small a p-value in a family, or its like in any other one."""
        return self._of_all.probability(self._tails[family].probability(p_value))


def _smallest(left: FloatArray, own: OwnNoise, family: Family) -> FloatArray:
    """The smallest p of a family in draws (draws, n) of what is left, the scale of their noise estimated in each."""
    smallest = np.ones(len(left))
    outside = left - (left @ own.frame) @ own.frame.T
    for dimension, columns in _bases(family):
        inside = np.einsum("np,nkd->pkd", own.frame, columns, optimize=True)
        taken = np.maximum(dimension - np.sum(inside**2, axis=(0, 2)), 0.0)
        flat = columns.reshape(len(columns), -1)
        for first in range(0, len(left), _AT_ONCE):
            now = slice(first, first + _AT_ONCE)
            shape = (-1, *columns.shape[1:])
            statistic = np.sum((left[now] @ flat).reshape(shape) ** 2, axis=2)
            explained = np.sum((outside[now] @ flat).reshape(shape) ** 2, axis=2)
            total = np.sum(outside[now] ** 2, axis=1)[:, None]
            # As in `Scoring`: where nothing were left to tell the scale, the candidate takes no part of it.
            used = own.dof - taken >= 1.0
            rest = np.where(used, own.dof - taken, own.dof)
            scale = np.maximum(total - np.where(used, explained, 0.0), _FLOOR * total) / rest
            p_values = special.fdtrc(dimension, rest, statistic / scale / dimension)
            smallest[now] = np.minimum(smallest[now], p_values.min(axis=1))
    return smallest


def _bases(family: Family) -> Iterator[tuple[int, FloatArray]]:
    """Orthonormal columns (n, k, d) of all candidates of a family with d dimensions, for each d."""
    wide = [basis for basis in family.bases if basis.shape[1]]
    for dimension in sorted({basis.shape[1] for basis in wide}):
        yield dimension, np.stack([basis for basis in wide if basis.shape[1] == dimension], axis=1)
    for scan in family.scans:
        bases = scan.bases
        for dimension in np.unique(scan.dimension[scan.dimension > 0]):
            yield int(dimension), bases[:, scan.dimension == dimension]


def _ranks(values: FloatArray) -> FloatArray:
    """The share of the values that are no larger than each."""
    return np.asarray(np.searchsorted(np.sort(values), values, side="right") / len(values))
