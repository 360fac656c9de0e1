"""From samples to complex amplitudes of lines: one weight per sample and line, z = W s.

Published chain: subtract the mean, band-pass (second-order Butterworth high-pass at half the lowest fitted frequency,
second-order low-pass at twice the highest), drop the first 200 s of data and templates, fit all lines jointly. Every
step is linear, so that the whole chain is one vector per line, its adjoint applied to the templates: no filtered
series is ever made, and samples may come in chunks.

A filter has no meaning across a gap. Where samples are missing the lines are fitted without it, beside a constant, a
slope and slow waves, by least squares with weights that go smoothly to nothing at the edges of each gap. The
sensor's read-out noise grows as f^2, to a thousand times the noise at the lines; an abrupt edge would let it in.
What is slow leaves nothing in such lines, where the band-pass lets a part of it through: `drift_weights` tell it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy import fft, signal

from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray
from rigctl.core.errors import DataError

# As published. Shorter than the transient of such a band-pass (950 s), which the templates share.
DROPPED_S = 200.0
TAPER_S = 12.0
"""Weights rise over so long from the edge of a gap."""

FEWEST_SAMPLES = 0.3
"""Part of a stretch's samples that must be there."""

DRIFT_CYCLES = 0.67
"""Of a stretch: flicker noise makes of its slope what white noise of the density at that frequency would."""

# Flicker noise makes less of a bend by this factor.
_BENDS_LESS = 1.34
_SINGULAR = 1e-6
_STILL = 1e-12
"""Radians from one sample to the next below which a wave stands still."""

_AT_ONCE = 1 << 16


def band_pass(lowest_hz: float, highest_hz: float, sample_rate_hz: float) -> FloatArray:
    """The published band-pass for lines between two frequencies, as second-order sections."""
    high_pass = signal.butter(2, 0.5 * lowest_hz, "highpass", fs=sample_rate_hz, output="sos")
    # At so high a corner a digital low-pass has nothing left to take away.
    if 2.0 * highest_hz >= 0.45 * sample_rate_hz:
        return np.asarray(high_pass)
    low_pass = signal.butter(2, 2.0 * highest_hz, "lowpass", fs=sample_rate_hz, output="sos")
    return np.vstack([high_pass, low_pass])


def templates(t_s: FloatArray, lines_hz: Sequence[float], single: bool = False) -> FloatArray:
    """Cosine and sine of each line at evenly spaced times, rows cos 1, sin 1, cos 2, ...; shape (2 lines, samples).

    A place's phase is its block's and that within the block: one product is less than a cosine and a sine.
    """
    made = np.empty((2 * len(lines_hz), len(t_s)), dtype=np.float32 if single else np.float64)
    within = math.isqrt(len(t_s)) + 1
    for number, f_hz in enumerate(lines_hz):
        rate = 2j * np.pi * f_hz
        blocks, waves = np.exp(rate * t_s[::within]), np.exp(rate * (t_s[:within] - t_s[0]))
        wave = np.multiply.outer(blocks, waves).ravel()[: len(t_s)]
        made[2 * number], made[2 * number + 1] = wave.real, wave.imag
    return made


def sum_of_lines(parts: FloatArray, t_s: FloatArray, lines_hz: Sequence[float]) -> FloatArray:
    """`parts` (2 lines,), cosine and sine of each line, summed at evenly spaced times; the shape of `t_s`.

    As `templates`: a product of matrices, and hardly a cosine.
    """
    size = np.array(parts[0::2] - 1j * parts[1::2])
    rate = 2j * np.pi * np.array(lines_hz)
    count = len(t_s)
    step_s, within = float(t_s[-1] - t_s[0]) / (count - 1), math.isqrt(count) + 1
    blocks = size * np.exp(rate * t_s[::within, None])
    waves = np.exp(rate[:, None] * step_s * np.arange(within))
    return np.asarray((blocks.real @ waves.real - blocks.imag @ waves.imag).ravel()[:count])


