"""How many independent trials many correlated ones amount to, and how the level is shared between families of them.

Effects of one family (smooth functions of one column, the places of a step in it) are much the same question. Each
family has one portion of the level, however many effects are in it: a longer catalogue costs the others little.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.verdict.scan import Draws, ScanScores
from rigctl.workbench.verdict.score import smallest_p

# Forty lie below the 2 % quantile: the number of trials is known to 16 %.
DRAWS = 2000
QUANTILE = 0.02
_BELOW_ONE = 1.0 - 1e-16
# Up to so many rows noise is drawn for each: draws along a basis would follow its signs, which rounding decides.
_ROW_BY_ROW = 5000
# Of the largest square: the span of unit columns ends where rounding begins.
_SPANNED = 1e-12


@dataclass
class Family:
    """What one family tries: bases (rows, d) of single candidates, and scans."""

    bases: list[FloatArray] = field(default_factory=list)
    scans: list[ScanScores] = field(default_factory=list)


@dataclass(frozen=True)
class Trials:
    """Independent trials of each family of candidates (`within`), how many families independent ones they amount to
    (`families`), and the trials of `all` candidates without regard to families."""

    within: Mapping[str, float]
    families: float
    all: float

    def of(self, family: str) -> float:
        """Trials by which p-values of a family are corrected: 1 - (1 - p)^n, within it and for all families."""
        return self.within.get(family, 1.0) * self.families


def trials(families: Mapping[str, Family], rows: int, seed: int) -> Trials:
    """How many independent trials the candidates amount to whose bases have so many rows.

    Noise is drawn; within a family 1 - (1 - p)^n is matched to the smallest p at its 2 % quantile, then the same with
    the families' corrected p-values.
    """
    smallest = {name: each for name, each in _smallest(families, rows, seed).items() if each.min() < 1.0}
    within = {name: trials_of(each) for name, each in smallest.items()}
    if not smallest:
        return Trials(within, 1.0, 1.0)
    drawn = np.stack(list(smallest.values()))
    of_each = np.array(list(within.values()))[:, None]
    judged = np.min(-np.expm1(of_each * np.log1p(-np.minimum(drawn, _BELOW_ONE))), axis=0)
    return Trials(within, trials_of(judged) if len(within) > 1 else 1.0, trials_of(np.min(drawn, axis=0)))


def trials_of(smallest: FloatArray) -> float:
    """Independent trials whose smallest p has the 2 % quantile of these."""
    # Where every trial is absorbed by the model, all of them are 1.
    level = min(float(np.quantile(smallest, QUANTILE)), _BELOW_ONE)
    return max(float(np.log1p(-QUANTILE) / np.log1p(-level)), 1.0)


def _smallest(families: Mapping[str, Family], rows: int, seed: int) -> dict[str, FloatArray]:
    """The smallest p of each family in each draw of noise, which is drawn in the span of the bases alone where there
    are many rows and no scans; 1 where all is absorbed."""
    wide = {name: [basis for basis in family.bases if basis.shape[1]] for name, family in families.items()}
    span = np.hstack([np.zeros((rows, 0)), *(basis for bases in wide.values() for basis in bases)])
    scanned = any(each.dimension.any() for family in families.values() for each in family.scans)
    if scanned or rows <= _ROW_BY_ROW or span.shape[1] > rows:
        draws = _noise(seed, rows)
        along: NDArray[np.floating] = draws @ span.astype(np.float32)
    else:
        # Only what the bases span is drawn: few numbers instead of one for every datum.
        draws = np.zeros((DRAWS, 0), dtype=np.float32)
        square, turn = np.linalg.eigh(span.T @ span)
        spanned = square > _SPANNED * square.max(initial=0.0)
        root = np.sqrt(square[spanned])[:, None] * turn[:, spanned].T
        along = _stream(seed).standard_normal((DRAWS, len(root))) @ root
    smallest, first, drawn = {}, 0, Draws(draws, (seed, rows))
    for name, family in families.items():
        dimensions = np.array([basis.shape[1] for basis in wide[name]], dtype=np.intp)
        last = first + int(dimensions.sum())
        smallest[name] = _smallest_of_bases(along[:, first:last], dimensions)
        for each in family.scans:
            if each.dimension.any():
                smallest[name] = np.minimum(smallest[name], each.smallest_p(drawn))
        first = last
    return smallest


# The same for all models of a table: kept for the next one.
@lru_cache(maxsize=1)
def _noise(seed: int, rows: int) -> NDArray[np.float32]:
    """Draws of noise, (DRAWS, rows)."""
    return _stream(seed).standard_normal((DRAWS, rows), dtype=np.float32)


def _stream(seed: int) -> np.random.Generator:
    """A stream of its own; 2 draws for shapes, 3 for the bootstrap, 4 for shapes beside others, 5 permutes."""
    return np.random.default_rng([seed, 1])


def smallest_of(family: Family, draws: NDArray[np.float32], name: object) -> FloatArray:
    """The smallest p of one family in draws of noise (draws, rows) of this `name`."""
    wide = [basis for basis in family.bases if basis.shape[1]]
    dimensions = np.array([basis.shape[1] for basis in wide], dtype=np.intp)
    span = np.hstack([np.zeros((draws.shape[1], 0)), *wide]).astype(np.float32)
    smallest, drawn = _smallest_of_bases(draws @ span, dimensions), Draws(draws, name)
    for each in family.scans:
        if each.dimension.any():
            smallest = np.minimum(smallest, each.smallest_p(drawn))
    return smallest


def _smallest_of_bases(along: NDArray[np.floating], dimensions: IntArray) -> FloatArray:
    """Of bases whose columns stand side by side, from draws along them (draws, columns)."""
    if not len(dimensions):
        return np.ones(len(along))
    first = np.concatenate([[0], np.cumsum(dimensions)[:-1]])
    return smallest_p(np.add.reduceat(np.square(along), first, axis=1), dimensions)
