"""Sum and first moment of stretches of samples, in one pass over the memory.

Both are products with a row, of ones and of a ramp, taken piece by piece: the second finds the piece in the cache.
Thin products are slower on several threads: callers keep them on one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.interfaces import FloatArray

BoolArray = NDArray[np.bool_]

# Pieces of a megabyte; long stretches are folded, since one product of many rows is faster than that of a single.
_PIECE, _LONGEST, _FOLD, _WORTH_FOLDING = 2**17, 2**17, 2**11, 2**14
_SETTLED_BY_SQUARES, _SURELY = 2**13, 1.0 - 1e-6
_ONES, _RAMP = np.ones(_LONGEST), np.arange(_LONGEST, dtype=np.float64)


class RowSums(NamedTuple):
    """Per row, shape (rows,): sum of the samples, sum of index times sample, and whether one of them is unusable."""

    level: FloatArray
    ramp: FloatArray
    faulty: BoolArray


def row_sums(rows: FloatArray, full_scale: float = np.inf) -> RowSums:
    """The sums of `rows`, shape (rows, samples), each contiguous in memory.

    A row is faulty when a sample is not finite or its magnitude reaches `full_scale`; its sums mean nothing then.
    """
    count, length = rows.shape
    level, ramp, faulty = np.empty(count), np.empty(count), np.zeros(count, dtype=np.bool_)
    if length > _LONGEST:
        for i, row in enumerate(rows):
            level[i], ramp[i], faulty[i] = line_sums(row, full_scale)
        return RowSums(level, ramp, faulty)
    step = max(1, _PIECE // max(1, length))
    for i in range(0, count, step):
        part, these = rows[i : i + step], slice(i, i + step)
        np.matmul(part, _ONES[:length], out=level[these])
        np.matmul(part, _RAMP[:length], out=ramp[these])
        if full_scale < np.inf and not _within(part, level[these], full_scale):
            faulty[these] = ~(np.abs(part).max(axis=1) < full_scale)
    return RowSums(level, ramp, faulty | ~np.isfinite(level))


def line_sums(row: FloatArray, full_scale: float = np.inf) -> tuple[float, float, bool]:
    """The same of a single row, shape (samples,): as it comes in pieces, many of them short."""
    if row.size >= _WORTH_FOLDING:
        return _folded(row, full_scale)
    level, ramp = float(row @ _ONES[: row.size]), float(row @ _RAMP[: row.size])
    faulty = not math.isfinite(level)
    if not faulty and full_scale < math.inf and row.size:
        faulty = not (row.max() < full_scale and row.min() > -full_scale)
    return level, ramp, faulty


def _folded(row: FloatArray, full_scale: float) -> tuple[float, float, bool]:
    """A long row as many short ones."""
    folds = row.size // _FOLD
    short = row_sums(row[: folds * _FOLD].reshape(folds, _FOLD), full_scale)
    level, ramp, faulty = line_sums(row[folds * _FOLD :], full_scale)
    ramp += float(short.ramp.sum()) + _FOLD * (float(np.arange(folds) @ short.level) + folds * level)
    return level + float(short.level.sum()), ramp, faulty or bool(short.faulty.any())


def _within(rows: FloatArray, level: FloatArray, full_scale: float) -> bool:
    """Whether all samples of rows with the sums `level` stay below full scale; no for NaN.

    None is farther from the mean of its row than the root of the sum of squares about it: one more product of short
    rows mostly settles it, where the extremes would take two slower passes.
    """
    length = rows.shape[1]
    if length <= _SETTLED_BY_SQUARES:
        mean = level / max(1, length)
        farthest = np.abs(mean) + np.sqrt(np.maximum(np.vecdot(rows, rows) - mean * level, 0.0))
        if (farthest < _SURELY * full_scale).all():
            return True
    return bool(length == 0 or (rows.max() < full_scale and rows.min() > -full_scale))
