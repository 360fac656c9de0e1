"""Acceleration and bias, mean and slope, per modulation period, by the mask that most periods share; live too."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array
from rigctl.experiments.rotating_platform.observe.cells import FAULTS, Cells
from rigctl.experiments.rotating_platform.observe.estimators import Estimator, weights
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern, custom_pattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS


def outside_guard(cells: Cells, guard_s: float, lead_s: float) -> BoolArray:
    """Which cells are neither within the guard after a turn nor within the lead before the next."""
    late = cells.since >= math.ceil(guard_s * cells.sample_rate_hz - 1e-6)
    return np.asarray(late & (cells.to_go > round(lead_s * cells.sample_rate_hz)))


def usual_mask(cells: Cells, keep: BoolArray | None = None) -> SampledPattern:
    """The dwells of the first period that is like most others without a gap, as far as its cells are kept."""
    keep = np.ones(cells.period.size, dtype=np.bool_) if keep is None else keep
    shapes = _shapes_of(cells, keep)
    gap: BoolArray = np.asarray(cells.faults[:, :, FAULTS.index("gap")].any(axis=1))
    first = np.flatnonzero((shapes == usual_shape(shapes, ~gap)).all(axis=1))[0]
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


def usual_shape(shapes: Int64Array, gapless: BoolArray) -> Int64Array:
    """The shape that most periods with dwells at both stops have; of the gapless ones, if there are such."""
    both = shapes[:, :2].min(axis=1) > 0
    shapes = shapes[gapless] if (gapless & both).any() else shapes
    kinds, often = np.unique(shapes, axis=0, return_counts=True)
    return np.asarray(kinds[np.argmax(np.where(kinds[:, :2].min(axis=1) > 0, often, 0))])


def shifts(shapes: Int64Array, usual: Int64Array) -> Int64Array:
    """By how many samples each of `shapes` differs from the usual one; at least 1 where it differs."""
    # Dwells that are whole but elsewhere miss no sample: their moments tell.
    missing = np.abs(shapes[:, :2] - usual[:2]).sum(axis=1)
    return np.where((shapes != usual).any(axis=1), np.maximum(missing, 1), 0)


def _shapes_of(cells: Cells, keep: BoolArray) -> Int64Array:
    moment = (cells.count * cells.centre)[keep]
    return dwell_shapes(cells.period[keep], cells.sign[keep] < 0, cells.count[keep], moment, cells.periods)


def _dwells_of(cells: Cells, keep: BoolArray) -> SampledPattern:
    first = cells.first[keep]
    stop = first + np.rint(cells.count[keep]).astype(np.int64)
    dwells: list[tuple[int, float, float]] = []
    rate_hz = cells.sample_rate_hz
    for sign, begin, end in zip(cells.sign[keep].tolist(), first.tolist(), stop.tolist(), strict=True):
        # Cells of one dwell are joined again.
        if dwells and dwells[-1][0] == sign and abs(dwells[-1][2] * rate_hz - begin) < 0.5:
            dwells[-1] = (sign, dwells[-1][1], end / rate_hz)
        else:
            dwells.append((sign, begin / rate_hz, end / rate_hz))
    return custom_pattern(cells.period_s, dwells).sampled(rate_hz)


FEWEST_SAMPLES = 0.5
"""Part of a period's samples that must be left for it to count."""


@dataclass(frozen=True)
class PeriodEstimates:
    """What each period and channel gives: arrays of shape (periods, channels), NaN where a period is invalid.

    Means in m/s2, slopes in m/s3, both of the external acceleration and of the sensor's bias, at the mean time of
    the pattern's kept samples. `refitted` are the periods with faults, which were fitted jointly to what is left of
    them; `invalid` those with less than half their samples, or fewer than two of one sign. `faults`, shape (periods,
    channels, 4), are the samples left out, or elsewhere, by `cells.FAULTS`. `excess`, shape (2, periods, channels),
    is how large the variances of means and slopes are, in white noise, over those of a period without faults.
    """

    accel_mean: FloatArray
    accel_slope: FloatArray
    bias_mean: FloatArray
    bias_slope: FloatArray
    refitted: BoolArray
    invalid: BoolArray
    faults: Int64Array
    excess: FloatArray

    def __len__(self) -> int:
        return len(self.accel_mean)


