"""What a recording of the rotating platform amounts to: the tilt's gain, the accelerations, the biases, run by run.

Means and precisions are those of the paper's projection wherever a run's mask is as it was planned; a period with
faults, and a run whose turns wander, is fitted jointly to what is left (Lenoir, Christophe, Reynaud, Measurement 46
(2013) 1411; `estimates`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.model.model import Recorded
from rigctl.experiments.rotating_platform.model.response import SineResponse, measured_sine
from rigctl.experiments.rotating_platform.observe.cells import FAULTS, Cells
from rigctl.experiments.rotating_platform.observe.covariance import covariance, covariance_of_mean
from rigctl.experiments.rotating_platform.observe.estimates import PeriodEstimates, estimates
from rigctl.experiments.rotating_platform.observe.estimators import Estimator, weights
from rigctl.experiments.rotating_platform.observe.mask import outside_guard, usual_mask
from rigctl.experiments.rotating_platform.observe.noise import Q_FLEX_NOISE_V
from rigctl.experiments.rotating_platform.observe.observables import ChannelRun, baseline_columns
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains
from rigctl.experiments.rotating_platform.observe.run_noise import SIDED, RunNoise
from rigctl.experiments.rotating_platform.observe.store_reduction import PlatformRun
from rigctl.experiments.rotating_platform.result.alignment import Value, wobble
from rigctl.experiments.rotating_platform.result.precision import MeasuredPrecision, measured_precision, precision
from rigctl.experiments.rotating_platform.result.separation import Conditions, conditions

HOUR_S = 3600.0
LEVEL = 0.99
NOT_TESTED = ("theta-locked-bias", "pendulum-reaction")
"""Effects that no modulation shows: they turn with the platform as an acceleration does."""

OUTPUTS = ("accel", "accel_slope", "bias", "bias_slope")
_BALANCED = 1e-9
_BEYOND_RECORD = 0.2
_LAGS = 8


@dataclass(frozen=True)
class Precision:
    """Of the mean acceleration in an hour: `theory` by the paper's eq. 1, `own` by the run's own spectrum [m/s2]."""

    theory: float
    own: float
    measured: MeasuredPrecision | None

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        found = self.measured
        return {
            "theory": self.theory,
            "theory_own_spectrum": self.own,
            "measured": None if found is None else found.sigma,
            "interval_99": None if found is None else list(found.interval),
        }


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
        cells, found = self.run.cells, []
        if cells.drift_s:
            found.append(
                f"{self.run.run_id}: the turns come {cells.drift_s:+.3g} s later in the last period than in the "
                "first: the platform's clock is not that of the samples; every period is fitted jointly"
            )
        if cells.off_stop:
            found.append(
                f"{self.run.run_id}: {cells.off_stop} samples count although the platform moves: "
                "look at the mask, or give a guard time"
            )
        if self.invalid:
            found.append(f"{self.run.run_id}: {self.invalid} of {cells.periods} periods have lost half their samples")
        return tuple(found)

    def as_json(self) -> dict[str, Any]:
        """Keys of `runs` in `rigctl result --json`."""
        given = self.run.conditions
        found: dict[str, Any] = {
            "run_id": self.run.run_id,
            "pattern": given["pattern"],
            "modulation_period_s": self.sampled.pattern.period_s,
            "sample_rate_hz": self.sampled.sample_rate_hz,
            "external": given.get("external") or "constant",
            "estimator": self.estimator,
            "guard_s": self.run.guard_s,
            "periods": len(self.series),
            "refitted": self.refitted,
            "invalid": self.invalid,
            "dropped": dict(self.dropped),
            "conditions": asdict(self.conditions),
        }
        for output in OUTPUTS:
            unit = "m_s3" if output.endswith("slope") else "m_s2"
            for channel in sorted(CHANNELS):
                found[f"{output}_{channel}_{unit}"] = _value(self.values[channel][output])
        found["precision_1h_m_s2"] = {channel: self.precision[channel].as_json() for channel in sorted(CHANNELS)}
        found["response"] = None if self.response is None else _response(self.response)
        found["remarks"] = list(self.remarks)
        return found


@dataclass(frozen=True)
class PlatformResult:
    """The recording: `tilt_gain` and accelerations of the fit, wobbles where the electrical biases are known."""

    tilt_gain: Value
    accel_m_s2: Mapping[str, Value]
    wobble_rad: Mapping[str, Value] | None
    runs: tuple[RunResult, ...]
    left_out: Mapping[str, str]

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl result --json`."""
        return {
            "tilt_gain": _value(self.tilt_gain),
            "accel_m_s2": {name: _value(value) for name, value in self.accel_m_s2.items()},
            "wobble_rad": None
            if self.wobble_rad is None
            else {name: _value(value) for name, value in self.wobble_rad.items()},
            "sided": SIDED,
            "not_tested": list(NOT_TESTED),
            "runs": [run.as_json() for run in self.runs],
            "left_out": dict(self.left_out),
        }


def platform_result(
    recorded: Recorded, chains: Chains, fitted: Mapping[str, Value], left_out: Mapping[str, str]
) -> PlatformResult:
    """The result of a recording; `fitted` are the parameters of its model by name."""
    by_run: dict[str, list[ChannelRun]] = {}
    for each in recorded.channels:
        by_run.setdefault(each.run.run_id, []).append(each)
    runs = tuple(run_result(own, chains) for own in by_run.values())
    return PlatformResult(
        fitted["tilt_gain"],
        {"y": fitted["accel_y0"], "z": fitted["accel_z0"]},
        _wobbles(runs, chains),
        runs,
        left_out,
    )


