"""How well a pattern knows what it estimates in a given time, from the noise spectrum or from the scatter.

An integration time T is reached from one period by sqrt(tau/T): that is what the scatter of the periods' values
measures. What the mean of many successive periods is uncertain by, their correlation included, is
`covariance.covariance_of_mean`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy import special

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import (
    Density,
    PowerLawNoise,
    Sided,
    covariance,
    covariance_of_mean,
    two_sided,
)
from rigctl.experiments.rotating_platform.observe.estimates import PeriodEstimates
from rigctl.experiments.rotating_platform.observe.estimators import OUTPUTS, Estimator, coarser, weights
from rigctl.experiments.rotating_platform.observe.patterns import Pattern, SampledPattern
from rigctl.experiments.rotating_platform.observe.run_noise import SIDED, RunNoise
from rigctl.experiments.rotating_platform.result.alignment import Value

_ZERO = 1e-9
_NEAR_ONE = 1e-3


def precision(
    sampled: SampledPattern,
    density: Density,
    integration_s: float,
    *,
    output: str = "accel_mean",
    estimator: Estimator = "projection",
    sided: Sided = 2,
) -> float:
    """The standard uncertainty of one of `OUTPUTS` from samples up to the Nyquist frequency, for any density."""
    row = weights(sampled, estimator)[OUTPUTS.index(output)]
    variance = float(covariance(row[None], sampled.sample_rate_hz, density, sided=sided)[0, 0, 0])
    return math.sqrt(variance * sampled.pattern.period_s / integration_s)


def continuous_precision(pattern: Pattern, noise: PowerLawNoise, integration_s: float, *, sided: Sided = 2) -> float:
    """The standard uncertainty of the mean acceleration in continuous time, by projection, in closed form.

    For exponents below 3; infinite for a pattern with unequal times at 0 and half a turn when the exponent is 1 or
    more. Raises `DataError` for other exponents.
    """
    if not 0.0 <= noise.exponent < 3.0:
        raise DataError(f"noise as f^-{noise.exponent:g}: the precision is known for exponents from 0 to below 3")
    variance = noise.white / pattern.kept_s
    if noise.coefficient > 0.0:
        variance += noise.coefficient / pattern.kept_s**2 * _power_law_integral(pattern, noise.exponent)
    return math.sqrt(0.5 * sided * variance * (pattern.period_s / integration_s))


def simplified_precision(density: Density, period_s: float, integration_s: float) -> float:
    """The density at 1/tau alone, over the time (Measurement 46 (2013) 1411, eq. 17): up to 83 % too high."""
    value = two_sided(density, 2, np.array([1.0 / period_s]))
    return float(np.sqrt(value[0] / integration_s))


@dataclass(frozen=True)
class MeasuredPrecision:
    """Precision for an integration time from the scatter of the periods' values, with its interval (chi-squared)."""

    sigma: float
    interval: tuple[float, float]


def measured_precision(
    values: FloatArray,
    period_s: float,
    integration_s: float,
    *,
    correlation: Sequence[float] = (),
    level: float = 0.99,
) -> MeasuredPrecision:
    """What the scatter of the periods' `values`, shape (periods,), says of the precision; NaN are left out.

    `correlation` is that of successive values, at lag 1, 2, ..., where they are correlated: it takes degrees of
    freedom. Raises `DataError` for fewer than two values.
    """
    kept = values[np.isfinite(values)]
    if kept.size < 2:
        raise DataError(f"{kept.size} valid periods have no scatter: record at least two")
    rho = np.asarray(correlation, dtype=np.float64)[: kept.size - 1]
    # Pairs so far apart, as a part of all values.
    share = 1.0 - np.arange(1, rho.size + 1) / kept.size
    # Removing the mean of n values takes the variance of that mean from the expectation of the scatter.
    removed = (1.0 + 2.0 * float(share @ rho)) / kept.size
    variance = float(((kept - kept.mean()) ** 2).mean()) / (1.0 - removed)
    dof = (kept.size - 1) / (1.0 + 2.0 * float(share @ rho**2))
    sigma = math.sqrt(variance * period_s / integration_s)
    # Of a chi-square the larger value for the lower end.
    low, high = (sigma * math.sqrt(dof / special.chdtri(dof, p)) for p in (0.5 - 0.5 * level, 0.5 + 0.5 * level))
    return MeasuredPrecision(sigma, (float(low), float(high)))


