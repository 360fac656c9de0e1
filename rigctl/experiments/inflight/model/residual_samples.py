"""What the baseline leaves in the samples themselves: pulses, steady lines between the known ones, unsteady noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage, special

from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from rigctl.experiments.inflight.model.equation import coefficients
from rigctl.experiments.inflight.model.parameters import SHARED
from rigctl.experiments.inflight.observe.detection import FALL_S, RISE_S, SPECTRUM_S, density_of
from rigctl.experiments.inflight.observe.grid import Grid, grid_of
from rigctl.experiments.inflight.observe.reduction import ReducedRun
from rigctl.experiments.inflight.observe.series import AFTER_S, NEEDED, raw_series
from rigctl.experiments.inflight.observe.waves import sum_of_lines, templates
from rigctl.experiments.inflight.observe.weights import taper

THRESHOLD_SIGMA = 6.0
"""Weaker pulses are not looked at."""

EDGE_S = 12.0
"""No pulse is looked for within this time of a gap or an end: there the filter cannot tell them apart."""

_OF_A_TAIL = 0.1
"""Of a pulse, what is left beside it where its shape is not quite the filter's."""

SAME_S = 6.0
"""Two fall times: pulses that begin farther apart are two, and what both cover is left out."""

STRETCH_S = 200.0
"""The noise's level is looked at in stretches so long."""

_FEWEST_LEVELS = 20

_CHUNK = 1 << 15
_FITTED_S = 4.0
# In bins of their spectrum (9 mHz): below are most lines of a session, and little of a pulse.
_LOWEST_BINS = 9.0
_NEAR_BINS = 60
_HIGHEST = 0.45
"""Of the sampling rate: read-out noise is steep at the end of the spectrum."""
# Twenty fall times: nothing is left.
_PULSE_S = 60.0
# Long beside a pulse, short beside an orbit, in the course of which noise may grow louder.
_STEADY_S = 600.0
_OF_A_MEDIAN = 1.36
"""The relative variance of a sigma that is told by the median of n normal values is this over n."""

_QUIETEST = 0.5
"""Of what a run's spectrum says: noise is no less than that at any time."""


@dataclass(frozen=True)
class Pulses:
    """Pulses of one run: when they begin [s], their amplitudes [m/s2] in the difference along the axis that shows
    them best, and how many sigmas they are. Of each axis: `trials` independent places were looked at, and the scatter
    about each place is known to so many degrees of freedom (axes,)."""

    at_s: FloatArray
    amplitude: FloatArray
    sigma: FloatArray
    trials: FloatArray
    dof: FloatArray

    def by_chance(self, sigma: float) -> float:
        """How many as large as that, of either sign, noise makes in the run."""
        return float(np.sum(self.trials * 2.0 * special.stdtr(self.dof, -sigma)))


_OF_TWO = 1.6
"""Uncertainty of a frequency from two amplitudes beside it over the least there is (Cramer and Rao): 1.3 to 1.85."""


@dataclass(frozen=True)
class Peak:
    """The strongest line of a run between those that are known: the frequency of the spectrum next to it, its own and
    its amplitude [m/s2] with their sigmas, and how likely noise makes one so strong anywhere."""

    run_id: str
    near_hz: float
    frequency_hz: float
    sigma_hz: float
    amplitude: float
    sigma: float
    p_value: float


@dataclass(frozen=True)
class RunScan:
    """One run's samples looked through; `levels` are variances of what is left, stretch by stretch, (stretches,)."""

    run_id: str
    pulses: Pulses
    peak: Peak | None
    levels: FloatArray
    level_at_s: FloatArray


def scan(run: ReducedRun, samples: Mapping[str, FloatArray], values: FloatArray) -> RunScan:
    """Look through a run with the baseline at `values`."""
    grid = grid_of(run.run_id, {name: samples[name] for name in ("t_s", *NEEDED)})
    lines_hz = [run.session.frequency_of(line) for line in run.session.reduced_lines(grid.duration_s)]
    left = _without_lines(lines_hz, grid, residual(run, grid, values))
    levels, at_s = _levels(left, grid)
    f_hz, density = density_of(left, grid.present, grid.step_s)
    clear = _Clear.of(grid)
    pulses = [_pulses(left, grid, clear, f_hz, density)]
    for axis in "yz":
        beside = _without_lines(lines_hz, grid, across(grid, axis))
        # Where no noise is, rounding is none: a sensor is hardly better across its axis than along it.
        noise = np.maximum(density_of(beside, grid.present, grid.step_s)[1], float(np.min(density)))
        pulses.append(_pulses(beside, grid, clear, f_hz, noise))
    return RunScan(run.run_id, _combined(pulses), _peak(run, left, grid), levels, at_s)


