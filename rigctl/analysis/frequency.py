"""The frequency of a record, found near the one that was asked for."""

from __future__ import annotations

import math

import numpy as np

from rigctl.analysis.sine_fit import HarmonicBasis, HarmonicFit, time_base
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError

_MAX_STEPS = 20
# A fit at the right frequency leaves less than this fraction of a driven stage's motion.
_MOSTLY = 0.3
# Turns between a line and a harmonic over the record, below which a fit mixes the two.
_CLEAR_OF_HARMONICS = 0.7
# Turns over the record; a residual detuning this small hides under any noise.
_FREQUENCY_SETTLED = 1e-7


def find_frequency(
    t_s: FloatArray,
    x: FloatArray,
    frequency_hz: float,
    *,
    harmonics: int = 3,
    lines_hz: tuple[float, ...] = (),
) -> tuple[HarmonicBasis, HarmonicFit]:
    """The fit at the frequency of the record `x`, which may be off `frequency_hz` by a quarter.

    Lines that this record cannot hold are left out, those above its Nyquist frequency fitted where they are seen.
    Raises `DataError` when the record does not oscillate, or elsewhere.
    """
    given = np.asarray(t_s, dtype=np.float64)
    sample_period_s, duration_s = time_base(given)
    if not (np.isfinite(frequency_hz) and frequency_hz > 0.0):
        raise DataError(f"frequency_hz is {frequency_hz:g}: a run without a drive has no amplitudes")
    seen = _seen_lines(lines_hz, frequency_hz, harmonics, sample_period_s, duration_s)
    start = frequency_hz
    # Gauss-Newton converges within about a line's width only: the second attempt sets out from the greatest power.
    for attempt in range(2):
        try:
            basis, fit = _search(given, x, start, harmonics, seen)
        except DataError:
            if attempt:
                raise
        else:
            if float(fit.residuals @ fit.residuals) < _MOSTLY * float(((x - x.mean()) ** 2).sum()):
                return basis, fit
        start = _peak_hz(given, x, frequency_hz, duration_s)
    raise DataError(
        f"the encoder shows no motion at {frequency_hz:g} Hz, nor near it: correct frequency_hz, or leave the run out"
    )


def _search(
    t_s: FloatArray, x: FloatArray, frequency_hz: float, harmonics: int, lines_hz: tuple[float, ...]
) -> tuple[HarmonicBasis, HarmonicFit]:
    """The basis and the fit at the frequency that Gauss-Newton steps from `frequency_hz` end at.

    The harmonics follow the fundamental, the linear parameters are projected out: the four-parameter sine fit of
    IEEE Std 1057. Raises `DataError` when the search leaves the line's width 1/T.
    """
    estimate = float(frequency_hz)
    for _ in range(_MAX_STEPS):
        basis = HarmonicBasis(t_s, estimate, harmonics, lines_hz=lines_hz)
        fit = basis.fit(x)
        # The amplitudes follow the frequency at every step (variable projection), so one number is searched for.
        gradient = frequency_gradient(basis, fit)
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
    return basis, fit


def _seen_lines(
    lines_hz: tuple[float, ...], frequency_hz: float, harmonics: int, sample_period_s: float, duration_s: float
) -> tuple[float, ...]:
    """Where a record shows lines; none when one of them cannot be told from the harmonics or the mean."""
    folded = tuple(abs(line - round(line * sample_period_s) / sample_period_s) for line in lines_hz)
    taken = frequency_hz * np.arange(harmonics + 1)
    clear = all(np.abs(taken - line).min() * duration_s > _CLEAR_OF_HARMONICS for line in folded)
    return folded if clear and all(2.0 * line * sample_period_s < 1.0 for line in folded) else ()


def _peak_hz(t_s: FloatArray, x: FloatArray, near_hz: float, duration_s: float) -> float:
    """Frequency of the greatest power within a quarter of `near_hz`, in steps of 1 / 4T."""
    low, high = 0.75 * near_hz, 1.25 * near_hz
    trial = np.linspace(low, high, min(4096, max(9, math.ceil(4.0 * (high - low) * duration_s))))
    # Some ten samples a period find the peak, and keep thousands of trial frequencies cheap.
    step = max(1, int(0.1 / near_hz / max(duration_s / t_s.size, 1e-300)))
    sparse, centred = t_s[::step] - t_s[0], x[::step] - x.mean()
    power = [abs(np.exp(-2j * np.pi * f * sparse) @ centred) for f in trial]
    return float(trial[int(np.argmax(power))])


def frequency_gradient(basis: HarmonicBasis, fit: HarmonicFit) -> FloatArray:
    """Give d(model)/d(frequency) with the part that the linear columns can imitate taken out."""
    order = np.arange(1, basis.harmonics + 1)
    # Time from mid-record: another origin adds what the amplitudes imitate anyway, at the cost of rounding.
    gradient = 2.0 * np.pi * (basis.t_s - basis.time_s) * basis.harmonic_sum(1j * order * fit.amplitudes)
    return gradient - basis.orthonormal @ (basis.orthonormal.T @ gradient)