def estimates(
    cells: Cells, keep: BoolArray, sampled: SampledPattern, estimator: Estimator = "projection"
) -> PeriodEstimates:
    """Estimate every period of a run from the cells that are kept, its dwells being those of `sampled`.

    Periods with faults, or with dwells elsewhere, by the joint fit, whatever `estimator` says (`estimators`).
    """
    moments = _about_the_centre(sampled, _sums(cells, keep))
    joint, variances, solvable = _joint(moments)
    faults = cells.faults.copy()
    faults[:, :, FAULTS.index("shifted")] = shifted_samples(cells, keep, sampled)[:, None]
    faulty = faults.any(axis=-1)
    enough = moments[..., 0].sum(axis=-1) >= FEWEST_SAMPLES * sampled.kept
    valid = enough & solvable
    # With samples missing the projection's columns are no longer orthogonal: acceleration would leak into bias.
    outputs = joint if estimator == "joint-ls" else np.where(faulty, joint, _projection(moments))
    accel_mean, accel_slope, bias_mean, bias_slope = np.where(valid, outputs, np.nan)
    refitted, excess = faulty & valid, np.ones_like(variances)
    if refitted.any():
        usual = np.sum(weights(sampled, estimator)[:2] ** 2, axis=1)
        excess = np.where(refitted, variances / usual[:, None, None], excess)
    return PeriodEstimates(accel_mean, accel_slope, bias_mean, bias_slope, refitted, ~valid, faults, excess)


def _sums(cells: Cells, keep: BoolArray) -> FloatArray:
    """The sums of `Cells.sums` over either stop's dwells of each period, at 0 first: (periods, channels, 2, 5)."""
    key = 2 * cells.period[keep] + (cells.sign[keep] < 0)
    flat = cells.sums[keep].reshape(len(key), -1)
    sums = np.stack([np.bincount(key, column, 2 * cells.periods) for column in flat.T], axis=1)
    return np.asarray(sums.reshape(cells.periods, 2, len(CHANNELS), 5).swapaxes(1, 2))


def _about_the_centre(sampled: SampledPattern, values: FloatArray) -> FloatArray:
    """The five sums with t in s from the centre in the place of u, shape (periods, channels, 2, 5)."""
    count, time, square, level, ramp = np.moveaxis(values, -1, 0)
    scale, centre = 2.0 * sampled.sample_rate_hz, sampled.centre_s
    time, square, ramp = time / scale, square / scale**2, ramp / scale
    return np.stack(
        [
            count,
            time - centre * count,
            square - 2.0 * centre * time + centre**2 * count,
            level,
            ramp - centre * level,
        ],
        axis=-1,
    )


def _projection(moments: FloatArray) -> FloatArray:
    """The four outputs, shape (4, periods, channels)."""
    plus, minus = moments[..., 0, :], moments[..., 1, :]
    total, signed = plus + minus, plus - minus
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.stack(
            [
                signed[..., 3] / total[..., 0],
                signed[..., 4] / total[..., 2],
                total[..., 3] / total[..., 0],
                total[..., 4] / total[..., 2],
            ]
        )


def _joint(moments: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The four outputs from a line through the samples of either sign, the variances of means and slopes in white
    noise of unit variance, (2, periods, channels), and where both lines are determined."""
    count, time, square, level, ramp = np.moveaxis(moments, -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = time / count
        # One straight line for each sign: half their difference is acceleration, half their sum bias.
        slope = (ramp - mean * level) / (square - mean * time)
        at_centre = level / count - mean * slope
        of_slope = 1.0 / (square - mean * time)
        variances = 0.25 * np.stack([1.0 / count + mean**2 * of_slope, of_slope]).sum(axis=-1)
    lines = np.stack([at_centre, slope])
    plus, minus = lines[..., 0], lines[..., 1]
    return 0.5 * np.concatenate([plus - minus, plus + minus]), variances, (count >= 2.0).all(axis=-1)