def weights(
    t_s: FloatArray, lines_hz: Sequence[float], present: BoolArray | None = None, *, single: bool = False
) -> FloatArray:
    """Rows w with w s = c, s of each line: s = c cos + s sin; shape (2 lines, samples).

    `t_s` (samples,) is evenly spaced; `present` (samples,) says which samples there are, all by default. Rows are
    zero where there is none, and every row is orthogonal to a constant. Raises `DataError` when the samples that are
    there cannot tell the lines apart.

    `single`: of whole stretches, in single precision, for half the memory. Rounding is alike for all series, but a
    row then lets some 1e-8 of a constant through: whoever uses it takes the levels' part out.
    """
    if present is None or bool(np.all(present)):
        return _filtered(t_s, lines_hz, single)
    return _tapered(t_s, lines_hz, present)


def drift_weights(t_s: FloatArray, lines_hz: Sequence[float], present: BoolArray) -> FloatArray:
    """Rows w with w s the slope and the bend of s beside a constant and its lines, shape (2, samples).

    As factors of Legendre's polynomials over the stretch, of unit mean square; the bend so much more that flicker
    noise makes as much of either.
    """
    x = 2.0 * (t_s - t_s[0]) / float(t_s[-1] - t_s[0]) - 1.0
    shapes = np.sqrt(3.0) * x, np.sqrt(5.0) * (1.5 * x**2 - 0.5) / _BENDS_LESS
    design = np.vstack([*shapes, np.ones_like(x), templates(t_s, lines_hz)])
    weighted = design * taper(present, float(t_s[1] - t_s[0]))
    return np.asarray(_inverse(weighted @ design.T)[:2] @ weighted)


def level_weights(t_s: FloatArray, lines_hz: Sequence[float], present: BoolArray | None = None) -> FloatArray:
    """Weights of the constant beside the lines, shape (samples,).

    The plain mean of a stretch without whole periods, or with gaps, contains a part of each line: 1e-10 m/s2 of
    5e-8, by which quadratic factors would move the linear ones.
    """
    if present is None or bool(np.all(present)):
        level: FloatArray = np.asarray(np.linalg.inv(_even_normal(t_s, lines_hz))[:, 0], dtype=np.float64)
        return np.asarray(level[0] + sum_of_lines(level[1:], t_s, lines_hz))
    design = np.vstack([np.ones_like(t_s), templates(t_s, lines_hz)])
    weighted = design * taper(present, float(t_s[1] - t_s[0]))
    along = np.linalg.solve(weighted @ design.T, np.eye(len(design), 1)[:, 0])
    return np.asarray(along @ weighted)


def _even_normal(t_s: FloatArray, lines_hz: Sequence[float]) -> FloatArray:
    """Products of a constant and of the lines' cosines and sines, summed over evenly spaced times, in closed form."""
    # A constant is the cosine at no frequency; its sine is left out at the end.
    rate = 2.0 * np.pi * np.array([0.0, *lines_hz])

    def summed(rates: FloatArray) -> ComplexArray:
        """Of exp(i rate t): Dirichlet's kernel."""
        half = 0.5 * rates * float(t_s[-1] - t_s[0]) / (len(t_s) - 1)
        still = np.abs(half) < _STILL
        size = np.where(still, float(len(t_s)), np.sin(len(t_s) * half) / np.sin(np.where(still, 1.0, half)))
        return np.asarray(size * np.exp(1j * rates * 0.5 * float(t_s[0] + t_s[-1])))

    above, below = summed(rate[:, None] + rate), summed(rate[:, None] - rate)
    normal = np.empty((2 * len(rate), 2 * len(rate)))
    normal[0::2, 0::2] = 0.5 * (below.real + above.real)
    normal[1::2, 1::2] = 0.5 * (below.real - above.real)
    normal[0::2, 1::2] = 0.5 * (above.imag - below.imag)
    normal[1::2, 0::2] = normal[0::2, 1::2].T
    kept = np.delete(np.arange(len(normal)), 1)
    return normal[np.ix_(kept, kept)]


def amplitudes(rows: FloatArray, series: FloatArray) -> ComplexArray:
    """Complex amplitudes c - i s from the rows of `weights` and series (samples, k); shape (lines, k)."""
    parts = rows @ series
    return np.asarray(parts[0::2] - 1j * parts[1::2])


def spread(squares: FloatArray, step_s: float) -> FloatArray:
    """Standard uncertainty of one component of each line in noise of unit density (one-sided, per Hz), (lines,);
    `squares` (2 lines,) are the sums of each row's squared weights."""
    return np.asarray(np.sqrt(0.5 * (squares[0::2] + squares[1::2]) / (2.0 * step_s)))


