"""How well a pattern knows what it estimates in a given time, from the noise spectrum or from the scatter.

There are two ways to a time T. From one period by sqrt(tau/T) is what the scatter of the periods' values measures.
Averaging many successive periods leaves the harmonics of the period only: Var = (1/T) sum of S2(n/tau) |W(n/tau)|^2
over n != 0, in the notation of `covariance`. Where successive values are correlated, as for pattern a, they differ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import Sided, covariance, two_sided
from rigctl.experiments.rotating_platform.observe.estimators import OUTPUTS, Estimator, weights
from rigctl.experiments.rotating_platform.observe.noise import Density, PowerLawNoise
from rigctl.experiments.rotating_platform.observe.patterns import Pattern, SampledPattern

_ZERO = 1e-9
_HARMONICS = 2**12
_NEAR_ONE = 1e-3


@dataclass(frozen=True)
class Precision:
    """Standard uncertainties of `output` for an integration time, and the convention `sided` of the density.

    `single_period`: of one period times sqrt(tau/T), what a scatter measures; `many_periods`: of the mean of
    successive periods in the limit (slowly reached by pattern a: `covariance.covariance_of_mean` is exact), infinite
    for what the noise makes wander without end.
    """

    output: str
    integration_s: float
    sided: Sided
    single_period: float
    many_periods: float


def precision(
    sampled: SampledPattern,
    density: Density,
    integration_s: float,
    *,
    output: str = "accel_mean",
    estimator: Estimator = "projection",
    sided: Sided = 2,
) -> Precision:
    """The precision of one of `OUTPUTS` from samples up to the Nyquist frequency, for any density."""
    row = weights(sampled, estimator)[OUTPUTS.index(output)]
    variance = float(covariance(row[None], sampled.sample_rate_hz, density, sided=sided)[0, 0, 0])
    single = math.sqrt(variance * sampled.pattern.period_s / integration_s)
    many = (
        math.inf if math.isinf(variance) else math.sqrt(_of_harmonics(sampled, row, density, sided) / integration_s)
    )
    return Precision(output, integration_s, sided, single, many)


def continuous_precision(
    pattern: Pattern, noise: PowerLawNoise, integration_s: float, *, sided: Sided = 2
) -> Precision:
    """The precision of the mean acceleration in continuous time, by projection, in closed form.

    For exponents below 3; infinite for a pattern with unequal times at 0 and half a turn when the exponent is 1 or
    more. Raises `DataError` for other exponents.
    """
    if not 0.0 <= noise.exponent < 3.0:
        raise DataError(f"noise as f^-{noise.exponent:g}: the precision is known for exponents from 0 to below 3")
    kept_s = pattern.kept_s
    white = 0.5 * sided * noise.white / kept_s
    coefficient = 0.5 * sided * noise.coefficient / kept_s**2
    single = many = 0.0
    if coefficient > 0.0:
        single, many = _power_law_integral(pattern, noise.exponent), _power_law_sum(pattern, noise.exponent)
    scale = pattern.period_s / integration_s
    return Precision(
        "accel_mean",
        integration_s,
        sided,
        math.sqrt((white + coefficient * single) * scale),
        math.sqrt((white + coefficient * many) * scale),
    )


def simplified_precision(density: Density, period_s: float, integration_s: float, *, sided: Sided = 2) -> float:
    """The density at 1/tau alone, over the time (Measurement 46 (2013) 1411, eq. 17): up to 83 % too high."""
    value = two_sided(density, sided, np.array([1.0 / period_s]))
    return float(np.sqrt(value[0] / integration_s))


@dataclass(frozen=True)
class MeasuredPrecision:
    """Precision for an integration time from the scatter of `periods` values, with its interval (chi-squared)."""

    integration_s: float
    sigma: float
    interval: tuple[float, float]
    level: float
    periods: int


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
    share = 1.0 - np.arange(1, rho.size + 1) / kept.size
    # Removing the mean of n values takes the variance of that mean from the expectation of the scatter.
    removed = (1.0 + 2.0 * float(share @ rho)) / kept.size
    variance = float(((kept - kept.mean()) ** 2).mean()) / (1.0 - removed)
    dof = (kept.size - 1) / (1.0 + 2.0 * float(share @ rho**2))
    sigma = math.sqrt(variance * period_s / integration_s)
    low, high = (sigma * math.sqrt(dof / stats.chi2.ppf(p, dof)) for p in (0.5 + 0.5 * level, 0.5 - 0.5 * level))
    return MeasuredPrecision(integration_s, sigma, (float(low), float(high)), level, kept.size)


@dataclass(frozen=True)
class Mean:
    """A mean over periods, its standard uncertainty and its interval (Student)."""

    value: float
    sigma: float
    interval: tuple[float, float]
    level: float
    periods: int


def mean_of_periods(values: FloatArray, *, correlation: Sequence[float] = (), level: float = 0.99) -> Mean:
    """The mean of the periods' `values` with what their own scatter says of it; arguments as `measured_precision`."""
    found = measured_precision(values, 1.0, 1.0, correlation=correlation, level=level)
    kept = values[np.isfinite(values)]
    rho = np.asarray(correlation, dtype=np.float64)[: kept.size - 1]
    lag = np.arange(1, rho.size + 1)
    sigma = found.sigma * math.sqrt(max(0.0, 1.0 + 2.0 * float((1.0 - lag / kept.size) @ rho)) / kept.size)
    half = float(stats.t.ppf(0.5 + 0.5 * level, kept.size - 1)) * sigma
    value = float(kept.mean())
    return Mean(value, sigma, (value - half, value + half), level, kept.size)


def _of_harmonics(sampled: SampledPattern, row: FloatArray, density: Density, sided: Sided) -> float:
    """Sum of S2 |W|^2 over the harmonics of the period, both signs, but zero."""
    transform = np.fft.rfft(row)[1:]
    frequency = np.arange(1, transform.size + 1) / sampled.pattern.period_s
    power = two_sided(density, sided, frequency) * np.abs(transform) ** 2
    last = 1.0 if row.size % 2 == 0 else 2.0
    return float(2.0 * power[:-1].sum() + last * power[-1])


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


def _power_law_sum(pattern: Pattern, exponent: float) -> float:
    """Sum of |C(n/tau)|^2 / |n/tau|^exponent over n != 0, over tau."""
    frequency = np.arange(1, _HARMONICS + 1) / pattern.period_s
    transform = np.zeros(frequency.size, dtype=np.complex128)
    for dwell in pattern.dwells:
        length, middle = dwell.stop_s - dwell.start_s, dwell.start_s + dwell.stop_s
        transform += dwell.sign * length * np.sinc(frequency * length) * np.exp(-1j * np.pi * frequency * middle)
    return float(2.0 * (frequency**-exponent) @ np.abs(transform) ** 2 / pattern.period_s)
