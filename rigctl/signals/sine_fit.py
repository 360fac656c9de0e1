"""Sine fits: complex amplitudes at the harmonics of a known frequency, by linear least squares.

Sign: signal(t) = dc + drift * (t - t_mid) + Re sum_h c_h exp(i h w t), w = 2 pi nu, t as in the record.
A delay by tau multiplies c_h by exp(-i h w tau). Residual is data minus model.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import DataError
from rigctl.interfaces import FloatArray
from rigctl.signals.noise import spectrum

ComplexArray = NDArray[np.complex128]
ComplexLike = TypeVar("ComplexLike", complex, ComplexArray)

# Beyond this the columns are a mixture no amplitude can be read from.
_MAX_CONDITION = 1e3
_GRID_TOLERANCE = 0.05
# Turns over the record; a residual detuning this small hides under any noise.
_FREQUENCY_SETTLED = 1e-7


def referred_to(reference: complex, amplitude: ComplexLike, *, harmonic: int = 1) -> ComplexLike:
    """Refer an amplitude at `harmonic` * nu to the phase of the displacement's amplitude at nu.

    Time is counted from the displacement's positive maximum: with x = A sin(w t + phi), so that
    `reference` = -i A exp(i phi), the real part is what goes as x (as x^h for harmonic h: positive for
    a signal proportional to x^h), the imaginary part is what leads it by a quarter period. A response
    H(w) of the sensor thus multiplies the result by H, a delay tau by exp(-i h w tau). Raises `DataError`
    for a zero or non-finite reference.
    """
    size = abs(reference)
    if not (np.isfinite(size) and size > 0.0):
        raise DataError(f"no displacement to refer the phase to (amplitude {size:g}): is the stage moving?")
    turn = complex(np.conj(reference) / size) ** harmonic
    return amplitude * turn


@dataclass(frozen=True)
class HarmonicFit:
    """What a sine fit found; the trailing axis is that of the samples' channels (absent for one channel).

    `dc` is the value at `time_s`, the middle of the record, `drift_per_s` the slope (0 when not fitted),
    `amplitudes` c_h of shape (harmonics, channels), `line_amplitudes` those of the extra lines, `residuals`
    data minus model of shape (samples, channels).
    """

    frequency_hz: float
    time_s: float
    dc: FloatArray
    drift_per_s: FloatArray
    amplitudes: ComplexArray
    line_amplitudes: ComplexArray
    residuals: FloatArray

    def amplitudes_referred_to(self, reference: complex) -> ComplexArray:
        """Give all harmonics' amplitudes referred to the displacement's at nu; see `referred_to`."""
        rows = [referred_to(reference, row, harmonic=h) for h, row in enumerate(self.amplitudes, start=1)]
        return np.array(rows, dtype=np.complex128)


class HarmonicBasis:
    """Columns 1, t, cos and sin of the harmonics of a frequency, factorised once for many channels.

    `t_s` of shape (samples,) need not hold whole periods nor be free of gaps. `drift` keeps the slow part of
    red noise out of the amplitudes' half that is odd about the middle of the record: f^-1.64 noise adds 60 %
    to its variance without, 20 % with. `lines_hz` are further lines to be fitted (the mains), which then
    neither leak into the harmonics nor count as noise. Raises `DataError` when the record is shorter than one
    period, a line lies at or above the Nyquist frequency, or the columns cannot be told apart.
    """

    def __init__(
        self,
        t_s: FloatArray,
        frequency_hz: float,
        harmonics: int = 3,
        drift: bool = True,
        *,
        lines_hz: tuple[float, ...] = (),
    ) -> None:
        self.t_s = np.asarray(t_s, dtype=np.float64)
        self.frequency_hz = float(frequency_hz)
        self.harmonics = harmonics
        self.drift = drift
        self.lines_hz = tuple(float(line) for line in lines_hz)
        self.samples = self.t_s.size
        self.sample_period_s, self.duration_s = _time_base(self.t_s)
        self.time_s = float(0.5 * (self.t_s[0] + self.t_s[-1]))
        self._check()
        design = self._design()
        self.orthonormal, self._triangle = np.linalg.qr(design)
        self._inverse = _guarded_inverse(self._triangle, self)

    def fit(self, samples: FloatArray) -> HarmonicFit:
        """Fit the channels of `samples`, shape (samples,) or (samples, channels); no NaN: `DataError`."""
        samples = np.asarray(samples, dtype=np.float64)
        if samples.shape[:1] != (self.samples,):
            raise DataError(f"{samples.shape[:1]} samples for {self.samples} times: they must match")
        if not np.isfinite(samples).all():
            raise DataError("samples that are not finite: drop them, with their times, before the fit")
        projection = self.orthonormal.T @ samples
        coefficients = self._inverse @ projection
        first = 2 if self.drift else 1
        complex_amplitudes = coefficients[first::2] - 1j * coefficients[first + 1 :: 2]
        return HarmonicFit(
            self.frequency_hz,
            self.time_s,
            np.asarray(coefficients[0]),
            np.asarray(coefficients[1] * 2.0 / self.duration_s if self.drift else 0.0 * coefficients[0]),
            complex_amplitudes[: self.harmonics],
            complex_amplitudes[self.harmonics :],
            samples - self.orthonormal @ projection,
        )

    def amplitude_covariance(self, psd: FloatArray, reference: complex | None = None) -> FloatArray:
        """Give the covariance of (Re c_1, Im c_1, Re c_2, ...) for one-sided noise densities there.

        `psd` of shape (harmonics,), unit^2/Hz, is taken as flat over a line's width 1/T. A sample then has
        the variance S / (2 dt), and the columns' own geometry does the rest; over whole periods this is
        S / T for each part. With `reference` the parts are in phase and quadrature (see `referred_to`).
        Shape (2 harmonics, 2 harmonics), unit^2.
        """
        first = 2 if self.drift else 1
        rows = self._inverse[first : first + 2 * self.harmonics].copy()
        rows[1::2] *= -1.0
        rows *= np.repeat(np.sqrt(np.asarray(psd) / (2.0 * self.sample_period_s)), 2)[:, None]
        if reference is not None:
            parts = rows[0::2] + 1j * rows[1::2]
            for h in range(1, self.harmonics + 1):
                parts[h - 1] = referred_to(reference, parts[h - 1], harmonic=h)
            rows[0::2], rows[1::2] = parts.real, parts.imag
        return rows @ rows.T

    @cached_property
    def grid_index(self) -> NDArray[np.intp]:
        """Place of each sample on the uniform time grid; raises `DataError` when there is no such grid."""
        steps = (self.t_s - self.t_s[0]) / self.sample_period_s
        index = np.rint(steps)
        if np.abs(steps - index).max() > _GRID_TOLERANCE:
            raise DataError("times are no uniform grid: the noise spectrum needs equally spaced samples")
        return np.asarray(index, dtype=np.intp)

    @property
    def grid_length(self) -> int:
        """Samples of the uniform grid, missing ones included."""
        return int(self.grid_index[-1]) + 1

    @cached_property
    def kept_fraction(self) -> FloatArray:
        """Fraction of each Fourier bin of the grid that the fit leaves in the residuals, shape (bins,)."""
        columns = np.zeros((self.orthonormal.shape[1], self.grid_length))
        columns[:, self.grid_index] = self.orthonormal.T
        taken = (np.abs(np.fft.rfft(columns, axis=1)) ** 2).sum(axis=0) / self.samples
        return np.asarray(np.clip(1.0 - taken, 0.0, 1.0))

    def _check(self) -> None:
        frequencies = np.array([self.harmonics * self.frequency_hz, *self.lines_hz])
        if not (np.isfinite(frequencies).all() and self.frequency_hz > 0.0 and (frequencies > 0.0).all()):
            raise DataError(f"frequencies must be positive, not {self.frequency_hz:g} Hz, {self.lines_hz}")
        nyquist_hz = 0.5 / self.sample_period_s
        if frequencies.max() >= nyquist_hz:
            raise DataError(
                f"{frequencies.max():g} Hz is not below the Nyquist frequency {nyquist_hz:g} Hz: "
                "sample faster or fit fewer harmonics"
            )
        if self.duration_s * self.frequency_hz < 1.0 - 1e-6:
            raise DataError(
                f"record of {self.duration_s:g} s is shorter than one period of {self.frequency_hz:g} Hz: "
                "record longer"
            )

    def _design(self) -> FloatArray:
        columns = [np.ones(self.samples)]
        if self.drift:
            columns.append((self.t_s - self.time_s) * 2.0 / self.duration_s)
        turn = np.exp(2j * np.pi * self.frequency_hz * self.t_s)
        phasor = np.ones(self.samples, dtype=np.complex128)
        for _ in range(self.harmonics):
            phasor = phasor * turn
            columns += [phasor.real, phasor.imag]
        for line_hz in self.lines_hz:
            angle = 2.0 * np.pi * line_hz * self.t_s
            columns += [np.cos(angle), np.sin(angle)]
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class FrequencyFit:
    """A refined frequency with the sigma that the record's own noise near the line gives it (`dof`).

    `basis` and `fit` are those at the refined frequency; the basis serves the other channels of the run.
    """

    frequency_hz: float
    sigma_hz: float
    dof: float
    basis: HarmonicBasis
    fit: HarmonicFit


def refine_frequency(
    t_s: FloatArray,
    x: FloatArray,
    frequency_hz: float,
    *,
    harmonics: int = 3,
    drift: bool = True,
    lines_hz: tuple[float, ...] = (),
) -> FrequencyFit:
    """Find the frequency of the record `x`, shape (samples,), near `frequency_hz`.

    Gauss-Newton on the four-parameter sine fit (IEEE Std 1057), the harmonics following the fundamental
    and the linear parameters projected out. Raises `DataError` when the search leaves the line's width 1/T.
    """
    estimate = float(frequency_hz)
    for _ in range(20):
        basis = HarmonicBasis(t_s, estimate, harmonics, drift, lines_hz=lines_hz)
        fit = basis.fit(x)
        gradient = _frequency_gradient(basis, fit)
        stiffness = float(gradient @ gradient)
        step = float(gradient @ fit.residuals) / stiffness if stiffness > 0.0 else np.inf
        if abs(estimate + step - frequency_hz) * basis.duration_s > 1.0:
            raise DataError(
                f"no line within {1.0 / basis.duration_s:.3g} Hz of {frequency_hz:g} Hz in this record: "
                "is the stage oscillating at the frequency of the run?"
            )
        if abs(step) * basis.duration_s <= _FREQUENCY_SETTLED:
            break
        estimate += step
    level = spectrum(fit.residuals, basis).level(estimate)
    sigma_hz = np.sqrt(level.psd / (2.0 * basis.sample_period_s) / stiffness)
    return FrequencyFit(estimate, float(sigma_hz), level.dof, basis, fit)


def _frequency_gradient(basis: HarmonicBasis, fit: HarmonicFit) -> FloatArray:
    """Give d(model)/d(frequency) with the part that the linear columns can imitate taken out."""
    turn = np.exp(2j * np.pi * basis.frequency_hz * basis.t_s)
    slope = np.zeros(basis.samples, dtype=np.complex128)
    for h in range(basis.harmonics, 0, -1):
        slope = (slope + 1j * h * fit.amplitudes[h - 1]) * turn
    gradient = 2.0 * np.pi * (basis.t_s - basis.time_s) * slope.real
    return gradient - basis.orthonormal @ (basis.orthonormal.T @ gradient)


def _time_base(t_s: FloatArray) -> tuple[float, float]:
    """Give the sample period and the length of the record, both in s."""
    if t_s.ndim != 1 or t_s.size < 3 or not np.isfinite(t_s).all():
        raise DataError("a record needs one-dimensional, finite times of at least three samples")
    steps = np.diff(t_s)
    if steps.min() <= 0.0:
        raise DataError("times must increase from sample to sample")
    period_s = float(np.median(steps))
    # The mean of the regular steps: the median alone carries the rounding of the written times.
    regular = steps[np.abs(steps - period_s) < 0.5 * period_s]
    period_s = float(regular.mean())
    return period_s, float(t_s[-1] - t_s[0]) + period_s


def _guarded_inverse(triangle: FloatArray, basis: HarmonicBasis) -> FloatArray:
    norms = np.linalg.norm(triangle, axis=0)
    condition = np.linalg.cond(triangle / np.where(norms > 0.0, norms, 1.0))
    if basis.samples <= triangle.shape[1] or not condition < _MAX_CONDITION:
        raise DataError(
            f"{basis.samples} samples over {basis.duration_s:g} s cannot tell the fit's columns apart "
            f"(condition {condition:.1g}): record longer or fit fewer harmonics and lines"
        )
    return np.asarray(np.linalg.inv(triangle))
