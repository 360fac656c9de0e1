"""What the effects of a model do to a session of the test, with the parameters that the calibration gave them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.inflight.effect_changes import STEP
from rigctl.experiments.inflight.effects import OF_THE_ORBIT
from rigctl.experiments.inflight.model.flight import PLACE_POINT, FlightRun, added_to_series, flight_run
from rigctl.experiments.inflight.observe.equivalence import GRAVITY, Acting, TestRun, TestSums, less_inertia
from rigctl.experiments.inflight.observe.grid import Grid, grid_of, thinned
from rigctl.experiments.inflight.observe.series import SERIES, covered
from rigctl.experiments.inflight.observe.weights import taper


def corrected(
    runs: Sequence[TestRun], source: RunSource, effects: Sequence[tuple[Effect, FloatArray]], usual_k: FloatArray
) -> tuple[list[TestRun], list[bool]]:
    """Sessions with what each parameter of `effects` does in them, and which effects that can be told of.

    Effects are linear about the values given with them. `usual_k` (2,) are the sensors' temperatures at which the
    baseline holds.
    """
    if not effects:
        return [*runs], []
    conditions = {record.run_id: record.conditions for record in source.runs()}
    sessions = [_ThinnedTest(run, source.samples(run.run_id), conditions[run.run_id], usual_k) for run in runs]
    made, told = [*runs], []
    for effect, values in effects:
        try:
            acting = [session.acting(effect, values) for session in sessions]
        except DataError:
            told.append(False)
            continue
        told.append(True)
        made = [_acted(run, always, units) for run, (always, units) in zip(made, acting, strict=True)]
    return made, told


def _acted(run: TestRun, always: Acting, units: Sequence[Acting]) -> TestRun:
    return replace(
        run,
        amplitudes=run.amplitudes - always.amplitudes,
        beside=run.beside - always.beside,
        acting=(*run.acting, *units),
    )


class _ThinnedTest:
    """A session of the test averaged to some seconds a sample, as effects see it."""

    def __init__(
        self,
        run: TestRun,
        samples: Mapping[str, FloatArray],
        conditions: Mapping[str, object],
        usual_k: FloatArray,
    ) -> None:
        grid = grid_of(run.run_id, samples)
        present = grid.present & np.all([np.isfinite(grid.columns[name]) for name in GRAVITY], axis=0)
        self._grid = thinned(replace(grid, present=present & ~covered(grid.t_s, run.pulses_s)))
        self._run, self._conditions, self._usual_k = run, conditions, usual_k
        self._flights: dict[str, FlightRun] = {}
        self._nothing = Acting(np.zeros_like(run.amplitudes), np.zeros_like(run.beside))

    def acting(self, effect: Effect, values: FloatArray) -> tuple[Acting, list[Acting]]:
        """What does not go with its parameters, and what each unit of them does; `DataError` where nobody can say."""
        if effect.id in OF_THE_ORBIT:
            raise DataError(f"run {self._run.run_id}: '{effect.id}' is another one in the test")
        units = [self._slope(effect, values, place) for place in range(len(values))]
        linear = [_times(-value, unit) for value, unit in zip(values.tolist(), units, strict=True)]
        return _sum([self._changes(effect, values), *linear]), units

    def _slope(self, effect: Effect, values: FloatArray, place: int) -> Acting:
        """d changes / d a parameter, by differences."""
        step = STEP * abs(effect.typical[list(effect.parameters)[place]])
        one = step * np.eye(len(values))[place]
        up, down = (self._changes(effect, values + each) for each in (one, -one))
        return _times(0.5 / step, _sum([up, _times(-1.0, down)]))

    def _changes(self, effect: Effect, values: FloatArray) -> Acting:
        """What an effect adds, through the reduction of the session."""
        if effect.on not in self._flights:
            self._flights[effect.on] = flight_run(
                self._run.session, self._seen_at(effect.on), self._conditions, effect.on, self._usual_k
            )
        parameters = dict(zip(effect.parameters, map(float, values), strict=True))
        changed = added_to_series(self._run.run_id, self._flights[effect.on], effect, parameters)
        if not changed:
            return self._nothing
        grid = self._grid
        series = np.zeros((len(grid.t_s), len(SERIES)))
        series[:, list(changed)] = np.array(list(changed.values())).T
        session = replace(self._run.session, sample_period_s=grid.step_s)
        # Averages are of the same session: beside the line they are looked at where the samples were.
        lasts_s = self._run.orbits * session.orbit_period_s
        sums = TestSums(session, grid.t_s, taper(grid.present, grid.step_s), 1, lasts_s)
        sums.add_series(0, len(grid.t_s), [(np.stack([grid.columns[name] for name in GRAVITY]), series)])
        [found] = sums.runs([self._run.run_id])
        return Acting(found.amplitudes, found.beside)

    def _seen_at(self, point: str) -> Grid:
        """Where the satellite turns, off-centring meets the centrifugal gradient as well."""
        session, grid = self._run.session, self._grid
        if point != PLACE_POINT or not session.spin_hz:
            return grid
        turned = less_inertia(session, grid.step_s, grid.columns)
        return replace(grid, columns={**grid.columns, **turned})


def _times(factor: float, one: Acting) -> Acting:
    return Acting(factor * one.amplitudes, factor * one.beside)


def _sum(parts: Sequence[Acting]) -> Acting:
    return Acting(
        np.sum([each.amplitudes for each in parts], axis=0), np.sum([each.beside for each in parts], axis=0)
    )
