"""Pulses in a session of the test, down to those that only a matched filter sees, and also close to gaps.

They are looked for in the differences of the masses' outputs, which is where they do harm, less what both masses have
in common: thrust comes in by every angle between them. Differences are averaged to a few seconds a sample (a pulse is
longer, read-out noise is above), their noise's spectrum is estimated without the pulses that are known already, and
the search is repeated until nothing is found. Missing samples are replaced by what is expected of the noise beside
them: with these, the filter's output is that of generalised least squares on the samples that are there. No estimate
sees them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy import linalg, signal

from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.experiments.inflight.observe.detection import FALL_S, RISE_S, density_of, peaks_of
from rigctl.experiments.inflight.observe.grid import Grid, bell, thinned
from rigctl.experiments.inflight.observe.series import AFTER_S, covered
from rigctl.experiments.inflight.observe.waves import templates

FALSE_PER_DAY = 0.3
"""So many pulses are found by chance where none is: each costs 33 s and the edges of a gap."""

_AXES = "xyz"
# Next to a gap four seconds are not seen, in which the weights of an estimate are low.
_AVERAGED_S = 2.0
_COMMON = ("c_x", "c_y", "c_z", "dw_x", "dw_y", "dw_z")
# Below are a session's lines and little of a pulse.
_LOWEST_HZ = 9e-3
_PULSE_S = 60.0
_EARLY = 4
"""Averages before a pulse begins in which there is something of it."""

_MEMORY_S = 240.0
"""How far the noise's inverse covariance reaches: its spectrum is smooth over the inverse of that."""

# Two pulses so near may be one and what the filter makes of it: the weaker is looked at again without the stronger.
_APART_S = 120.0
# Short enough to follow noise that grows, long enough for its level to be known to a few percent.
_STEADY_S = 12000.0
_QUIETEST = 0.5
_ROUNDS = 12
_ROUNDING = 1e-12
_DAY_S = 86400.0


def pulses_of(grid: Grid, lines_hz: Sequence[float]) -> FloatArray:
    """When pulses begin, s, in order; `lines_hz` are what is known to be in the session besides."""
    thin = thinned(_columns(grid), _AVERAGED_S)
    reach_s = 0.5 * (len(bell(grid.step_s, _AVERAGED_S)) - 1) * grid.step_s
    found: list[float] = []
    for _ in range(_ROUNDS):
        used = thin.present & ~covered(thin.t_s, found, reach_s)
        new: list[float] = []
        for axis in _AXES:
            left = _cleared(thin, used, _apart(thin, used, axis), lines_hz)
            candidates = [] if left is None else _matched(left, used, thin, grid.step_s)
            new += [at for at in candidates if all(abs(at - other) > AFTER_S for other in new)]
        found += new
        if not new:
            break
    return np.sort(np.array(found))


def _columns(grid: Grid) -> Grid:
    """What is needed of a session: differences, common parts, angular accelerations."""
    columns = {name: grid.columns[name] for name in _COMMON if name.startswith("dw")}
    for axis in _AXES:
        one, two = grid.columns[f"m1_{axis}"], grid.columns[f"m2_{axis}"]
        columns[f"d_{axis}"], columns[f"c_{axis}"] = one - two, 0.5 * (one + two)
    return Grid(grid.t_s, columns, grid.present)


def _apart(thin: Grid, used: BoolArray, axis: str) -> FloatArray:
    """The masses' difference along an axis less what goes with what they have in common.

    Fitted to steps from sample to sample, in which slow drifts have no say.
    """
    both = used[1:] & used[:-1]
    shared = np.stack([thin.columns[name] for name in _COMMON], axis=1)
    apart = thin.columns[f"d_{axis}"]
    steps = np.diff(shared, axis=0)[both]
    # Simulated without noise some are nil; without the scale of each, small ones would be taken for that.
    size = np.sqrt(np.mean(steps**2, axis=0)) if len(steps) else np.zeros(len(_COMMON))
    steps, scale = steps[:, size > 0.0] / size[size > 0.0], size[size > 0.0]
    ratios = np.linalg.lstsq(steps, np.diff(apart)[both], rcond=None)[0]
    return np.asarray(apart - shared[:, size > 0.0] @ (ratios / scale))


def _cleared(thin: Grid, used: BoolArray, left: FloatArray, lines_hz: Sequence[float]) -> FloatArray | None:
    """Less lines, level, slope and bend, and zero where not used; None where nothing but rounding is left."""
    x = 2.0 * (thin.t_s - thin.t_s[0]) / (thin.t_s[-1] - thin.t_s[0]) - 1.0
    design = np.vstack([np.ones_like(x), x, x**2, templates(thin.t_s, lines_hz)])
    weighted = design * used
    cleared = np.where(
        used, left - np.linalg.lstsq(weighted @ design.T, weighted @ left, rcond=None)[0] @ design, 0.0
    )
    whole = float(np.max(np.abs(thin.columns["c_x"])))
    return cleared if float(np.std(cleared)) > _ROUNDING * whole else None


