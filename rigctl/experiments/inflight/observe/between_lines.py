"""What lies between the lines of a run: the Fourier bins of all series where no line is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.inflight.observe.grid import Grid, thinning_gain
from rigctl.experiments.inflight.observe.series import raw_series
from rigctl.experiments.inflight.observe.sessions import STIMULUS, Line, Session
from rigctl.experiments.inflight.observe.weights import taper, templates


@dataclass(frozen=True)
class BetweenLines:
    """Fourier bins (bins, series) at `f_hz` (bins,), scaled so that |bin|^2 is the one-sided density of a series."""

    f_hz: FloatArray
    bins: ComplexArray

    def density(self, c: FloatArray) -> FloatArray:
        """Of the series weighted with `c` (series,)."""
        return np.asarray(np.abs(self.bins @ c) ** 2)


def between_lines(session: Session, grid: Grid) -> BetweenLines:
    """The spectrum of thinned columns under a Hann window, lines and slow drift fitted out, their bins left out."""
    lines_hz = _lines_to_leave_out(session, grid.duration_s)
    central = {
        name: np.where(grid.present, column - column[grid.present].mean(), 0.0) if name.startswith("m") else column
        for name, column in grid.columns.items()
    }
    left = _without_lines(grid, raw_series(session, grid.t_s, central), lines_hz)
    window = np.hanning(len(left)) * grid.present
    f_hz = np.fft.rfftfreq(len(left), grid.step_s)
    highest_hz = min(max(1.6 * lines_hz[-1], 30.0 * session.orbital_hz), 0.25 / grid.step_s)
    apart = np.min(np.abs(f_hz[:, None] - np.array(lines_hz)), axis=1)
    used = (f_hz > 0.4 * session.orbital_hz) & (f_hz < highest_hz) & (apart > 2.0 / grid.duration_s)
    bins = np.fft.rfft(window[:, None] * left, axis=0)[used]
    scale = np.sqrt(2.0 * grid.step_s / np.sum(window**2))
    gain = thinning_gain(f_hz[used], session.sample_period_s, grid.step_s)
    return BetweenLines(f_hz[used], np.asarray(scale * bins / gain[:, None]))


def _lines_to_leave_out(session: Session, duration_s: float) -> list[float]:
    """Every line that an unmodelled effect may have as well."""
    lines = list(session.reduced_lines(duration_s)) + [Line(0, k) for k in range(5, 9)]
    if session.frequency_hz > 0.0:
        lines += [STIMULUS, *(Line(h, j) for h in (1, 2, 3) for j in range(-4, 5))]
    frequencies_hz = sorted({session.frequency_of(line) for line in lines})
    highest_hz = 0.2 / max(session.sample_period_s, 1.0)
    return [f_hz for f_hz in frequencies_hz if 0.5 / duration_s < f_hz < highest_hz]


def _without_lines(grid: Grid, left: FloatArray, lines_hz: list[float]) -> FloatArray:
    x = np.linspace(-1.0, 1.0, len(left))
    least_hz = 0.9 / grid.duration_s
    apart = [lines_hz[0], *(after for before, after in pairwise(lines_hz) if after - before > least_hz)]
    design = np.vstack([templates(grid.t_s, apart), np.ones_like(x), x, x**2])
    weighted = design * taper(grid.present, grid.step_s)
    fitted = np.linalg.solve(weighted @ design.T, weighted @ left)
    return np.asarray(left - design.T @ fitted)
