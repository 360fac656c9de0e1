"""One run: means, slopes and precisions from both its channels, and how they follow the commanded tilt."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.model.response import SineResponse, measured_sine
from rigctl.experiments.rotating_platform.observe.cells import FAULTS, Cells
from rigctl.experiments.rotating_platform.observe.channel_runs import ChannelRun, baseline_columns
from rigctl.experiments.rotating_platform.observe.covariance import PowerLawNoise
from rigctl.experiments.rotating_platform.observe.estimates import (
    PeriodEstimates,
    estimates,
    outside_guard,
    usual_mask,
)
from rigctl.experiments.rotating_platform.observe.estimators import Estimator
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.observe.store_reduction import PlatformRun
from rigctl.experiments.rotating_platform.result.alignment import Value
from rigctl.experiments.rotating_platform.result.contradictions import contradictions
from rigctl.experiments.rotating_platform.result.precision import MEANS, Precision, run_means, run_precision
from rigctl.experiments.rotating_platform.result.separation import Conditions, conditions

# Of the bias in the mean acceleration: stops of equal weight leave rounding only.
_BALANCED = 1e-9


@dataclass(frozen=True)
class RunResult:
    """One run: `values` of the four outputs by channel, how they came about, and how well they are known.

    `series` are the outputs period by period, `commanded` (periods,) what was commanded of a_Z, as demodulated.
    """

    run: PlatformRun
    sampled: SampledPattern
    estimator: Estimator
    series: PeriodEstimates
    conditions: Conditions
    values: Mapping[str, Mapping[str, Value]]
    precision: Mapping[str, Precision]
    response: SineResponse | None
    commanded: FloatArray
    dropped: Mapping[str, int]
    contradictions: Sequence[str] = ()

    @property
    def refitted(self) -> int:
        """Periods that had to be fitted jointly, in either channel."""
        return int(self.series.refitted.any(axis=1).sum())

    @property
    def invalid(self) -> int:
        """Periods of which too little is left, in either channel."""
        return int(self.series.invalid.any(axis=1).sum())

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is to be said of its record, a line each."""
        cells, remarks = self.run.cells, []
        if cells.drift_s:
            remarks.append(
                f"{self.run.run_id}: the turns come {cells.drift_s:+.3g} s later in the last period than in the "
                "first: the platform's clock is not that of the samples; every period is fitted jointly"
            )
        if cells.off_stop:
            remarks.append(
                f"{self.run.run_id}: {cells.off_stop} samples count although the platform moves: "
                "look at the mask, or give a guard time"
            )
        if self.invalid:
            remarks.append(
                f"{self.run.run_id}: {self.invalid} of {cells.periods} periods have lost half their samples"
            )
        return (*remarks, *self.contradictions)

    def as_json(self) -> dict[str, Any]:
        """Keys of `runs` in `rigctl result --json`."""
        asked = self.run.conditions
        shown: dict[str, Any] = {
            "run_id": self.run.run_id,
            "pattern": asked["pattern"],
            "modulation_period_s": self.sampled.pattern.period_s,
            "sample_rate_hz": self.sampled.sample_rate_hz,
            "external": asked.get("external") or "constant",
            "estimator": self.estimator,
            "guard_s": self.run.guards_s["guard_s"],
            "periods": len(self.series),
            "refitted": self.refitted,
            "invalid": self.invalid,
            "dropped": dict(self.dropped),
            "conditions": asdict(self.conditions),
        }
        for output in MEANS:
            unit = "m_s3" if output.endswith("slope") else "m_s2"
            for channel in sorted(CHANNELS):
                shown[f"{output}_{channel}_{unit}"] = self.values[channel][output].as_json()
        shown["precision_1h_m_s2"] = {channel: self.precision[channel].as_json() for channel in sorted(CHANNELS)}
        shown["response"] = None if self.response is None else _response(self.response)
        shown["remarks"] = list(self.remarks)
        return shown


def run_result(
    channels: Sequence[ChannelRun], believed: Mapping[str, PowerLawNoise], command_v_per_m_s2: float
) -> RunResult:
    """Means, slopes and precisions of one run from both its channels; guard applied as its table was made.

    `believed` is the noise of each chain, as an acceleration, `command_v_per_m_s2` the scale factor of the input of
    axis Z.
    """
    run = channels[0].run
    cells = run.cells
    keep = outside_guard(cells, **run.guards_s)
    sampled = usual_mask(cells, keep)
    balance = conditions(sampled)
    asked = run.conditions.get("estimator") == "joint-ls"
    # Where the stops do not weigh alike, the projection lets the bias into the acceleration.
    uneven = bool(cells.drift_s) or abs(balance.m0) > _BALANCED
    estimator: Estimator = "joint-ls" if asked or uneven else "projection"
    series = estimates(cells, keep, sampled, estimator)
    noises = {each.channel: each.noise for each in channels}
    # What was commanded is no scatter of the measurement.
    accel = {channel: without_command(cells, series, number) for number, channel in enumerate(CHANNELS)}
    values, precisions = {}, {}
    for number, channel in enumerate(CHANNELS):
        values[channel] = run_means(sampled, series, number, estimator, noises[channel])
        precisions[channel] = run_precision(sampled, accel[channel], estimator, noises[channel], believed[channel])
    commanded = commanded_accel(cells)
    return RunResult(
        run,
        sampled,
        estimator,
        series,
        balance,
        values,
        precisions,
        response_of(run, sampled, series),
        commanded,
        _dropped(cells),
        contradictions(run.run_id, run.conditions, cells, sampled, command_v_per_m_s2),
    )


def _dropped(cells: Cells) -> dict[str, int]:
    """Samples of dwells that were left out, by reason; lost in both channels counts once."""
    # The last fault, dwells elsewhere, loses no sample.
    return {name: int(cells.faults[:, :, i].max(axis=1).sum()) for i, name in enumerate(FAULTS[:3])}


def _response(found: SineResponse) -> dict[str, Any]:
    return {
        "accel_pp_m_s2": found.accel_pp,
        "bias_pp_m_s2": found.bias_pp,
        "shift_min": {
            "start": found.shift.start_min,
            "centre": found.shift.centre_min,
            "end": found.shift.end_min,
        },
    }


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
    # Modulated, for the demodulation to take it off again.
    return _by_period(cells, cells.sign * cells.state[:, 0])


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