def response(row: FloatArray, step_s: float, density: Callable[[FloatArray], FloatArray]) -> float:
    """Standard deviation of w s for one row of `weights`, in noise of a one-sided density of frequency [Hz].

    It is not that of the density at the line: dropping 200 s leaves the published rows an edge, through which a
    density that grows with frequency comes in.
    """
    count = fft.next_fast_len(2 * len(row), real=True)
    power = np.abs(fft.rfft(row, count)[1:]) ** 2
    step_hz = 1.0 / (count * step_s)
    return float(np.sqrt(power @ density(step_hz * np.arange(1.0, len(power) + 1.0)) * step_hz))


def _filtered(t_s: FloatArray, lines_hz: Sequence[float], single: bool) -> FloatArray:
    step_s = float(t_s[1] - t_s[0])
    sections = band_pass(min(lines_hz), max(lines_hz), 1.0 / step_s)
    dropped = round(DROPPED_S / step_s)
    # In place and row by row: those of forty orbits are hundreds of megabytes.
    rows = templates(t_s, lines_hz, single)
    for row in rows:
        row[:] = signal.sosfilt(sections, row - row.mean(dtype=np.float64))
    rows[:, :dropped] = 0.0
    parts = [slice(start, start + _AT_ONCE) for start in range(0, rows.shape[1], _AT_ONCE)]
    # Filtered templates fit filtered data: gain and phase of the filter cancel.
    normal = np.sum([part @ part.T for part in (rows[:, where].astype(np.float64) for where in parts)], axis=0)
    for row in rows:
        # The adjoint of a causal filter is the same filter backwards in time.
        row[:] = signal.sosfilt(sections, row[::-1].astype(np.float64))[::-1]
    inverse = _inverse(normal)
    for where in parts:
        rows[:, where] = inverse @ rows[:, where].astype(np.float64)
    for row in rows:
        # Subtracting the mean is its own adjoint.
        row -= row.mean(dtype=np.float64)
    return rows


def _tapered(t_s: FloatArray, lines_hz: Sequence[float], present: BoolArray) -> FloatArray:
    weight = taper(present, float(t_s[1] - t_s[0]))
    if np.count_nonzero(weight) < FEWEST_SAMPLES * len(t_s):
        raise DataError(f"{100.0 * np.mean(weight > 0.0):.0f} % of the samples are there, too few to fit lines")
    lines = templates(t_s, lines_hz)
    design = np.vstack([lines, _slow(t_s, min(lines_hz))])
    weighted = design * weight
    return np.asarray(_inverse(weighted @ design.T)[: len(lines)] @ weighted)


def _slow(t_s: FloatArray, lowest_hz: float) -> FloatArray:
    """A constant, a slope and waves well below the lowest line; shape (k, samples)."""
    duration_s = float(t_s[-1] - t_s[0])
    x = 2.0 * (t_s - t_s[0]) / duration_s - 1.0
    # Slower than the lowest line by enough to leave that alone.
    waves = [k / duration_s for k in range(1, 4) if k / duration_s < 0.55 * lowest_hz]
    return np.vstack([np.ones_like(x), x, x**2, templates(t_s, waves)])


def taper(present: BoolArray, step_s: float) -> FloatArray:
    """Weights from 0 to 1 by the distance to the nearest gap or end, as a raised cosine; 0 on missing samples."""
    gaps = np.flatnonzero(~np.concatenate([[False], present, [False]])) - 1
    place = np.arange(len(present))
    following = np.searchsorted(gaps, place)
    nearest = np.minimum(place - gaps[following - 1], gaps[np.minimum(following, len(gaps) - 1)] - place)
    rise = np.clip((nearest - 0.5) * step_s / TAPER_S, 0.0, 1.0)
    return np.where(present, 0.5 - 0.5 * np.cos(np.pi * rise), 0.0)


def _inverse(normal: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(normal))
    values = np.linalg.eigvalsh(normal / np.outer(size, size))
    if not values[0] > _SINGULAR * values[-1]:
        raise DataError("the samples cannot tell the lines apart: record longer, or choose another frequency")
    return np.asarray(np.linalg.inv(normal))