def _matched(left: FloatArray, used: BoolArray, thin: Grid, step_s: float) -> list[float]:
    """Where a filter matched to the pulse and to the noise finds more than noise makes."""
    f_hz, density = density_of(left, used, thin.step_s)
    # What is beyond the ends is missing, like any gap.
    ends = round(_PULSE_S / thin.step_s)
    left, used = np.pad(left, ends), np.pad(used, ends)
    noise = _noise(f_hz, density)
    inverse, shape = _inverse_covariance(noise, thin.step_s), _averaged_pulse(step_s, thin.step_s)
    whitened = signal.oaconvolve(_expected(left, used, inverse), inverse, mode="same")
    # Correlated with the pulse, which begins `_EARLY` samples into its shape.
    output = signal.oaconvolve(whitened, shape[::-1])[len(shape) - 1 - _EARLY :][: len(left)]
    scale = _scatter(output, used, round(_STEADY_S / thin.step_s))
    sigmas = (np.abs(output) / scale)[ends:-ends]
    threshold = _threshold(f_hz, np.abs(np.fft.rfft(shape, 2 * (len(f_hz) - 1))) ** 2 / noise)
    peaks = peaks_of(sigmas, threshold, round(_APART_S / thin.step_s))
    at_s = thin.t_s[peaks] + thin.step_s * _beside(*(sigmas[peaks + k] for k in (-1, 0, 1)))
    return [float(each) for each in at_s]


def _noise(f_hz: FloatArray, density: FloatArray) -> FloatArray:
    """What the filter takes for noise: below the lowest frequency lines that are not known as well."""
    floor = np.maximum(density, 1e-3 * np.median(density))
    return np.asarray(floor * (1.0 + (_LOWEST_HZ / np.maximum(f_hz, f_hz[1])) ** 4))


def _inverse_covariance(noise: FloatArray, step_s: float) -> FloatArray:
    """Of noise of this density, by distance in time from -reach to reach."""
    row = np.fft.irfft(2.0 * step_s / noise)
    reach = min(round(_MEMORY_S / step_s), len(row) // 2 - 1)
    # A triangle: the spectrum is smoothed by something that is never negative.
    half = row[: reach + 1] * (1.0 - np.arange(reach + 1) / (reach + 1))
    return np.concatenate([half[:0:-1], half])


def _threshold(f_hz: FloatArray, power: FloatArray) -> float:
    """In sigma, by Rice's formula: normal noise of this spectrum goes beyond u, up or down, 2 f_rms exp(-u^2 / 2)
    times a second."""
    mean_hz = float(np.sqrt(np.sum(power * f_hz**2) / np.sum(power)))
    return math.sqrt(2.0 * math.log(2.0 * mean_hz * _DAY_S * len(_AXES) / FALSE_PER_DAY))


def _expected(left: FloatArray, used: BoolArray, inverse: FloatArray) -> FloatArray:
    """With the noise's expectation, given all samples that are there, in place of those that are not."""
    missing = np.flatnonzero(~used)
    if len(missing) == 0:
        return left
    reach = len(inverse) // 2
    # Rows of the inverse covariance that belong to what is missing, by bands: nothing reaches further.
    bands = np.zeros((reach + 1, len(missing)))
    for k in range(min(reach + 1, len(missing))):
        apart = missing[k:] - missing[: len(missing) - k]
        bands[reach - k, k:] = np.where(apart <= reach, inverse[reach + np.minimum(apart, reach)], 0.0)
    right = signal.oaconvolve(left, inverse, mode="same")[missing]
    filled = left.copy()
    filled[missing] = -linalg.solveh_banded(bands, right)
    return filled


def _averaged_pulse(step_s: float, thin_step_s: float) -> FloatArray:
    """A pulse of unit amplitude as averages show it, from `_EARLY` of them before it begins."""
    kernel = bell(step_s, thin_step_s)
    fine_s = np.arange(round((_PULSE_S + 2.0 * _EARLY * thin_step_s) / step_s)) * step_s - 2.0 * _EARLY * thin_step_s
    since_s = np.maximum(fine_s, 0.0)
    averaged = np.convolve(np.exp(-since_s / FALL_S) - np.exp(-since_s / RISE_S), kernel, mode="same")
    every = round(thin_step_s / step_s)
    return np.asarray(averaged[_EARLY * every :: every])


def _scatter(output: FloatArray, used: BoolArray, count: int) -> FloatArray:
    """How much the filter's output scatters about each sample, by medians: noise may be louder at times."""
    edges = np.linspace(0, len(output), max(len(output) // count, 1) + 1).astype(int)
    # Of a normal variable the median of |x| is 0.6745 sigma.
    typical = float(np.median(np.abs(output[used])))
    scales = [
        np.median(np.abs(there)) if len(there := output[a:b][used[a:b]]) > count // 4 else typical
        for a, b in pairwise(edges.tolist())
    ]
    local = np.interp(np.arange(len(output)), 0.5 * (edges[1:] + edges[:-1]), scales)
    return np.asarray(np.maximum(local, max(_QUIETEST * typical, np.finfo(float).tiny)) / 0.6745)


def _beside(before: FloatArray, at: FloatArray, after: FloatArray) -> FloatArray:
    """Where peaks are between samples, in steps, by parabolas."""
    bend = before - 2.0 * at + after
    return np.asarray(np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, -1.0), 0.0))
