"""A run's columns on an evenly spaced grid, with what is missing, and thinned to a few seconds a sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.observe.series import NEEDED
from rigctl.experiments.inflight.observe.weights import taper

THINNED_S = 4.0
"""Step of thinned columns: effects and the noise near the lines are slower by far."""

_STAGES = 4
# Of a step: written times are rounded; more is another grid.
_SHIFT = 0.25
_WHOLE, _PART = 1.0 - 1e-9, 0.3
"""How much of the kernel must have met samples: all of it, or where that leaves less than `_ENOUGH` a part."""

_ENOUGH = 0.5
"""Part of the thinned samples that spectra and effects need."""


@dataclass(frozen=True)
class Grid:
    """Columns of shape (samples,) at times `t_s`, zero where `present` is False."""

    t_s: FloatArray
    columns: Mapping[str, FloatArray]
    present: BoolArray

    @property
    def step_s(self) -> float:
        """Between two samples."""
        return float(self.t_s[1] - self.t_s[0])

    @property
    def duration_s(self) -> float:
        """From the first sample to one step after the last."""
        return len(self.t_s) * self.step_s

    def part(self, where: slice) -> Grid:
        """A stretch of it."""
        return Grid(
            self.t_s[where], {name: column[where] for name, column in self.columns.items()}, self.present[where]
        )


def grid_of(run_id: str, samples: Mapping[str, FloatArray]) -> Grid:
    """The columns of a run on the grid of its times; a sample lacks where a needed column has no number.

    Raises `DataError` for missing columns and for times that fit no grid.
    """
    absent = [name for name in ("t_s", *NEEDED) if name not in samples]
    if absent:
        raise DataError(f"run {run_id}: column {absent[0]} is missing; add it")
    t_s = samples["t_s"]
    if len(t_s) < 2:
        raise DataError(f"run {run_id}: {len(t_s)} samples are too few")
    # The median step, made exact by the ends.
    step_s = float((t_s[-1] - t_s[0]) / round((t_s[-1] - t_s[0]) / float(np.median(np.diff(t_s)))))
    place = np.rint((t_s - t_s[0]) / step_s).astype(np.intp)
    if np.max(np.abs(t_s - t_s[0] - place * step_s)) > _SHIFT * step_s:
        raise DataError(f"run {run_id}: t_s is on no grid of {step_s:g} s; record evenly, gaps may stay")
    present = np.zeros(int(place[-1]) + 1, dtype=bool)
    present[place] = np.all([np.isfinite(samples[name]) for name in NEEDED], axis=0)
    whole = len(present) == len(t_s) and bool(present.all())
    columns = {name: column for name, column in samples.items() if name != "t_s"}
    if not whole:
        for name, column in columns.items():
            columns[name] = np.zeros(len(present))
            columns[name][place] = np.where(present[place], column, 0.0)
    return Grid(t_s[0] + np.arange(len(present)) * step_s, columns, present)


def bell(step_s: float, thinned_step_s: float = THINNED_S) -> FloatArray:
    """What thinned columns are averaged under, a weight per sample; its sum is 1."""
    every = _every(step_s, thinned_step_s)
    # Zeros of fourth order at every multiple of the thinned rate, where noise would fold onto zero.
    kernel = np.ones(1)
    for _ in range(_STAGES):
        kernel = np.convolve(kernel, np.ones(every) / every)
    return kernel


def _every(step_s: float, thinned_step_s: float) -> int:
    return max(round(thinned_step_s / step_s), 1)


def thinned(grid: Grid, thinned_step_s: float = THINNED_S) -> Grid:
    """Averages under a smooth bell about every few seconds; the same for all columns, so that what is linear holds.

    The bell (a boxcar with itself, four times) keeps read-out noise from folding down to the lines.
    """
    every, kernel = _every(grid.step_s, thinned_step_s), bell(grid.step_s, thinned_step_s)
    weight = grid.present.astype(np.float64)
    met = _averages(kernel, weight, every)
    used = met > _WHOLE
    if np.mean(used) < _ENOUGH:
        # Among many gaps the average is of what is there: of another time, which a strong line shows.
        weight = taper(grid.present, grid.step_s)
        met = _averages(kernel, weight, every)
        used = met > _PART
    share = np.where(used, met, 1.0)
    columns = {
        name: np.where(used, _averages(kernel, weight * _filled(column), every) / share, 0.0)
        for name, column in grid.columns.items()
    }
    places = np.flatnonzero(used)
    if len(places) < 2:
        raise DataError("too few samples are left between the gaps")
    kept = slice(int(places[0]), int(places[-1]) + 1)
    t_s = grid.t_s[0] + (np.arange(len(met)) * every - 0.5 * (len(kernel) - 1)) * grid.step_s
    return Grid(t_s, columns, used).part(kept)


def _averages(kernel: FloatArray, column: FloatArray, every: int) -> FloatArray:
    """The column under the kernel, once `every` samples; zero is beyond its ends.

    As `scipy.signal.upfirdn`, whose import takes longer than all sessions of a calibration are thinned in.
    """
    pieces = -(-len(kernel) // every)
    # A piece for each block of samples that the kernel reaches back to, in the order of the samples.
    weights = np.pad(kernel, (0, pieces * every - len(kernel))).reshape(pieces, every)[:, ::-1]
    count = (len(column) + len(kernel) - 2) // every + 1
    blocks = np.zeros((count, every))
    blocks.ravel()[every - 1 : every - 1 + len(column)] = column
    met = blocks @ weights.T
    for back in range(1, pieces):
        met[back:, 0] += met[:-back, back]
    return met[:, 0]


def _filled(column: FloatArray) -> FloatArray:
    """Without holes: a laboratory's own column may lack a number where the needed ones have theirs."""
    there = np.isfinite(column)
    if there.all() or not there.any():
        return np.where(there, column, 0.0)
    place = np.arange(len(column))
    return np.interp(place, place[there], column[there])


def thinning_gain(f_hz: FloatArray, step_s: float, thinned_step_s: float) -> FloatArray:
    """What thinning leaves of a line's amplitude."""
    every = max(round(thinned_step_s / step_s), 1)
    x = np.pi * np.asarray(f_hz) * step_s
    return np.asarray((np.sin(every * x) / (every * np.sin(np.where(x == 0.0, 1.0, x)))) ** _STAGES)
