"""What a pattern makes of an external acceleration that varies: sines (fig. 8, eq. 16) and triangles (fig. 7).

Lenoir, Christophe, Reynaud, Measurement 46 (2013) 1411. A bias that follows an external sine is a leak, and by how
much it lags depends on where in its window a value is stamped. Eq. 16 stamps at the start and lags 12.5 min, the
printed 17.5 min are those of the end; here it is the centre, 15 min, unless said otherwise.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.estimators import Estimator, weights
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern

MINUTE_S = 60.0

# Four numbers are fitted; beyond the condition a sine cannot be told from a trend over the record.
_FEWEST_PERIODS, _MAX_CONDITION = 6, 30.0


@dataclass(frozen=True)
class Shift:
    """By how much a response lags the external signal [min], its values stamped at a place of their window."""

    start_min: float
    centre_min: float
    end_min: float


@dataclass(frozen=True)
class SineResponse:
    """Mean acceleration and bias under an external sine: twice the amplitudes [m/s2], and how the bias lags."""

    accel_pp: float
    bias_pp: float
    shift: Shift


def transfer(sampled: SampledPattern, frequency_hz: float, estimator: Estimator = "projection") -> ComplexArray:
    """What the outputs show of an external acceleration exp(2 pi i f t), t being their centre; shape (4,)."""
    wave = np.exp(2j * np.pi * frequency_hz * sampled.time_s)
    return np.asarray(weights(sampled, estimator) @ (sampled.sign * wave))


def expected_sine(
    sampled: SampledPattern, amplitude_m_s2: float, external_period_s: float, estimator: Estimator = "projection"
) -> SineResponse:
    """The response to an external sine without noise; eq. 16 for pattern a, on the masked samples."""
    gain = transfer(sampled, 1.0 / external_period_s, estimator)
    # The third output is the mean bias, which an external signal leaks into.
    shift = _shift(sampled, -float(np.angle(gain[2])), external_period_s)
    accel, bias = 2.0 * amplitude_m_s2 * np.abs(gain[[0, 2]])
    return SineResponse(float(accel), float(bias), shift)


def measured_sine(
    sampled: SampledPattern,
    accel_mean: FloatArray,
    bias_mean: FloatArray,
    external_period_s: float,
    phase_rad: float = 0.0,
) -> SineResponse:
    """The response in what the periods gave, shape (periods,) each; NaN are left out.

    The external signal is sin(2 pi t / T + `phase_rad`), t from the first period's start. Raises `DataError` when the
    periods do not tell the sine.
    """
    accel, bias = (_sine(sampled, values, external_period_s) for values in (accel_mean, bias_mean))
    shift = _shift(sampled, phase_rad - cmath.phase(bias), external_period_s)
    return SineResponse(2.0 * abs(accel), 2.0 * abs(bias), shift)


def _sine(sampled: SampledPattern, values: FloatArray, external_period_s: float) -> complex:
    """A sine of known period, amplitude and phase, fitted with level and trend to values stamped at their centres."""
    period_s = sampled.pattern.period_s
    seen = np.isfinite(values)
    time_s = ((np.arange(values.size) + 0.5) * period_s + sampled.centre_s)[seen]
    angle = 2.0 * np.pi * time_s / external_period_s
    trend = np.linspace(-1.0, 1.0, values.size)[seen]
    columns = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle), trend], axis=1)
    if time_s.size < _FEWEST_PERIODS or not np.linalg.cond(columns) < _MAX_CONDITION:
        raise DataError(
            f"{time_s.size} valid periods of {period_s:g} s do not tell a sine of {external_period_s:g} s: record "
            "longer, or modulate faster"
        )
    coefficients, *_ = np.linalg.lstsq(columns, values[seen])
    return complex(coefficients[0], coefficients[1])


def _shift(sampled: SampledPattern, lag_rad: float, external_period_s: float) -> Shift:
    """The lag, within half a period of the signal, for values stamped at start, centre and end of their window."""
    # A lag and a whole period more look alike: the smallest is meant.
    centre_s = math.remainder(lag_rad, 2.0 * math.pi) * external_period_s / (2.0 * math.pi)
    before_s = 0.5 * sampled.pattern.period_s + sampled.centre_s
    after_s = 0.5 * sampled.pattern.period_s - sampled.centre_s
    return Shift((centre_s - before_s) / MINUTE_S, centre_s / MINUTE_S, (centre_s + after_s) / MINUTE_S)