def across(grid: Grid, axis: str) -> FloatArray:
    """The masses' difference along an axis, less what they have in common; zero where samples miss.

    The ratio of their gains follows from the steps of what shakes both: the thrusters' noise, above all lines.
    """
    one, two = grid.columns[f"m1_{axis}"], grid.columns[f"m2_{axis}"]
    apart, common = one - two, 0.5 * (one + two)
    both = grid.present[1:] & grid.present[:-1]
    apart_steps, common_steps = np.diff(apart)[both], np.diff(common)[both]
    # Differences from sample to sample: slow drifts, different in both, have no say in the ratio.
    power = float(common_steps @ common_steps)
    ratio = float(apart_steps @ common_steps) / power if power > 0.0 else 0.0
    left = apart - ratio * common
    return np.where(grid.present, left - left[grid.present].mean(), 0.0)


def residual(run: ReducedRun, grid: Grid, values: FloatArray) -> FloatArray:
    """Left side less right side of the baseline, sample by sample; zero where samples miss."""
    c = coefficients(run.session, run.whole.amplitudes, values[:SHARED, None])[:, 0]
    means = {name: float(column[grid.present].mean()) for name, column in grid.columns.items() if name[0] == "m"}
    residuals = np.zeros(len(grid.t_s))
    for start in range(0, len(residuals), _CHUNK):
        part = grid.part(slice(start, start + _CHUNK))
        columns = {name: column - means.get(name, 0.0) for name, column in part.columns.items()}
        residuals[start : start + _CHUNK] = raw_series(run.session, part.t_s, columns) @ c
    return np.where(grid.present, residuals, 0.0)


@dataclass(frozen=True)
class Steadiness:
    """How logarithms of `count` levels scatter about their run's mean, and how neighbours do: variances."""

    scatter: float
    of_neighbours: float
    count: int

    @property
    def p_value(self) -> float:
        """How likely steady noise scatters so: neighbouring stretches are alike where the noise goes slowly."""
        # Von Neumann's ratio: for independent levels it is about N(1, 1/n).
        return float(special.ndtr((self.of_neighbours / self.scatter - 1.0) * np.sqrt(self.count)))


def steadiness(levels: Sequence[FloatArray]) -> Steadiness | None:
    """Of all runs, each about its own level, which its noise has anyway; None where too few stretches are seen."""
    logs = [np.log(there) for each in levels if len(there := each[each > 0.0]) > 1]
    count = sum(map(len, logs))
    if count < _FEWEST_LEVELS:
        return None
    # Each run's mean is taken from its levels: a degree of freedom less.
    scatter = sum(float(np.sum((each - each.mean()) ** 2)) for each in logs) / (count - len(logs))
    steps = np.concatenate([np.diff(each) for each in logs])
    return Steadiness(scatter, 0.5 * float(np.mean(steps**2)), count - len(logs))


def _without_lines(lines_hz: Sequence[float], grid: Grid, left: FloatArray) -> FloatArray:
    """Less a run's lines, a constant and a slope, fitted to a few seconds a sample."""
    every = max(round(_FITTED_S / grid.step_s), 1)
    count = len(left) // every
    means = np.where(grid.present, left, 0.0)[: count * every].reshape(count, every).mean(axis=1)
    weight = grid.present[: count * every].reshape(count, every).all(axis=1)
    at_s = grid.t_s[: count * every].reshape(count, every).mean(axis=1)
    design = np.vstack([templates(at_s, lines_hz), np.ones_like(at_s), at_s - at_s.mean()])
    weighted = design * weight
    fitted = np.linalg.lstsq(weighted @ design.T, weighted @ means, rcond=None)[0]
    # A mean over a few samples leaves so much of a line.
    x = np.pi * np.array(lines_hz) * grid.step_s
    fitted[:-2] /= np.repeat(np.sin(every * x) / (every * np.sin(x)), 2)
    lines = sum_of_lines(fitted[:-2], grid.t_s, lines_hz)
    cleared = left - lines - fitted[-2] - fitted[-1] * (grid.t_s - at_s.mean())
    return np.where(grid.present, cleared, 0.0)


