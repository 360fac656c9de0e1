"""Sessions that could be flown: those there are, with what they inject made stronger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.observe.grid import Grid
from rigctl.experiments.inflight.observe.reduction import ReducedRun, reduce_run
from rigctl.experiments.inflight.observe.sessions import Line
from rigctl.experiments.inflight.observe.weights import templates, weights

_FOLLOWS = (
    *(Line(1, orbital) for orbital in range(-3, 4)),
    *(Line(2, orbital) for orbital in range(-1, 2)),
    Line(3, 0),
)


def stronger(run: ReducedRun, run_id: str, amplitude: float) -> ReducedRun:
    """A run as if `amplitude` had been injected: in every column the lines at and beside the stimulus grow with it,
    those at its harmonics as its powers."""
    session = run.session
    if amplitude == session.amplitude:
        return replace(run, run_id=run_id)
    conditions = {**run.conditions, "amplitude": amplitude}
    made = reduce_run(run_id, conditions, _grown(run, amplitude / session.amplitude), session.orbit_period_s)
    return replace(made, remarks=run.remarks)


def _grown(run: ReducedRun, factor: float) -> dict[str, FloatArray]:
    grid: Grid = run.coarse
    lines_hz = [run.session.frequency_of(line) for line in _FOLLOWS]
    rows, waves = weights(grid.t_s, lines_hz, grid.present), templates(grid.t_s, lines_hz)
    more = np.repeat([factor**line.harmonic - 1.0 for line in _FOLLOWS], 2)
    columns = {
        name: np.where(grid.present, column + (more * (rows @ column)) @ waves, np.nan)
        for name, column in grid.columns.items()
    }
    return {"t_s": grid.t_s, **columns}
