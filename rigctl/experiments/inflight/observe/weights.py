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

from collections.abc import Callable, Sequence

import numpy as np

from rigctl.analysis.periodograms import fast_length
from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.observe.published import published_weights
from rigctl.experiments.inflight.observe.waves import inverse_of, sum_of_lines, templates

TAPER_S = 12.0
"""Weights rise over so long from the edge of a gap."""

FEWEST_SAMPLES = 0.3
"""Part of a stretch's samples that must be there."""

DRIFT_CYCLES = 0.67
"""Of a stretch: flicker noise makes of its slope what white noise of the density at that frequency would."""

# Flicker noise makes less of a bend by this factor.
_BENDS_LESS = 1.34
_STILL = 1e-12
"""Radians from one sample to the next below which a wave stands still."""

_AT_ONCE = 1 << 16


def weights(t_s: FloatArray, lines_hz: Sequence[float], present: BoolArray | None = None) -> FloatArray:
    """Rows w with w s = c, s of each line: s = c cos + s sin; shape (2 lines, samples).

    `t_s` (samples,) is evenly spaced; `present` (samples,) says which samples there are, all by default. Rows are
    zero where there is none, and every row is orthogonal to a constant. Raises `DataError` when the samples that are
    there cannot tell the lines apart.
    """
    if present is None or bool(np.all(present)):
        step_s = float(t_s[-1] - t_s[0]) / (len(t_s) - 1)
        return published_weights(float(t_s[0]), step_s, len(t_s), lines_hz).rows()
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
    return np.asarray(inverse_of(weighted @ design.T)[:2] @ weighted)


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
    count = fast_length(2 * len(row))
    spectrum = np.fft.rfft(row, count)
    step_hz, variance = 1.0 / (count * step_s), 0.0
    for start in range(1, len(spectrum), _AT_ONCE):
        power = np.abs(spectrum[start : start + _AT_ONCE]) ** 2
        variance += float(power @ density(step_hz * np.arange(start, start + len(power), dtype=np.float64)) * step_hz)
    return float(np.sqrt(variance))


def _tapered(t_s: FloatArray, lines_hz: Sequence[float], present: BoolArray) -> FloatArray:
    weight = taper(present, float(t_s[1] - t_s[0]))
    if np.count_nonzero(weight) < FEWEST_SAMPLES * len(t_s):
        raise DataError(f"{100.0 * np.mean(weight > 0.0):.0f} % of the samples are there, too few to fit lines")
    lines = templates(t_s, lines_hz)
    design = np.vstack([lines, _slow(t_s, min(lines_hz))])
    weighted = design * weight
    return np.asarray(inverse_of(weighted @ design.T)[: len(lines)] @ weighted)


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