@dataclass(frozen=True)
class _Clear:
    """Of one run: how much each sample counts and where pulses are `seen`, clear of gaps and ends, (samples,); the
    transform of a pulse in time, (bins,)."""

    weight: FloatArray
    seen: BoolArray
    template: ComplexArray

    @classmethod
    def of(cls, grid: Grid) -> _Clear:
        # Neither an abrupt edge nor what wraps around is a pulse.
        weight = taper(grid.present, grid.step_s)
        seen = ndimage.minimum_filter1d(weight, 2 * round(EDGE_S / grid.step_s) + 1, mode="constant") == 1.0
        since_s = np.arange(round(_PULSE_S / grid.step_s)) * grid.step_s
        shape = np.exp(-since_s / FALL_S) - np.exp(-since_s / RISE_S)
        return cls(weight, seen, np.fft.rfft(shape, len(weight)))


def _pulses(left: FloatArray, grid: Grid, clear: _Clear, f_hz: FloatArray, density: FloatArray) -> Pulses:
    """By a filter matched to the pulse and the noise's spectrum."""
    count = len(left)
    at_hz = np.fft.rfftfreq(count, grid.step_s)
    # Never much quieter than typical: dividing by a dip of the estimate would let it choose the pulse.
    noise = np.interp(at_hz, f_hz, np.maximum(density, 1e-3 * np.median(density)))
    share = np.conj(clear.template) / noise
    share[at_hz < _LOWEST_BINS / SPECTRUM_S] = 0.0
    # sigma of the estimate: 1 / sqrt(4 sum |H|^2 / S df), H the transform of the pulse in time.
    information = 4.0 * float(np.sum(np.real(share * clear.template))) * grid.step_s / count
    estimate = np.fft.irfft(np.fft.rfft(clear.weight * left) * share, count)
    estimate *= 2.0 * grid.step_s / information
    sigmas = estimate * np.sqrt(information)
    # Against the scatter about each place and not the mean spectrum: louder noise makes no pulses.
    scale = _scale(sigmas, clear.seen, round(_STEADY_S / grid.step_s))
    sigmas = np.where(clear.seen, sigmas / scale, 0.0)
    response = np.fft.irfft(share * clear.template, count)
    peaks, sizes = _peaks(sigmas, response / response[0], grid.step_s)
    band = np.abs(share * clear.template)
    width_hz = float(np.sum(band) ** 2 / np.sum(band**2)) / (count * grid.step_s)
    trials = np.array([2.0 * width_hz * grid.duration_s])
    dof = np.array([width_hz * min(_STEADY_S, grid.duration_s) / _OF_A_MEDIAN])
    return Pulses(grid.t_s[peaks], sizes * scale[peaks] / np.sqrt(information), np.abs(sizes), trials, dof)


def _peaks(sigmas: FloatArray, response: FloatArray, step_s: float) -> tuple[IntArray, FloatArray]:
    """Where pulses begin, and their sizes: the largest maximum, then that of what is left less what the filter makes
    of it beside it, its `response` by distance, until nothing stands out."""
    left, least = sigmas.copy(), np.full(len(sigmas), THRESHOLD_SIGMA)
    near, reach = max(round(SAME_S / step_s), 1), round(AFTER_S / step_s)
    kept: dict[int, float] = {}
    while True:
        size = np.abs(left)
        maximum = np.zeros(len(left), dtype=bool)
        maximum[1:-1] = (size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])
        beyond = np.where(maximum, size - least, -1.0)
        place = int(np.argmax(beyond))
        if beyond[place] < 0.0:
            peaks = np.array(sorted(kept), dtype=np.intp)
            return peaks, np.array([kept[each] for each in peaks.tolist()], dtype=np.float64)
        kept[place] = float(left[place])
        around = np.arange(max(place - reach, 0), min(place + reach + 1, len(left)))
        least[around] += _OF_A_TAIL * size[place]
        left[around] -= left[place] * response[np.abs(around - place)]
        least[max(place - near, 0) : place + near + 1] = np.inf


def _combined(channels: Sequence[Pulses]) -> Pulses:
    """Of several channels: what hits all of them at once counts once, where it stands out most."""
    at_s, amplitude, sigma, trials, dof = (
        np.concatenate([getattr(each, name) for each in channels])
        for name in ("at_s", "amplitude", "sigma", "trials", "dof")
    )
    # The strongest first; what lies within some seconds of it is the same pulse.
    kept: list[int] = []
    for place in np.argsort(-sigma, kind="stable"):
        if all(abs(at_s[place] - at_s[other]) > SAME_S for other in kept):
            kept.append(int(place))
    kept.sort(key=lambda place: float(at_s[place]))
    return Pulses(at_s[kept], amplitude[kept], sigma[kept], trials, dof)


