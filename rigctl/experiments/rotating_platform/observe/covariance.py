"""The form of a chain's noise, and the general uncertainty formula: covariances of what is estimated under it.

An output sum_k w_k m_k of the samples of a period has the variance

    Var = integral of S2(f) |W(f)|^2 df,  W(f) = sum_k w_k exp(-2 pi i f k / f_s),

over both signs of f up to the Nyquist frequency, S2 being the two-sided density. Everything is folded onto one
interval of 1/tau: the phase between successive periods depends on the place in it only. There the sum over all
harmonics but the lowest is smooth, and a dozen Fourier transforms tell it; next to f = 0, where the density may
diverge, the transform of the weights is.

`sided` says which density is given: 2 for one over both signs of f, as that of Lenoir, Christophe, Reynaud,
Measurement 46 (2013) 1411, eq. 1; 1 for the usual estimates over positive frequencies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.polynomial import chebyshev, legendre

from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray
from rigctl.core.errors import DataError

Density = Callable[[FloatArray], FloatArray]
"""A noise spectrum: density over positive frequency [Hz]. Where it is used `sided` says if one-sided or two-sided."""


@dataclass(frozen=True)
class PowerLawNoise:
    """S(f) = `white` + `coefficient` / f^`exponent`, a `Density` [unit^2/Hz].

    The form of Lenoir, Christophe, Reynaud, Measurement 46 (2013) 1411, eq. 1.
    """

    white: float
    coefficient: float
    exponent: float

    def __call__(self, frequency_hz: FloatArray) -> FloatArray:
        """The density at positive frequencies."""
        return np.asarray(self.white + self.coefficient * np.power(frequency_hz, -self.exponent))

    def in_units_of(self, unit: float) -> PowerLawNoise:
        """The noise of the signal divided by `unit`: of the output over the scale factor, for an acceleration."""
        return PowerLawNoise(self.white / unit**2, self.coefficient / unit**2, self.exponent)


def pendulum_rise(frequency_hz: FloatArray) -> FloatArray:
    """The density of a pendulum's noise over its floor: the amplitude rises as f^2 above 0.2 Hz, to a hundred."""
    return np.asarray(np.clip(np.asarray(frequency_hz) / PENDULUM_CORNER_HZ, 1.0, 10.0) ** 4)


PENDULUM_CORNER_HZ = 0.2

Q_FLEX_NOISE_V = PowerLawNoise(3.1925e-5, 9.052e-8, 1.6384)
"""Noise of a Q-Flex chain at its output [V^2/Hz], eq. 1 of the paper. It is two-sided: only so does it give the
theoretical precision of table 4, with pattern c of one minute."""


Sided = Literal[1, 2]

# Errors of 1e-9: of the sum over harmonics, which varies as 1 / (1 + x)^2, and of one turn of the transform.
_HARMONIC_NODES, _TRANSFORM_NODES = 12, 32
_NODES = 8
# Next to zero in steps of 4, where the density may diverge.
_GRADING = 20
_ZERO = 1e-9
_COLUMNS = 2**14
_KEPT_NUMBERS = 2**15
"""Transforms of no more weights are kept."""


def two_sided(density: Density, sided: Sided, frequency_hz: FloatArray) -> FloatArray:
    """The two-sided density."""
    return 0.5 * sided * density(frequency_hz)


def covariance(
    weights: FloatArray,
    sample_rate_hz: float,
    density: Density,
    *,
    sided: Sided = 2,
    lags: int = 0,
    from_hz: float = 0.0,
) -> FloatArray:
    """Covariance of the outputs of one period with those of the same and of later ones.

    `weights` are those of a period's samples in each output, shape (outputs, samples). Gives shape (lags + 1,
    outputs, outputs): [j, a, b] is the covariance of output a with output b of j periods before. `from_hz`, below one
    over the period, leaves out what a record of finite length does not hold; without it an output that passes
    diverging noise has an infinite variance, and covariances with others that are NaN. Raises `DataError` for a
    `from_hz` beyond.
    """
    (found,) = covariances(weights, sample_rate_hz, [density], sided=sided, lags=lags, from_hz=from_hz)
    return np.asarray(found)