def run_result(channels: Sequence[ChannelRun], chains: Chains) -> RunResult:
    """Means, slopes and precisions of one run from both its channels; guard applied as its table was made."""
    run = channels[0].run
    cells = run.cells
    keep = outside_guard(cells, run.guard_s, run.lead_s)
    sampled = usual_mask(cells, keep)
    found = conditions(sampled)
    asked = run.conditions.get("estimator") == "joint-ls"
    uneven = bool(cells.drift_s) or abs(found.m0) > _BALANCED
    estimator: Estimator = "joint-ls" if asked or uneven else "projection"
    series = estimates(cells, keep, sampled, estimator)
    noises = {each.channel: each.noise for each in channels}
    accel = {channel: _without_command(cells, series, number) for number, channel in enumerate(CHANNELS)}
    values, precisions = {}, {}
    for number, channel in enumerate(CHANNELS):
        values[channel] = _means(sampled, series, number, estimator, noises[channel])
        gain = chains.gain_v_per_m_s2[channel]
        precisions[channel] = _precision(sampled, accel[channel], estimator, noises[channel], gain)
    commanded = _commanded(cells)
    return RunResult(
        run,
        sampled,
        estimator,
        series,
        found,
        values,
        precisions,
        _response_of(run, sampled, series),
        commanded,
        _dropped(cells),
    )


def _means(
    sampled: SampledPattern, series: PeriodEstimates, number: int, estimator: Estimator, noise: RunNoise
) -> dict[str, Value]:
    valid = np.isfinite(series.accel_mean[:, number])
    if not valid.any():
        return dict.fromkeys(OUTPUTS, Value(math.nan, math.nan))
    rows, rate_hz = _coarse(weights(sampled, estimator), sampled.sample_rate_hz)
    periods = int(valid.sum())
    from_hz = _BEYOND_RECORD / (len(series) * sampled.pattern.period_s)
    spread = covariance_of_mean(rows, rate_hz, noise, periods, sided=SIDED, from_hz=from_hz)
    columns = (series.accel_mean, series.accel_slope, series.bias_mean, series.bias_slope)
    return {
        name: Value(float(column[valid, number].mean()), math.sqrt(float(spread[i, i])))
        for i, (name, column) in enumerate(zip(OUTPUTS, columns, strict=True))
    }


def _precision(
    sampled: SampledPattern, accel: FloatArray, estimator: Estimator, noise: RunNoise, gain: float
) -> Precision:
    theory = precision(sampled, Q_FLEX_NOISE_V.in_units_of(gain), HOUR_S, estimator=estimator, sided=SIDED)
    rows, rate_hz = _coarse(weights(sampled, estimator)[:1], sampled.sample_rate_hz)
    lags = covariance(rows, rate_hz, noise, sided=SIDED, lags=_LAGS)[:, 0, 0]
    period_s = sampled.pattern.period_s
    own = math.sqrt(float(lags[0]) * period_s / HOUR_S)
    try:
        measured = measured_precision(accel, period_s, HOUR_S, correlation=(lags[1:] / lags[0]).tolist(), level=LEVEL)
    except DataError:
        measured = None
    return Precision(theory.single_period, own, measured)


def _coarse(rows: FloatArray, rate_hz: float) -> tuple[FloatArray, float]:
    """Weights on a coarser time base, where a period has very many samples."""
    samples = rows.shape[1]
    step = next(d for d in range(1, samples + 1) if samples % d == 0 and samples // d <= _FINE)
    return rows.reshape(len(rows), samples // step, step).sum(axis=2), rate_hz / step


_FINE = 6000


def _without_command(cells: Cells, series: PeriodEstimates, number: int) -> FloatArray:
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
    found, *_ = np.linalg.lstsq(columns / size, accel[seen], rcond=1e-9)
    left = np.full_like(accel, np.nan)
    left[seen] = accel[seen] - (columns / size) @ found
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


def _commanded(cells: Cells) -> FloatArray:
    """What was commanded of a_Z, as the mean over the kept samples of each period."""
    total = np.bincount(cells.period, cells.count * cells.state[:, 0], cells.periods)
    count = np.bincount(cells.period, cells.count, cells.periods)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total / count)


def _response_of(run: PlatformRun, sampled: SampledPattern, series: PeriodEstimates) -> SineResponse | None:
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
    found, *_ = np.linalg.lstsq(columns * root[:, None], cells.state[:, 0] * root)
    return math.atan2(found[1], found[0])


def _wobbles(runs: Sequence[RunResult], chains: Chains) -> dict[str, Value] | None:
    """Of the two sensing axes, from the biases of all runs; None without both electrical biases."""
    if set(chains.bias_v) != set(CHANNELS) or not runs:
        return None
    found = {}
    for name, channel in (("a", "z"), ("b", "y")):
        biases = np.array([run.values[channel]["bias"].value for run in runs])
        biases = biases[np.isfinite(biases)]
        if not biases.size:
            return None
        alone = min(run.values[channel]["bias"].sigma for run in runs)
        sigma = float(biases.std(ddof=1) / math.sqrt(biases.size)) if biases.size > 1 else alone
        found[name] = wobble(
            Value(float(biases.mean()), sigma),
            Value(chains.bias_v[channel], 0.0),
            Value(chains.gain_v_per_m_s2[channel], 0.0),
            chains.g_m_s2,
        )
    return found


def _dropped(cells: Cells) -> dict[str, int]:
    """Samples of dwells that were left out, by reason; lost in both channels counts once."""
    return {name: int(cells.faults[:, :, i].max(axis=1).sum()) for i, name in enumerate(FAULTS[:3])}


def _value(value: Value) -> dict[str, float | None]:
    return {"value": _number(value.value), "sigma": _number(value.sigma)}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


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