def _power_law_integral(pattern: Pattern, exponent: float) -> float:
    """Integral of |C(f)|^2 / |f|^exponent over both signs of f, C the transform of c over the dwells.

    The transform of |f|^-g is proportional to |t|^(g-1), whose double integral over a pair of dwells is a second
    difference of |t|^(g+1).
    """
    if abs(exponent - 1.0) < 0.5 * _NEAR_ONE:
        # The pole there cancels between dwells of either sign: the mean of both sides is right to its square.
        return 0.5 * sum(_power_law_integral(pattern, 1.0 + side * _NEAR_ONE) for side in (-1.0, 1.0))
    sign = np.array([dwell.sign for dwell in pattern.dwells], dtype=np.float64)
    start = np.array([dwell.start_s for dwell in pattern.dwells])
    stop = np.array([dwell.stop_s for dwell in pattern.dwells])
    balance = abs(float(sign @ (stop - start)))
    if exponent > 1.0 - _NEAR_ONE and balance > _ZERO * pattern.kept_s:
        return math.inf

    def power(later: FloatArray, earlier: FloatArray) -> FloatArray:
        return np.asarray(np.abs(later[:, None] - earlier) ** (exponent + 1.0))

    pairs = power(stop, start) + power(start, stop) - power(start, start) - power(stop, stop)
    factor = (2.0 * math.pi) ** exponent / (2.0 * math.gamma(exponent) * math.cos(0.5 * math.pi * exponent))
    return float(factor / (exponent * (exponent + 1.0)) * (sign @ pairs @ sign))


HOUR_S = 3600.0
LEVEL = 0.99

MEANS = ("accel", "accel_slope", "bias", "bias_slope")
_BEYOND_RECORD = 0.2
_LAGS = 8
# Samples a period: rates from 10 to 200 Hz change the precision by less than 0.07 %.
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
        return dict.fromkeys(MEANS, Value(math.nan, math.nan))
    rows, rate_hz = coarser(weights(sampled, estimator), sampled.sample_rate_hz, _FINE)
    periods = int(valid.sum())
    from_hz = _BEYOND_RECORD / (len(series) * sampled.pattern.period_s)
    spread = covariance_of_mean(rows, rate_hz, noise, periods, sided=SIDED, from_hz=from_hz)
    columns = (series.accel_mean, series.accel_slope, series.bias_mean, series.bias_slope)
    # What is left of a period with faults tells less, its slopes above all.
    excess = series.excess[:, valid, number].mean(axis=1)
    return {
        name: Value(float(column[valid, number].mean()), math.sqrt(float(spread[i, i] * excess[i % 2])))
        for i, (name, column) in enumerate(zip(MEANS, columns, strict=True))
    }


def run_precision(
    sampled: SampledPattern, accel: FloatArray, estimator: Estimator, noise: RunNoise, chain: PowerLawNoise
) -> Precision:
    """Precision of a run's mean acceleration in an hour, from `accel`, shape (periods,), and the `chain`'s noise."""
    # The chain's noise says what the paper's table 4 states; the run's own spectrum has the pendulum's in it.
    theory = _theory(sampled, chain, estimator)
    rows, rate_hz = coarser(weights(sampled, estimator)[:1], sampled.sample_rate_hz, _FINE)
    lags = covariance(rows, rate_hz, noise, sided=SIDED, lags=_LAGS)[:, 0, 0]
    period_s = sampled.pattern.period_s
    own_spectrum = math.sqrt(float(lags[0]) * period_s / HOUR_S)
    try:
        measured = measured_precision(accel, period_s, HOUR_S, correlation=(lags[1:] / lags[0]).tolist(), level=LEVEL)
    except DataError:
        measured = None
    return Precision(theory, own_spectrum, measured)


@lru_cache(maxsize=64)
def _theory(sampled: SampledPattern, chain: PowerLawNoise, estimator: Estimator) -> float:
    """In an hour; runs of one pattern ask it again and again."""
    return precision(sampled, chain, HOUR_S, estimator=estimator, sided=SIDED)
