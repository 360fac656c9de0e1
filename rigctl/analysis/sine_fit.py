"""Sine fits: complex amplitudes at the harmonics of a known frequency, by linear least squares.

Sign: signal(t) = dc + drift * (t - t_mid) + Re sum_h c_h exp(i h w t), w = 2 pi nu, t as in the record.
A delay by tau multiplies c_h by exp(-i h w tau). Residual is data minus model.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray, IntArray
from rigctl.core.errors import DataError

ComplexLike = TypeVar("ComplexLike", complex, ComplexArray)

# Beyond this the columns are a mixture no amplitude can be read from.
_MAX_CONDITION = 1e3
# Of a sample period: times written with few digits stray by less, and the phase at Nyquist by 9 degrees at most.
_GRID_TOLERANCE = 0.05
# Without a grid every bin costs a sum over all samples.
_MAX_LOMB_BINS = 1024


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

    `dc` is the value in the middle of the record, `amplitudes` are c_h of shape (harmonics, channels),
    `line_amplitudes` those of the extra lines, `residuals` data minus model of shape (samples, channels).
    """

    dc: FloatArray
    amplitudes: ComplexArray
    line_amplitudes: ComplexArray
    residuals: FloatArray

    def amplitudes_referred_to(self, reference: complex) -> ComplexArray:
        """Give all harmonics' amplitudes referred to the displacement's at nu; see `referred_to`."""
        rows = [referred_to(reference, row, harmonic=h) for h, row in enumerate(self.amplitudes, start=1)]
        return np.array(rows, dtype=np.complex128)


