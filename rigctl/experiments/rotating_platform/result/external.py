"""The commanded tilt of a run, period by period, and how the outputs follow it."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.model.response import SineResponse, measured_sine
from rigctl.experiments.rotating_platform.observe.cells import Cells
from rigctl.experiments.rotating_platform.observe.channel_runs import baseline_columns
from rigctl.experiments.rotating_platform.observe.estimates import PeriodEstimates
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.observe.store_reduction import PlatformRun


def without_command(cells: Cells, series: PeriodEstimates, number: int) -> FloatArray:
    """The mean acceleration of every period less what follows the commanded tilt."""
    accel = series.accel_mean[:, number]
    means, _ = baseline_columns(cells, CHANNELS[number])
    commanded = _by_period(cells, means[:, 0])
    if not np.ptp(commanded[np.isfinite(commanded)]) > 0.0:
        return accel
    slope = _by_period(cells, means[:, 0], slope=True)
    seen = np.isfinite(accel) & np.isfinite(commanded)
    columns = np.stack([np.ones_like(accel), commanded, slope], axis=1)[seen]
    size = np.maximum(np.abs(columns).max(axis=0), np.finfo(float).tiny)
    coefficients, *_ = np.linalg.lstsq(columns / size, accel[seen], rcond=1e-9)
    left = np.full_like(accel, np.nan)
    left[seen] = accel[seen] - (columns / size) @ coefficients
    return left


def _by_period(cells: Cells, modulated: FloatArray, *, slope: bool = False) -> FloatArray:
    """Mean over each period of what is modulated, or its slope in time, demodulated; shape (periods,)."""
    weight = cells.sign * cells.count
    if slope:
        weight = weight * cells.centre
    total = np.bincount(cells.period, weight * modulated, cells.periods)
    count = np.bincount(cells.period, cells.count * (cells.centre**2 if slope else 1.0), cells.periods)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total / count)


def commanded_accel(cells: Cells) -> FloatArray:
    """What was commanded of a_Z, as the mean over the kept samples of each period."""
    total = np.bincount(cells.period, cells.count * cells.state[:, 0], cells.periods)
    count = np.bincount(cells.period, cells.count, cells.periods)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total / count)


def response_of(run: PlatformRun, sampled: SampledPattern, series: PeriodEstimates) -> SineResponse | None:
    """How acceleration and bias follow an external sine or triangle; None for none, or where periods cannot tell."""
    period_s = float(run.conditions.get("external_period_s", math.nan))
    if run.conditions.get("external") not in ("sine", "triangle") or not period_s > 0.0:
        return None
    number = CHANNELS.index("z")
    try:
        return measured_sine(
            sampled,
            series.accel_mean[:, number],
            series.bias_mean[:, number],
            period_s,
            _phase_rad(run.cells, period_s),
        )
    except DataError:
        return None


def _phase_rad(cells: Cells, period_s: float) -> float:
    """Phase of the commanded signal's fundamental, a sine from the start of the run."""
    angle = 2.0 * np.pi * cells.time_s / period_s
    columns = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)
    root = np.sqrt(cells.count)
    coefficients, *_ = np.linalg.lstsq(columns * root[:, None], cells.state[:, 0] * root)
    return math.atan2(coefficients[1], coefficients[0])