def _scale(sigmas: FloatArray, seen: BoolArray, count: int) -> FloatArray:
    """How much the filter's output scatters about each sample, by medians: noise may be louder at times."""
    edges = np.append(np.arange(0, max(len(sigmas) - count // 2, 1), count), len(sigmas))
    middles, scales = [], []
    for start, stop in pairwise(edges.tolist()):
        here = np.abs(sigmas[start:stop][seen[start:stop]])
        if len(here) > count // 4:
            middles.append(0.5 * (start + stop))
            # Of a normal variable the median of |x| is 0.6745 sigma.
            scales.append(float(np.median(here)) / 0.6745)
    if not scales:
        return np.ones(len(sigmas))
    return np.maximum(np.interp(np.arange(len(sigmas)), middles, scales), _QUIETEST)


def _peak(run: ReducedRun, left: FloatArray, grid: Grid) -> Peak | None:
    window = np.hanning(len(left)) * grid.present
    f_hz = np.fft.rfftfreq(len(left), grid.step_s)
    spectrum = np.abs(np.fft.rfft(window * left))
    session, width_hz = run.session, 1.0 / grid.duration_s
    known = [session.frequency_of(line) for line in session.reduced_lines(grid.duration_s)]
    known += [k * session.orbital_hz for k in range(1, 9)]
    known += [h * session.frequency_hz + j * session.orbital_hz for h in (1, 2, 3, 4) for j in range(-4, 5)]
    free = f_hz > 0.4 * session.orbital_hz
    for line_hz in known:
        # The main lobe of a Hann window reaches 2 / T on either side.
        free &= np.abs(f_hz - line_hz) > 2.5 * width_hz
    power, f_hz = spectrum[free] ** 2, f_hz[free]
    around, stood_for = _around(power)
    used = (f_hz > session.orbital_hz) & (f_hz < _HIGHEST / grid.step_s)
    if not used.any():
        return None
    # Of a power over the mean of so many others, all exponentially distributed.
    p_values = np.where(used, np.exp(-stood_for * np.log1p(power / around / stood_for)), 1.0)
    place = int(np.argmin(p_values))
    p_value = float(-np.expm1(np.count_nonzero(used) * np.log1p(-min(p_values[place], 1.0 - 1e-16))))
    scale = 2.0 / float(np.sum(window))
    amplitude, sigma = float(scale * np.sqrt(power[place])), float(scale * np.sqrt(0.5 * around[place]))
    off, larger = _off_peak(spectrum, int(np.flatnonzero(free)[place]))
    return Peak(
        run.run_id,
        float(f_hz[place]),
        float(f_hz[place] + off * width_hz),
        float(_OF_TWO * np.sqrt(3.0) / np.pi * width_hz * sigma / amplitude),
        larger * amplitude,
        larger * sigma,
        p_value,
    )


def _off_peak(spectrum: FloatArray, place: int) -> tuple[float, float]:
    """How far from a frequency of a Hann window's spectrum (amplitudes) the maximum about it is, as a share of their
    distance, and by how much that is larger (Rife and Vincent, Bell Syst. Tech. J. 49 (1970) 197)."""
    below, here, above = spectrum[place - 1], spectrum[place], spectrum[min(place + 1, len(spectrum) - 1)]
    way, beside = (1.0, above) if above >= below else (-1.0, below)
    off = float(np.clip((2.0 * beside - here) / (beside + here), 0.0, 1.0 - 1e-9))
    return way * off, float((1.0 - off**2) / np.sinc(off))


def _around(power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The level around each bin, by a median, which a line does not lift; and how many bins it is worth.

    Between half and twice the frequency where that is less than the usual stretch.
    """
    around = ndimage.median_filter(power, 2 * _NEAR_BINS + 1, mode="nearest")
    stood_for = np.full(len(power), float(_NEAR_BINS))
    for place in range(min(_NEAR_BINS, len(power))):
        near = power[place // 2 : 2 * place + 3]
        around[place], stood_for[place] = np.median(near), max(0.5 * len(near), 1.0)
    return np.maximum(around / np.log(2.0), np.finfo(float).tiny), stood_for


def _levels(left: FloatArray, grid: Grid) -> tuple[FloatArray, FloatArray]:
    """Mean squares of steps from sample to sample, which nothing slow enters."""
    count = round(STRETCH_S / grid.step_s)
    steps = np.diff(left, append=left[-1])
    both = grid.present & np.append(grid.present[1:], False)
    stretches = len(left) // count
    there = both[: stretches * count].reshape(stretches, count).sum(axis=1)
    power = np.where(both, steps**2, 0.0)[: stretches * count].reshape(stretches, count).sum(axis=1)
    at_s = grid.t_s[: stretches * count : count]
    return np.where(there > 0.5 * count, power / np.maximum(there, 1), 0.0), at_s
