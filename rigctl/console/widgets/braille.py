"""Dots in a terminal: a cell of braille holds two by four of them."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray, Int64Array

BLANK = 0x2800
# Unicode numbers the upper six dots by columns and the lowest two last.
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.int64)


def scaled(values: FloatArray, low: float, high: float, dots: int) -> FloatArray:
    """Where values stand on an axis of `dots` dots from `low` to `high`; not clipped."""
    span = high - low
    return np.asarray((values - low) / (span if span else 1.0) * (dots - 1))


def dotted(x: FloatArray, y: FloatArray, width: int, height: int) -> Int64Array:
    """Code points, shape (height, width), of dots at x in [0, 2 width), y in [0, 4 height) counted from below."""
    cells = np.zeros((height, width), dtype=np.int64)
    finite = np.isfinite(x) & np.isfinite(y)
    # Rows count from the top.
    column, row = np.rint(x[finite]).astype(int), np.rint(4 * height - 1 - y[finite]).astype(int)
    inside = (column >= 0) & (column < 2 * width) & (row >= 0) & (row < 4 * height)
    column, row = column[inside], row[inside]
    np.bitwise_or.at(cells, (row // 4, column // 2), _BITS[row % 4, column % 2])
    return cells


def joined(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points along the straight lines between points given in dots, close enough to leave no gap."""
    if len(x) < 2:
        return x, y
    steps = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(y)))
    # Points far outside the picture would make a line of millions.
    counts = np.clip(np.nan_to_num(np.ceil(steps)), 1, 400).astype(int)
    start = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(start)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[start]
    along = [np.append(v[start] + share * (v[start + 1] - v[start]), v[-1]) for v in (x, y)]
    return along[0], along[1]


def within(x: FloatArray, y: FloatArray, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """The points between `low` and `high`, and the neighbours to which lines lead from them."""
    # A point half a dot beyond is drawn on the edge.
    low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    inside = (x >= low) & (x <= high)
    if inside.all():
        return x, y
    # A line may also cross all of it without a point inside.
    crossing = (x[:-1] < low) & (x[1:] > high) | (x[:-1] > high) & (x[1:] < low)
    kept = inside.copy()
    kept[1:] |= inside[:-1] | crossing
    kept[:-1] |= inside[1:] | crossing
    # A gap stays a gap: its first point is kept as none.
    gap = ~kept & np.concatenate([[False], kept[:-1]])
    return x[kept | gap], np.where(gap, np.nan, y)[kept | gap]


def thinned(x: FloatArray, y: FloatArray, columns: int) -> tuple[FloatArray, FloatArray]:
    """At most two points per column, the least and the greatest: a strip of 60000 samples looks the same."""
    if len(x) <= 4 * columns:
        return x, y
    size = len(x) // (2 * columns) + 1
    count = len(x) // size
    low = y[: count * size].reshape(count, size)
    middle = x[: count * size].reshape(count, size)[:, size // 2]
    ends = np.stack([np.nanmin(low, axis=1), np.nanmax(low, axis=1)], axis=1)
    return np.repeat(middle, 2), ends.ravel()
