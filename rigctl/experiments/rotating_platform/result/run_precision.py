"""How well the means of one run are known: by its own noise, by theory, by the scatter of its periods."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import covariance, covariance_of_mean
from rigctl.experiments.rotating_platform.observe.estimates import PeriodEstimates
from rigctl.experiments.rotating_platform.observe.estimators import Estimator, coarser, weights
from rigctl.experiments.rotating_platform.observe.noise import PowerLawNoise
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern
from rigctl.experiments.rotating_platform.observe.run_noise import SIDED, RunNoise
from rigctl.experiments.rotating_platform.result.alignment import Value
from rigctl.experiments.rotating_platform.result.precision import MeasuredPrecision, measured_precision, precision

HOUR_S = 3600.0
LEVEL = 0.99

OUTPUTS = ("accel", "accel_slope", "bias", "bias_slope")
_BEYOND_RECORD = 0.2
_LAGS = 8
_FINE = 6000


@dataclass(frozen=True)
class Precision:
    """Of the mean acceleration in an hour [m/s2]: `theory` by the chain's noise, and by the run's own spectrum."""

    theory: float
    by_own_spectrum: float
    measured: MeasuredPrecision | None

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        measured = self.measured
        return {
            "theory": self.theory,
            "theory_own_spectrum": self.by_own_spectrum,
            "measured": None if measured is None else measured.sigma,
            "interval_99": None if measured is None else list(measured.interval),
        }


def run_means(
    sampled: SampledPattern, series: PeriodEstimates, number: int, estimator: Estimator, noise: RunNoise
) -> dict[str, Value]:
    """Means of the four outputs over the valid periods of a channel, by name."""
    valid = np.isfinite(series.accel_mean[:, number])
    if not valid.any():
        return dict.fromkeys(OUTPUTS, Value(math.nan, math.nan))
    rows, rate_hz = coarser(weights(sampled, estimator), sampled.sample_rate_hz, _FINE)
    periods = int(valid.sum())
    from_hz = _BEYOND_RECORD / (len(series) * sampled.pattern.period_s)
    spread = covariance_of_mean(rows, rate_hz, noise, periods, sided=SIDED, from_hz=from_hz)
    columns = (series.accel_mean, series.accel_slope, series.bias_mean, series.bias_slope)
    return {
        name: Value(float(column[valid, number].mean()), math.sqrt(float(spread[i, i])))
        for i, (name, column) in enumerate(zip(OUTPUTS, columns, strict=True))
    }


def run_precision(
    sampled: SampledPattern, accel: FloatArray, estimator: Estimator, noise: RunNoise, chain: PowerLawNoise
) -> Precision:
    """Precision of a run's mean acceleration in an hour, from `accel`, shape (periods,), and the `chain`'s noise."""
    theory = precision(sampled, chain, HOUR_S, estimator=estimator, sided=SIDED)
    rows, rate_hz = coarser(weights(sampled, estimator)[:1], sampled.sample_rate_hz, _FINE)
    lags = covariance(rows, rate_hz, noise, sided=SIDED, lags=_LAGS)[:, 0, 0]
    period_s = sampled.pattern.period_s
    own_spectrum = math.sqrt(float(lags[0]) * period_s / HOUR_S)
    try:
        measured = measured_precision(accel, period_s, HOUR_S, correlation=(lags[1:] / lags[0]).tolist(), level=LEVEL)
    except DataError:
        measured = None
    return Precision(theory, own_spectrum, measured)