def covariances(
    weights: FloatArray,
    sample_rate_hz: float,
    densities: Sequence[Density],
    *,
    sided: Sided = 2,
    lags: int = 0,
    from_hz: float = 0.0,
) -> FloatArray:
    """`covariance` under each of several densities, shape (densities, lags + 1, outputs, outputs): the weights are
    transformed once."""
    folded = _fold(weights, sample_rate_hz, densities, sided, from_hz, lags + 1)
    turn = np.exp(2j * np.pi * folded.place)
    # Powers one after the other: a twentieth of the time of so many exponentials.
    phase = np.multiply.accumulate([np.ones_like(turn), *[turn] * lags])
    return folded.integral(phase)


def covariance_of_mean(
    weights: FloatArray,
    sample_rate_hz: float,
    density: Density,
    periods: int,
    *,
    sided: Sided = 2,
    from_hz: float = 0.0,
) -> FloatArray:
    """Covariance of the outputs' means over `periods` successive periods, shape (outputs, outputs).

    Their correlation is in it, that over the whole record too. Arguments, infinities and errors as for `covariance`.
    """
    folded = _fold(weights, sample_rate_hz, [density], sided, from_hz, periods)
    place = folded.place
    # Fejer's kernel: what a mean over successive periods lets through.
    kernel = (np.sin(np.pi * periods * place) / (periods * np.sin(np.pi * place))) ** 2
    return np.asarray(folded.integral(kernel[None].astype(np.complex128))[0, 0])


@dataclass(frozen=True)
class _Folded:
    """The cross-spectra of the outputs folded onto one interval 1/tau, as quadrature.

    `place` in it, shape (nodes,); `values` with their shares, shape (nodes, densities, outputs, outputs); `divergent`
    (densities, outputs).
    """

    place: FloatArray
    values: ComplexArray
    divergent: BoolArray

    def integral(self, kernel: ComplexArray) -> FloatArray:
        """Over kernels of shape (kernels, nodes); shape (densities, kernels, outputs, outputs)."""
        integrals = np.tensordot(kernel, self.values, axes=1).real.swapaxes(0, 1)
        for found, divergent in zip(integrals, self.divergent, strict=True):
            found[:, divergent[:, None] | divergent] = np.nan
            found[:, divergent, divergent] = np.inf
        return np.asarray(integrals)


def _fold(
    weights: FloatArray,
    sample_rate_hz: float,
    densities: Sequence[Density],
    sided: Sided,
    from_hz: float,
    panels: int,
) -> _Folded:
    """Cross-spectra with nodes for kernels that make up to `panels` turns over the interval."""
    width_hz = sample_rate_hz / weights.shape[1]
    if not 0.0 <= from_hz < width_hz:
        raise DataError(f"from_hz is {from_hz:g}: it must be below one over the period, {width_hz:g} Hz")
    even = np.linspace(0.0, 1.0, panels + 1)
    place, share = gauss_nodes(even)
    smooth = _harmonics(weights, width_hz, densities, sided, place) * share[:, None, None, None]
    lowest = max(from_hz / width_hz, 4.0**-_GRADING)
    edges = np.union1d(even, 4.0 ** -np.arange(float(_GRADING)))
    low, low_share = gauss_nodes(np.append(lowest, edges[edges > lowest]))
    transform = _transform(weights, low)
    # Twice, for the interval on the other side of zero.
    value = 2.0 * low_share * np.stack([two_sided(each, sided, low * width_hz) for each in densities])
    products = np.einsum("af,bf->fab", transform.conj(), transform)
    singular = value.T[:, :, None, None] * products[:, None]
    divergent = np.zeros((len(densities), len(weights)), dtype=np.bool_)
    if from_hz == 0.0:
        passing = np.abs(weights.sum(axis=1)) > _ZERO * np.abs(weights).sum(axis=1)
        divergent[[_diverges(each, width_hz) for each in densities]] = passing
    values = np.concatenate([smooth, singular]) * width_hz
    return _Folded(np.concatenate([place, low]), values, divergent)


