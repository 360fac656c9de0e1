"""A run reduced: amplitudes of all series at its lines, in whole and in halves, and what lies between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.observe.edge import fast_noise
from rigctl.experiments.inflight.observe.gravity import trace_remark
from rigctl.experiments.inflight.observe.grid import Grid, grid_of, thinned, thinning_gain
from rigctl.experiments.inflight.observe.series import Amplitudes, raw_series, stretch_amplitudes
from rigctl.experiments.inflight.observe.sessions import (
    DRIFT,
    HALVES,
    STIMULUS,
    Line,
    Session,
    fewest_orbits,
    session_of,
)
from rigctl.experiments.inflight.observe.waves import templates
from rigctl.experiments.inflight.observe.weights import drift_weights, level_weights, spread, taper, weights


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
    # Two bins: the half width of a Hann window's main lobe.
    used = (f_hz > 0.4 * session.orbital_hz) & (f_hz < highest_hz) & (apart > 2.0 / grid.duration_s)
    bins = np.fft.rfft(window[:, None] * left, axis=0)[used]
    scale = np.sqrt(2.0 * grid.step_s / np.sum(window**2))
    # The bell of the thinning is divided out.
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
    # Lines nearer than that are one to a stretch so long.
    least_hz = 0.9 / grid.duration_s
    apart = [lines_hz[0], *(after for before, after in pairwise(lines_hz) if after - before > least_hz)]
    design = np.vstack([templates(grid.t_s, apart), np.ones_like(x), x, x**2])
    weighted = design * taper(grid.present, grid.step_s)
    fitted = np.linalg.solve(weighted @ design.T, weighted @ left)
    return np.asarray(left - design.T @ fitted)


_REMARKED, _WHOLE = 1e-4, 1e-6


@dataclass(frozen=True)
class ReducedStretch:
    """Amplitudes at `lines`; `spread` (lines,) is the standard uncertainty of one component in noise of unit density
    (one-sided, per Hz), `fast` (2 lines, 4, 4) what `edge.fast_noise` says of a whole run without gaps."""

    start_s: float
    stop_s: float
    lines: tuple[Line, ...]
    amplitudes: Amplitudes
    spread: FloatArray
    fast: FloatArray | None = None

    def at(self, lines: Sequence[Line]) -> ReducedStretch:
        """At those of its lines that are among `lines`."""
        kept = [place for place, line in enumerate(self.lines) if line in lines]
        amplitudes = replace(self.amplitudes, table=self.amplitudes.table[kept])
        return replace(
            self, lines=tuple(self.lines[k] for k in kept), amplitudes=amplitudes, spread=self.spread[kept]
        )


@dataclass(frozen=True)
class ReducedRun:
    """A run: `whole` at the lines of the published estimate, `halves` at all that are observed; `between` them the
    noise; `coarse` are thinned columns for effects, `remarks` for whoever reads the result."""

    run_id: str
    session: Session
    conditions: Mapping[str, Any]
    whole: ReducedStretch
    halves: tuple[ReducedStretch, ...]
    between: BetweenLines
    coarse: Grid
    remarks: tuple[str, ...] = ()

    @property
    def duration_s(self) -> float:
        """Of all of it."""
        return self.whole.stop_s - self.whole.start_s


def reduce_run(
    run_id: str, conditions: Mapping[str, Any], samples: Mapping[str, FloatArray], orbit_period_s: float
) -> ReducedRun:
    """Reduce a run; `DataError` when it is too short, too patchy or not a session at all."""
    grid = grid_of(run_id, samples)
    session = session_of(run_id, conditions, orbit_period_s, grid.step_s)
    orbits = grid.duration_s / orbit_period_s
    if orbits < (least := fewest_orbits(session.name)):
        raise DataError(
            f"run {run_id}: {orbits:.3g} orbits are too short to tell its lines apart; record at least {least:g}"
        )
    if session.frequency_hz >= 0.4 / grid.step_s:
        raise DataError(
            f"run {run_id}: samples every {grid.step_s:g} s are too few for a stimulus of {session.frequency_hz:g} Hz"
        )
    try:
        coarse = thinned(grid)
        return ReducedRun(
            run_id,
            session,
            dict(conditions),
            _whole(session, grid),
            halves_of(session, grid),
            between_lines(session, coarse),
            coarse,
            _remarks(session, grid, conditions),
        )
    except DataError as error:
        raise DataError(f"run {run_id}: {error}") from error


def halves_of(session: Session, grid: Grid) -> tuple[ReducedStretch, ...]:
    """Both halves of a run at all lines that they resolve; `DataError` where samples are too few for that."""
    middle = len(grid.t_s) // HALVES
    parts = [grid.part(where) for where in (slice(0, middle), slice(middle, None))]
    return tuple(_stretch(session, part, session.reduced_lines(part.duration_s), drift=True) for part in parts)


def _whole(session: Session, grid: Grid) -> ReducedStretch:
    lines = session.fitted_lines()
    stretch = _stretch(session, grid, lines)
    if not grid.present.all():
        # Weights of runs with gaps go to nothing without an edge.
        return stretch
    frequencies, known = _frequencies(session, grid, lines)
    rows, _ = _rows(float(grid.t_s[0]), grid.step_s, len(grid.t_s), frequencies, known)
    return replace(stretch, fast=fast_noise(rows, grid.columns, grid.step_s, max(frequencies)))


def _frequencies(session: Session, grid: Grid, lines: Sequence[Line]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Of lines, and of all that are known in a stretch so long."""
    known = session.reduced_lines(grid.duration_s)
    return tuple(session.frequency_of(line) for line in lines), tuple(session.frequency_of(line) for line in known)


