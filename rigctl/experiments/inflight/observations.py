"""The lines of all halves as the workbench's vector of data, with the conditions they were flown in."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.baseline import Baseline, Stretch
from rigctl.experiments.inflight.model.observed import Observed
from rigctl.experiments.inflight.observe.sessions import DRIFT
from rigctl.workbench.study import NoisePool, Observations, Series

DIFFERENTIAL, OWN = "2 m_dx", "own channel"


def observations_of(given: Observed, baseline: Baseline) -> Observations:
    """Each half is a run of its own and a block."""
    series: dict[Series, int] = {}
    series_of: list[int] = []
    stretch_of: list[int] = []
    for number, each in enumerate(baseline.stretches):
        for channel, component in _components(each):
            series_of.append(series.setdefault(Series(channel, component, "m/s2"), len(series)))
            stretch_of.append(number)
    run_of_stretch = [run for run, each in enumerate(given.runs) for _ in each.halves]
    run_of = np.array(stretch_of, dtype=np.intp)
    return Observations(
        run_ids=tuple(each.run_id for each in baseline.stretches),
        series=tuple(series),
        pools=tuple(NoisePool(run.run_id, noise.dof) for run, noise in zip(given.runs, given.noises, strict=True)),
        value=baseline.observed(),
        sigma=baseline.sigma(),
        series_of=np.array(series_of, dtype=np.intp),
        run_of=run_of,
        pool_of=np.array(run_of_stretch, dtype=np.intp)[run_of],
        group_of=np.zeros(len(run_of), dtype=np.intp),
        block_of=np.arange(len(baseline.stretches), dtype=np.intp),
        covariates=_covariates(given),
        indicators=_sessions(given),
    )


def _components(stretch: Stretch) -> list[tuple[str, str]]:
    """Channel and component of each datum of a half."""
    names = []
    for place in stretch.compared:
        line = stretch.lines[place]
        where = line.name if line.harmonic == 0 else f"{stretch.session.name} {line.name}"
        parts = ("slope", "bend") if line == DRIFT else ("cosine", "sine")
        names += [(DIFFERENTIAL, f"{where} {part}") for part in parts]
    if stretch.has_own:
        names += [(OWN, f"{stretch.session.name} f {part}") for part in ("in-phase", "quadrature")]
    return names


def _covariates(given: Observed) -> dict[str, FloatArray]:
    """Columns over the halves: when, which half, and every number of runs.csv that varies."""
    rows = [(run, place, half) for run in given.runs for place, half in enumerate(run.halves)]
    covariates = {"half": np.array([float(place) for _, place, _ in rows])}
    names = dict.fromkeys(name for run in given.runs for name in run.conditions)
    for name in names:
        values = [run.conditions.get(name, math.nan) for run, _, _ in rows]
        numbers = [float(v) if isinstance(v, int | float) and not isinstance(v, bool) else math.nan for v in values]
        column = np.array(numbers)
        if name == "start_s":
            # The time of a half is that of its middle.
            column = column + np.array([0.5 * (half.start_s + half.stop_s) for _, _, half in rows])
        if np.isfinite(column).any() and np.nanmax(column) > np.nanmin(column):
            covariates[name] = column
    return covariates


def _sessions(given: Observed) -> dict[str, FloatArray]:
    """By session, in which halves it is: a line of the orbit that differs between sessions follows no number."""
    sessions = [run.session.name for run in given.runs for _ in run.halves]
    names = dict.fromkeys(sessions) if len(set(sessions)) > 2 else ()
    return {f"session {name}": np.array([float(each == name) for each in sessions]) for name in names}