class HarmonicBasis:
    """Columns 1, t, cos and sin of the harmonics of a frequency, factorised once for many channels.

    `t_s` of shape (samples,) need not hold whole periods nor be free of gaps. The drift keeps the slow part of
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
        *,
        lines_hz: tuple[float, ...] = (),
    ) -> None:
        self.t_s = np.asarray(t_s, dtype=np.float64)
        self.frequency_hz = float(frequency_hz)
        self.harmonics = harmonics
        self.lines_hz = tuple(float(line) for line in lines_hz)
        self.samples = self.t_s.size
        self.sample_period_s, self.duration_s = time_base(self.t_s)
        self.time_s = float(0.5 * (self.t_s[0] + self.t_s[-1]))
        self._check()
        self._columns = self._design()
        self._inverse = _guarded_inverse(self._columns, self)
        self.orthonormal = (self._inverse.T @ self._columns.T).T

    def fit(self, samples: FloatArray) -> HarmonicFit:
        """Fit the channels of `samples`, shape (samples,) or (samples, channels); no NaN: `DataError`."""
        samples = np.asarray(samples, dtype=np.float64)
        if samples.shape[:1] != (self.samples,):
            raise DataError(f"{samples.shape[:1]} samples for {self.samples} times: they must match")
        if not np.isfinite(samples).all():
            raise DataError("samples that are not finite: drop them, with their times, before the fit")
        projection = self.orthonormal.T @ samples
        coefficients = self._inverse @ projection
        complex_amplitudes = coefficients[2::2] - 1j * coefficients[3::2]
        return HarmonicFit(
            np.asarray(coefficients[0]),
            complex_amplitudes[: self.harmonics],
            complex_amplitudes[self.harmonics :],
            samples - self.orthonormal @ projection,
        )

    @cached_property
    def _grid_steps(self) -> FloatArray:
        return np.asarray((self.t_s - self.t_s[0]) / self.sample_period_s)

    @cached_property
    def uniform(self) -> bool:
        """Whether the samples lie on a uniform time grid, some perhaps missing."""
        steps = self._grid_steps
        return bool(np.abs(steps - np.rint(steps)).max() <= _GRID_TOLERANCE)

    @cached_property
    def grid_index(self) -> IntArray:
        """Place of each sample on the uniform time grid; raises `DataError` when there is no such grid."""
        if not self.uniform:
            raise DataError("times are no uniform grid: this needs equally spaced samples")
        return np.asarray(np.rint(self._grid_steps), dtype=np.intp)

    @property
    def grid_length(self) -> int:
        """Samples of the uniform grid, missing ones included."""
        return int(self.grid_index[-1]) + 1

    @cached_property
    def bin_frequency_hz(self) -> FloatArray:
        """Multiples of 1/T between zero and the Nyquist frequency (without a grid: up to the 1024th)."""
        if not self.uniform:
            count = min(_MAX_LOMB_BINS, (self.samples - 1) // 2)
            return np.arange(1, count + 1) / self.duration_s
        frequency_hz = np.fft.rfftfreq(self.grid_length, self.sample_period_s)
        return np.asarray(frequency_hz[1 : (self.grid_length + 1) // 2], dtype=np.float64)

    def power(self, columns: FloatArray | ComplexArray) -> FloatArray:
        """|sum x exp(-i w t)|^2 of a column, shape (samples,), or of each row of several, at the bins.

        Of complex columns the mean of the two signs of w.
        """
        if not self.uniform:
            return self._direct_power(columns)
        n = self.grid_length
        on_grid = columns
        if self.samples != n:
            on_grid = np.zeros((*columns.shape[:-1], n), dtype=columns.dtype)
            on_grid[..., self.grid_index] = columns
        if not np.iscomplexobj(on_grid):
            transform = np.fft.rfft(on_grid)[..., 1 : (n + 1) // 2]
            return np.asarray(transform.real**2 + transform.imag**2)
        transform = np.fft.fft(on_grid)
        both = transform.real**2 + transform.imag**2
        return np.asarray(both[..., 1 : (n + 1) // 2] + both[..., : n // 2 : -1]) / 2.0

    def _direct_power(self, columns: FloatArray | ComplexArray) -> FloatArray:
        """The same without a grid, frequency by frequency (Lomb's sums)."""
        turn = np.exp(-2j * np.pi * (self.t_s - self.time_s) / self.duration_s)
        phasor = np.ones_like(turn)
        power = []
        for _ in self.bin_frequency_hz:
            phasor = phasor * turn
            power.append((np.abs(columns @ phasor) ** 2 + np.abs(columns @ phasor.conj()) ** 2) / 2.0)
        return np.stack(power, axis=-1)

    @cached_property
    def kept_fraction(self) -> FloatArray:
        """Fraction of each spectral bin that the fit leaves in the residuals, shape (bins,)."""
        rows = self.orthonormal.T
        # Two columns in one transform: |A|^2 + |B|^2 at f is half the power of A + iB at f and at -f.
        taken = self.power(rows[0::2] + 1j * rows[1::2]).sum(axis=0) / self.samples
        return np.asarray(np.clip(1.0 - taken, 0.0, 1.0))

    def harmonic_sum(self, amplitudes: ComplexArray) -> FloatArray:
        """Re sum_h c_h exp(i h w t), shape (samples,), for `amplitudes` c of shape (harmonics,)."""
        parts = np.stack([amplitudes.real, -amplitudes.imag], axis=1).ravel()
        return np.asarray(self._columns[:, 2 : 2 + parts.size] @ parts)

    @cached_property
    def variance_factors(self) -> FloatArray:
        """By how much each harmonic's variance, the mean of its two parts, exceeds S / T; shape (harmonics,)."""
        # Samples of white noise of one-sided density S have the variance S / 2 dt.
        rows = (self._inverse**2).sum(axis=1)[2 : 2 + 2 * self.harmonics]
        return np.asarray(rows.reshape(-1, 2).mean(axis=1) * self.duration_s / (2.0 * self.sample_period_s))

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
        # Written times are rounded: a record of exactly one period may come out a little short.
        if self.duration_s * self.frequency_hz < 1.0 - 1e-6:
            raise DataError(
                f"record of {self.duration_s:g} s is shorter than one period of {self.frequency_hz:g} Hz: "
                "record longer"
            )

    def _design(self) -> FloatArray:
        """The columns, each contiguous in memory."""
        rows = np.empty((2 + 2 * (self.harmonics + len(self.lines_hz)), self.samples))
        rows[0] = 1.0
        # From -1 to 1, as large as the other columns: the condition number then speaks of likeness, not of units.
        rows[1] = (self.t_s - self.time_s) * (2.0 / self.duration_s)
        angle = 2.0 * np.pi * self.frequency_hz * self.t_s
        turn = np.empty(self.samples, dtype=np.complex128)
        np.cos(angle, out=turn.real)
        np.sin(angle, out=turn.imag)
        # Harmonics as powers of one phasor: a product is cheaper than a sine.
        phasor = turn
        for h in range(self.harmonics):
            rows[2 + 2 * h], rows[3 + 2 * h] = phasor.real, phasor.imag
            if h + 1 < self.harmonics:
                phasor = phasor * turn
        for i, line_hz in enumerate(self.lines_hz, start=1 + self.harmonics):
            angle = 2.0 * np.pi * line_hz * self.t_s
            np.cos(angle, out=rows[2 * i])
            np.sin(angle, out=rows[2 * i + 1])
        return rows.T


def time_base(t_s: FloatArray) -> tuple[float, float]:
    """The sample period and the length of a record, both in s; `DataError` for times that are none."""
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


def _guarded_inverse(design: FloatArray, basis: HarmonicBasis) -> FloatArray:
    """The inverse of R in design = Q R, by Cholesky twice: much faster than Householder, as orthonormal."""
    inverse = np.eye(design.shape[1])
    condition = np.inf
    if basis.samples > design.shape[1]:
        try:
            # One pass is orthonormal to rounding times the condition squared only; the second mends that.
            for _ in range(2):
                part = (inverse.T @ design.T).T
                triangle = np.linalg.cholesky(part.T @ part).T
                if not np.isfinite(condition):
                    condition = np.linalg.cond(triangle / np.linalg.norm(triangle, axis=0))
                inverse = inverse @ np.linalg.inv(triangle)
        except np.linalg.LinAlgError:
            condition = np.inf
    if not condition < _MAX_CONDITION:
        raise DataError(
            f"{basis.samples} samples over {basis.duration_s:g} s cannot tell the fit's columns apart "
            f"(condition {condition:.1g}): record longer or fit fewer harmonics and lines"
        )
    return np.asarray(inverse)