def gauss_nodes(edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gauss's nodes and shares on each interval between `edges`."""
    nodes, shares = legendre.leggauss(_NODES)
    width = np.diff(edges)[:, None]
    return (edges[:-1, None] + 0.5 * width * (nodes + 1.0)).ravel(), (0.5 * width * shares).ravel()


def _harmonics(
    weights: FloatArray, width_hz: float, densities: Sequence[Density], sided: Sided, place: FloatArray
) -> ComplexArray:
    """Sum over all intervals but the two next to zero, by its Legendre series.

    Shape (places, densities, outputs, outputs).
    """
    samples = weights.shape[1]
    order, interval = np.arange(_HARMONIC_NODES), np.arange(1, samples - 1)
    series = np.zeros((_HARMONIC_NODES, len(densities), len(weights), len(weights)), dtype=np.complex128)
    for node, share, transform in _at_nodes(weights):
        # Beyond half the sampling rate the transform's places are negative frequencies.
        x = 0.5 * (node + 1.0)
        frequency_hz = np.minimum(interval + x, samples - interval - x) * width_hz
        conjugate, turned = transform.conj(), transform.T
        matrices = np.stack([(conjugate * two_sided(each, sided, frequency_hz)) @ turned for each in densities])
        polynomials = legendre.legvander(np.array([node]), _HARMONIC_NODES - 1)[0]
        along = ((order + 0.5) * share * polynomials)[:, None, None, None]
        # Weights are real: at the node of the other sign the places are these, backwards and with the other sign.
        series += along * matrices + (-1.0) ** order[:, None, None, None] * along * matrices.conj()
    return np.asarray(np.tensordot(legendre.legvander(2.0 * place - 1.0, _HARMONIC_NODES - 1), series, axes=1))


def _at_nodes(weights: FloatArray) -> Iterable[tuple[float, float, ComplexArray]]:
    """The positive nodes of `_HARMONIC_NODES`, their shares, and W at them in every interval but the outer ones,
    (outputs, samples - 2)."""
    if weights.size > _KEPT_NUMBERS:
        return _shifted_transforms(weights)
    return _kept_transforms(weights.tobytes(), len(weights))


# Runs of one pattern have the same weights.
@lru_cache(maxsize=16)
def _kept_transforms(weights: bytes, outputs: int) -> list[tuple[float, float, ComplexArray]]:
    return list(_shifted_transforms(np.frombuffer(weights).reshape(outputs, -1)))


def _shifted_transforms(weights: FloatArray) -> Iterator[tuple[float, float, ComplexArray]]:
    samples = weights.shape[1]
    nodes, shares = legendre.leggauss(_HARMONIC_NODES)
    for node, share in zip(nodes[nodes > 0.0], shares[nodes > 0.0], strict=True):
        shifted = weights * np.exp(-1j * np.pi * (node + 1.0) * np.arange(samples) / samples)
        yield float(node), float(share), np.fft.fft(shifted)[:, 1:-1]


def _transform(weights: FloatArray, place: FloatArray) -> ComplexArray:
    """W between zero and one over the period, shape (outputs, places), by its Chebyshev series."""
    small = weights.size <= _KEPT_NUMBERS
    series = _kept_series(weights.tobytes(), len(weights)) if small else _chebyshev_series(weights)
    return np.asarray((chebyshev.chebvander(2.0 * place - 1.0, _TRANSFORM_NODES - 1) @ series).T)


@lru_cache(maxsize=16)
def _kept_series(weights: bytes, outputs: int) -> ComplexArray:
    return _chebyshev_series(np.frombuffer(weights).reshape(outputs, -1))


def _chebyshev_series(weights: FloatArray) -> ComplexArray:
    """Of W between zero and one over the period, (nodes, outputs)."""
    samples = weights.shape[1]
    nodes = chebyshev.chebpts1(_TRANSFORM_NODES)
    transform = np.zeros((_TRANSFORM_NODES, len(weights)), dtype=np.complex128)
    for start in range(0, samples, _COLUMNS):
        part = weights[:, start : start + _COLUMNS]
        transform += _waves(samples, start, part.shape[1]) @ part.T
    series = chebyshev.chebvander(nodes, _TRANSFORM_NODES - 1).T @ transform * (2.0 / _TRANSFORM_NODES)
    # The constant counts half in a series of Chebyshev's polynomials.
    series[0] *= 0.5
    return np.asarray(series)


@lru_cache(maxsize=4)
def _waves(samples: int, start: int, count: int) -> ComplexArray:
    """Of the Chebyshev nodes at some of the samples of a period, (nodes, count)."""
    cycles = 0.5 * (chebyshev.chebpts1(_TRANSFORM_NODES) + 1.0) / samples
    return np.asarray(np.exp(-2j * np.pi * cycles[:, None] * np.arange(start, start + count)))


def _diverges(density: Density, width_hz: float) -> bool:
    """Whether the density goes as 1/f or steeper where f goes to zero."""
    high, low = density(width_hz * 4.0 ** -np.array([_GRADING - 1.0, _GRADING]))
    # Two steps of 4 towards zero show the slope; an integral of 1/f diverges, of less it does not.
    return bool(high > 0.0 and math.log(low / high) >= math.log(4.0) * (1.0 - _ZERO))
