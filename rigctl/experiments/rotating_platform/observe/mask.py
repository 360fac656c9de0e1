"""When the platform rests in the periods of a run, as it was recorded: the mask that most periods share."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array
from rigctl.experiments.rotating_platform.observe.cells import Cells
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern, custom_pattern


def outside_guard(cells: Cells, guard_s: float, lead_s: float) -> BoolArray:
    """Which cells are neither within the guard after a turn nor within the lead before the next."""
    late = cells.since >= math.ceil(guard_s * cells.sample_rate_hz - 1e-6)
    return np.asarray(late & (cells.to_go > round(lead_s * cells.sample_rate_hz)))


def usual_mask(cells: Cells, keep: BoolArray | None = None) -> SampledPattern:
    """The dwells of the first period that is like most others, as far as its cells are kept."""
    keep = np.ones(cells.period.size, dtype=np.bool_) if keep is None else keep
    shapes = _shapes_of(cells, keep)
    first = np.flatnonzero((shapes == usual_shape(shapes)).all(axis=1))[0]
    return _dwells_of(cells, keep & (cells.period == first))


def shifted_samples(cells: Cells, keep: BoolArray, sampled: SampledPattern) -> Int64Array:
    """Of each period, by how many samples the kept cells are elsewhere than the dwells of `sampled`."""
    u = 2 * np.arange(sampled.samples) + 1 - sampled.samples
    signs = [sampled.sign == sign for sign in (1, -1)]
    return shifts(_shapes_of(cells, keep), np.array([where.sum() for where in signs] + [u[w].sum() for w in signs]))


def dwell_shapes(
    period: Int64Array, negative: BoolArray, count: FloatArray, moment: FloatArray, periods: int
) -> Int64Array:
    """What tells the dwells of periods apart, (periods, 4): samples at 0 and at half a turn, sums of their `u`."""
    sums = [np.bincount(2 * period + negative, each, 2 * periods).reshape(periods, 2) for each in (count, moment)]
    return np.rint(np.concatenate(sums, axis=1)).astype(np.int64)


def usual_shape(shapes: Int64Array) -> Int64Array:
    """The shape that most periods with dwells at both stops have."""
    kinds, often = np.unique(shapes, axis=0, return_counts=True)
    return np.asarray(kinds[np.argmax(np.where(kinds[:, :2].min(axis=1) > 0, often, 0))])


def shifts(shapes: Int64Array, usual: Int64Array) -> Int64Array:
    """By how many samples each of `shapes` differs from the usual one; at least 1 where it differs."""
    missing = np.abs(shapes[:, :2] - usual[:2]).sum(axis=1)
    return np.where((shapes != usual).any(axis=1), np.maximum(missing, 1), 0)


def _shapes_of(cells: Cells, keep: BoolArray) -> Int64Array:
    moment = (cells.count * cells.centre)[keep]
    return dwell_shapes(cells.period[keep], cells.sign[keep] < 0, cells.count[keep], moment, cells.periods)


def _dwells_of(cells: Cells, keep: BoolArray) -> SampledPattern:
    first = np.rint(0.5 * (cells.centre[keep] + cells.samples - cells.count[keep])).astype(np.int64)
    stop = first + np.rint(cells.count[keep]).astype(np.int64)
    dwells: list[tuple[int, float, float]] = []
    rate_hz = cells.sample_rate_hz
    for sign, begin, end in zip(cells.sign[keep].tolist(), first.tolist(), stop.tolist(), strict=True):
        if dwells and dwells[-1][0] == sign and abs(dwells[-1][2] * rate_hz - begin) < 0.5:
            dwells[-1] = (sign, dwells[-1][1], end / rate_hz)
        else:
            dwells.append((sign, begin / rate_hz, end / rate_hz))
    return custom_pattern(cells.period_s, dwells).sampled(rate_hz)