def _stretch(session: Session, grid: Grid, lines: Sequence[Line], *, drift: bool = False) -> ReducedStretch:
    # Levels beside all known lines, also those that are not asked for: they are in the samples all the same.
    frequencies, known = _frequencies(session, grid, lines)
    # Whole stretches share their weights, which are large; every pattern of gaps has its own.
    if bool(grid.present.all()):
        rows, level = _rows(float(grid.t_s[0]), grid.step_s, len(grid.t_s), frequencies, known)
        drift = False
    else:
        rows, level = weights(grid.t_s, frequencies, grid.present), level_weights(grid.t_s, known, grid.present)
    if drift:
        rows = np.vstack([rows, drift_weights(grid.t_s, frequencies, grid.present)])
        lines = (*lines, DRIFT)
    amplitudes = stretch_amplitudes(session, grid.t_s, grid.columns, rows, level)
    squares = np.einsum("rs,rs->r", rows, rows)
    if drift:
        # The bend is as well known as the slope by its scale.
        squares[-1] = squares[-2]
    start_s, each = float(grid.t_s[0]), spread(squares, grid.step_s)
    return ReducedStretch(start_s, start_s + grid.duration_s, tuple(lines), amplitudes, each)


@lru_cache(maxsize=3)
def _rows(
    start_s: float, step_s: float, count: int, lines_hz: tuple[float, ...], known_hz: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """Weights of whole stretches, which sessions share; a few at a time: they are large."""
    t_s = np.asarray(start_s + np.arange(count) * step_s, dtype=np.float64)
    return weights(t_s, lines_hz), level_weights(t_s, known_hz)


def _remarks(session: Session, grid: Grid, conditions: Mapping[str, Any]) -> tuple[str, ...]:
    remarks = []
    missing = 1.0 - float(np.mean(grid.present))
    if missing > 0.0:
        remarks.append(f"{100.0 * missing:.2g} % of its samples are missing: lines are fitted on those there are")
    cycles = session.frequency_hz * grid.duration_s
    if abs(cycles - round(cycles)) > max(_WHOLE * cycles, 1e-3):
        remarks.append(
            f"the stimulus has {cycles:.3f} periods in the run, no whole number: lines are fitted jointly, "
            "and what is not fitted leaks into them"
        )
    declared = conditions.get("orbits")
    orbits = grid.duration_s / session.orbit_period_s
    if isinstance(declared, int | float) and declared > 0.0 and abs(orbits / declared - 1.0) > _REMARKED:
        remarks.append(f"it has {orbits:.5g} orbits, not {declared:g} as runs.csv says")
    if STIMULUS not in session.reduced_lines(grid.duration_s / HALVES) and session.moves_masses:
        remarks.append("its stimulus is too close to a line of the orbit to be resolved")
    there = {name: column[grid.present] for name, column in grid.columns.items()}
    if trace := trace_remark(there):
        remarks.append(trace)
    return tuple(remarks)
