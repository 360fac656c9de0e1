"""White noise, a power law and a pendulum's rise fitted to a spectrum by Whittle's likelihood.

A density is exponentially distributed about its expectation, the mean of several as a gamma: that likelihood, not
least squares of logarithms, has no bias at the lowest frequencies, where single bins must do. The form is that of
Lenoir, Christophe, Reynaud, Measurement 46 (2013) 1411, eq. 1, and what the pendulum under the chain adds where that
shows: without it the white level would take it up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.covariance import PENDULUM_CORNER_HZ, PowerLawNoise, pendulum_rise
from rigctl.experiments.rotating_platform.observe.spectrum import NoiseSpectrum, expected

# What is free of ln white, ln power law at the reference frequency, exponent, ln pendulum; two are simpler noise.
_BOTH, _WHITE, _POWER_LAW, _PENDULUM = (0, 1, 2), (0,), (1, 2), 3
# At 0 a power law is white noise; what tapers make of one is known below 3.
_SLOPES = (0.05, 2.9)
_STARTS = np.arange(0.2, 2.9, 0.3)
_STEP = 1e-4
_MAX_STEPS, _SETTLED = 60, 1e-6
# Two parameters more gain this much by chance in one record out of a thousand, one in one out of five thousand.
_BY_CHANCE = 6.9
_BY_CHANCE_OF_ONE = 5.4
_SMALL_PENDULUM = 0.05
_FEWEST_BANDS = 6


@dataclass(frozen=True)
class NoiseFit:
    """A noise spectrum of eq. 1's form, two-sided, beside a `pendulum` of this density below its corner.

    `covariance` is that of (white, coefficient, exponent, pendulum); NaN for a part that the record does not show,
    which is zero then. It is that of long records: with 50 bins below the corner it is too small by half in variance,
    with 100 and more it is right.
    """

    noise: PowerLawNoise
    pendulum: float
    covariance: FloatArray

    @property
    def sigmas(self) -> tuple[float, float, float, float]:
        """Standard uncertainties of white level, coefficient, exponent and pendulum."""
        white, coefficient, exponent, pendulum = np.sqrt(np.diag(self.covariance)).tolist()
        return white, coefficient, exponent, pendulum

    def __call__(self, frequency_hz: FloatArray) -> FloatArray:
        """The density of all parts at positive frequencies."""
        return np.asarray(self.noise(frequency_hz) + self.pendulum * pendulum_rise(frequency_hz))


def fit_noise(spectrum: NoiseSpectrum) -> NoiseFit:
    """Fit white noise and a power law, or one of them alone where the other does not show; a pendulum if it does.

    Raises `DataError` for fewer than six bands, and for a record without noise.
    """
    silent = np.count_nonzero(~(spectrum.density > 0.0))
    if spectrum.first.size < _FEWEST_BANDS or silent:
        raise DataError(
            f"{spectrum.first.size} bands of a spectrum, {silent} of them without power, tell no noise: "
            "record longer, and a signal that is not constant"
        )
    best = _minimum(spectrum, _BOTH)
    for simpler in (_minimum(spectrum, _POWER_LAW), _minimum(spectrum, _WHITE)):
        if simpler.cost < best.cost + _BY_CHANCE:
            best = simpler
    above = spectrum.density[spectrum.frequency_hz > PENDULUM_CORNER_HZ]
    if above.size:
        start = best.parameters.copy()
        # So small that it does no harm where there is none, and large enough to have a gradient.
        start[_PENDULUM] = np.log(_SMALL_PENDULUM * above.min() / pendulum_rise(spectrum.frequency_hz).max())
        with_pendulum = _minimum_from(spectrum, (*best.free, _PENDULUM), start, best.reference_hz)
        if with_pendulum.cost < best.cost - _BY_CHANCE_OF_ONE:
            best = with_pendulum
    return _result(spectrum, best)


class _Minimum(NamedTuple):
    """Where the likelihood is highest with `free` parameters; those that are not are minus infinity or zero."""

    free: tuple[int, ...]
    parameters: FloatArray
    cost: float
    reference_hz: float


def _minimum(spectrum: NoiseSpectrum, free: tuple[int, ...]) -> _Minimum:
    reference_hz = float(np.exp(np.log(spectrum.frequency_hz).mean()))
    starts = _starts(spectrum, free, reference_hz)
    start = min(starts, key=lambda each: _cost(spectrum, each, reference_hz))
    return _minimum_from(spectrum, free, start, reference_hz)


def _minimum_from(spectrum: NoiseSpectrum, free: tuple[int, ...], start: FloatArray, reference_hz: float) -> _Minimum:
    return _scored(spectrum, _Minimum(free, start, _cost(spectrum, start, reference_hz), reference_hz))


def _starts(spectrum: NoiseSpectrum, free: tuple[int, ...], reference_hz: float) -> list[FloatArray]:
    """Levels that match the relative densities, for some exponents."""
    if free == _WHITE:
        return [np.array([np.log(np.average(spectrum.density, weights=spectrum.weight)), -np.inf, 0.0, -np.inf])]
    starts = []
    for exponent in _STARTS:
        shape = expected(spectrum, exponent) * reference_hz**exponent
        columns = np.stack([np.ones_like(shape) if 0 in free else np.zeros_like(shape), shape], axis=1)
        root = np.sqrt(spectrum.weight) / spectrum.density
        levels, _ = nnls(columns * root[:, None], np.sqrt(spectrum.weight))
        # A level that comes out as nil has no logarithm to begin from.
        floor = 1e-3 * spectrum.density.min()
        white = np.log(max(levels[0], floor)) if 0 in free else -np.inf
        starts.append(np.array([white, np.log(max(levels[1], floor)), exponent, -np.inf]))
    return starts


def _parts(spectrum: NoiseSpectrum, parameters: FloatArray, reference_hz: float) -> FloatArray:
    """White noise, power law and pendulum as the bands should show them, shape (3, bands)."""
    white, level, exponent, pendulum = parameters
    power_law = np.exp(level) * reference_hz**exponent * expected(spectrum, exponent)
    return np.stack(
        [np.full_like(power_law, np.exp(white)), power_law, np.exp(pendulum) * pendulum_rise(spectrum.frequency_hz)]
    )


def _cost(spectrum: NoiseSpectrum, parameters: FloatArray, reference_hz: float) -> float:
    model = _parts(spectrum, parameters, reference_hz).sum(axis=0)
    return float(spectrum.weight @ (np.log(model) + spectrum.density / model))


def _gradients(spectrum: NoiseSpectrum, at: _Minimum) -> tuple[FloatArray, FloatArray]:
    """The model and the derivatives of its logarithm by the free parameters, shapes (bands,) and (free, bands)."""
    white, power_law, pendulum = _parts(spectrum, at.parameters, at.reference_hz)
    model = white + power_law + pendulum
    step = np.array([0.0, 0.0, _STEP, 0.0])
    above, below = (_parts(spectrum, at.parameters + sign * step, at.reference_hz)[1] for sign in (1.0, -1.0))
    # What a band shows of a power law is a sum over its bins: by the exponent a difference is simplest.
    slope = (above - below) / (2.0 * _STEP)
    return model, np.stack([white, power_law, slope, pendulum])[list(at.free)] / model


def _scored(spectrum: NoiseSpectrum, at: _Minimum) -> _Minimum:
    """Fisher scoring, with steps halved until they descend."""
    for _ in range(_MAX_STEPS):
        model, gradient = _gradients(spectrum, at)
        score = (gradient * spectrum.weight) @ (spectrum.density / model - 1.0)
        step = np.linalg.lstsq((gradient * spectrum.weight) @ gradient.T, score, rcond=1e-12)[0]
        # An e-fold at most: the likelihood is far from a parabola.
        step = step / max(1.0, float(np.abs(step).max()))
        while True:
            parameters = at.parameters.copy()
            parameters[list(at.free)] += step
            parameters[2] = np.clip(parameters[2], *_SLOPES) if 2 in at.free else 0.0
            cost = _cost(spectrum, parameters, at.reference_hz)
            if cost <= at.cost or np.abs(step).max() < _SETTLED:
                break
            step = 0.5 * step
        if cost <= at.cost:
            at = at._replace(parameters=parameters, cost=cost)
        if np.abs(step).max() < _SETTLED:
            break
    return at


def _result(spectrum: NoiseSpectrum, found: _Minimum) -> NoiseFit:
    _, gradient = _gradients(spectrum, found)
    free = list(found.free)
    information = (gradient * spectrum.weight) @ gradient.T
    white, level, pendulum = np.exp(found.parameters[[0, 1, _PENDULUM]])
    exponent = found.parameters[2]
    coefficient = level * found.reference_hz**exponent
    # From logarithms of levels, the second at the reference frequency, to eq. 1's numbers.
    turn = np.diag([white, coefficient, 1.0, pendulum])
    turn[1, 2] = coefficient * np.log(found.reference_hz)
    covariance = np.full((4, 4), np.nan)
    covariance[np.ix_(free, free)] = np.linalg.inv(information)
    turned = turn[np.ix_(free, free)] @ covariance[np.ix_(free, free)] @ turn[np.ix_(free, free)].T
    covariance[np.ix_(free, free)] = turned
    noise = PowerLawNoise(float(white), float(coefficient), float(exponent))
    return NoiseFit(noise, float(pendulum), covariance)
