"""The Monte Carlo study of the in-flight calibration: many draws, on all cores or on a cluster.

Sessions come one after another, the draws of each in units that are flown at once. A unit that is reduced is in the
store, so that an interrupted study goes on with what is left. What comes out does not depend on where a unit was run.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event
from typing import TYPE_CHECKING, Any, Protocol, cast

from procedures.inflight.calibration import Flight, MonteCarlo, calibrate, check
from rigctl.core.errors import ConfigError, LinkError
from rigctl.core.interfaces import SatelliteEnsemble
from rigctl.experiments.inflight.result.monte_carlo import DRAW

if TYPE_CHECKING:
    from rigctl.campaign.session.session import Session
    from rigctl.kinds.inflight_draws import Unit
    from rigctl.rig import Rig

RECIPE = "inflight draws 2"
LOOKED_S = 0.2
"""How often somebody who waits for a unit looks whether the operator wants something."""


class Promise(Protocol):
    """A unit that is being worked on."""

    def result(self, timeout: float | None = None) -> bytes:
        """What came of it; `TimeoutError` when it takes longer."""
        ...


Submit = Callable[["Unit"], Promise]


@dataclass(frozen=True)
class MonteCarloPlan:
    """A study, waiting for its ensemble."""

    study: MonteCarlo

    @property
    def runs(self) -> int:
        """Sessions of all draws, and those whose samples are kept."""
        kept = len(self.study.sessions) if self.study.kept_draw >= 0 else 0
        return len(self.study.sessions) * self.study.draws + kept

    def on(self, rig: Rig) -> MonteCarloWork:
        """With the simulated satellites of a rig; `ConfigError` for a real one, and where telemetry gets lost."""
        from rigctl.kinds.inflight_campaign import flight_of

        flight = flight_of(rig)
        if rig.simulation is None:
            raise ConfigError(
                f"{rig.file.path}: a Monte Carlo study needs a simulated satellite; write address = 'sim:'"
            )
        ensemble: SatelliteEnsemble = rig.simulation.world.ensemble()
        if not ensemble.complete:
            raise ConfigError(
                f"{rig.file.path}: world.missing: a study reduces samples as they come, without gaps; leave it out"
            )
        check(flight, self.study)
        return MonteCarloWork(flight, self.study, ensemble, rig.simulation.operate)

    def told(self, rig: Rig) -> Mapping[str, Any]:
        """How many draws of what."""
        del rig
        sessions = self.study.sessions
        orbits = sum(self.study.orbits_of(name) for name in sessions)
        return {"draws": self.study.draws, "sessions": list(sessions), "orbits": orbits}

    def kept(self) -> Mapping[str, Any]:
        """Nothing beside the campaign file."""
        return {}


@dataclass(frozen=True)
class MonteCarloWork:
    """A study and its ensemble; `operate` are the hands that choose the satellite whose samples are kept."""

    flight: Flight
    study: MonteCarlo
    ensemble: SatelliteEnsemble
    operate: Callable[[Mapping[str, Any]], float]

    def rest(self) -> None:
        """Nothing moves that could rest."""

    def run(self, session: Session) -> None:
        """Carry it out; draws that are in the store already are not simulated again."""
        session.plan(MonteCarloPlan(self.study).runs)
        if self.study.kept_draw >= 0:
            self.operate({"draw": self.study.kept_draw})
            calibrate(session, self.flight, self.study)
        with _workers(self.study) as submit:
            for run, name in enumerate(self.study.sessions, 1):
                with session.step(f"session {name}"):
                    self._simulate(session, submit, run, name)
        with session.step("estimates"):
            self._estimate(session)

    def _units(self, run: int, name: str) -> dict[str, Unit]:
        from rigctl.kinds.inflight_draws import Unit

        everything = range(self.study.draws)
        draws = [tuple(everything[at : at + self.ensemble.at_once]) for at in everything[:: self.ensemble.at_once]]
        return {
            f"{name} of {some[0]} to {some[-1]}": Unit(
                self.ensemble, self.study, self.flight.orbit_period_s, name, run, some
            )
            for some in draws
        }

    def _simulate(self, session: Session, submit: Submit, run: int, name: str) -> None:
        units, there = self._units(run, name), session.store.reduced_names(RECIPE)
        promised = {key: submit(unit) for key, unit in units.items() if key not in there}
        for key, unit in units.items():
            if key in promised:
                session.store.keep_reductions(RECIPE, {key: _awaited(session, promised[key])})
            session.counted(len(unit.draws), replayed=key in there)

    def _estimate(self, session: Session) -> None:
        from rigctl.kinds.inflight_draws import ReducedUnit, draw_of, estimated

        scored = {int(document.data["draw"]) for document in session.store.documents(DRAW)}
        step_s, orbit_s = self.ensemble.sample_period_s, self.flight.orbit_period_s
        by_session = {name: self._units(run, name) for run, name in enumerate(self.study.sessions, 1)}
        for place, unit in enumerate(next(iter(by_session.values())).values()):
            if scored.issuperset(unit.draws):
                continue
            reduced: dict[str, ReducedUnit] = {}
            for name, units in by_session.items():
                data = session.store.reduction(RECIPE, list(units)[place])
                assert data is not None
                reduced[name] = ReducedUnit.from_bytes(data)
            for draw in sorted(set(unit.draws) - scored):
                session.checkpoint()
                found = estimated(draw, self.study, orbit_s, step_s, reduced)
                session.store.add_document(DRAW, draw_of(draw, found, self.ensemble.truths(draw)).as_json())


def _awaited(session: Session, promise: Promise) -> bytes:
    while True:
        session.checkpoint()
        try:
            return promise.result(timeout=LOOKED_S)
        except TimeoutError:
            continue


@contextmanager
def _workers(study: MonteCarlo) -> Iterator[Submit]:
    """Threads of this process (the loops let go of the interpreter), or the workers of a dask scheduler."""
    from rigctl.kinds.inflight_draws import reduce_unit

    if study.scheduler:
        with _cluster(study.scheduler) as submit:
            yield submit
        return
    pool = ThreadPoolExecutor(study.workers or os.cpu_count() or 1, thread_name_prefix="draws")
    leaving = Event()
    try:
        yield lambda unit: pool.submit(reduce_unit, unit, leaving.is_set)
    finally:
        # Who aborts does not wait for sixteen draws to come down.
        leaving.set()
        pool.shutdown(cancel_futures=True)


@contextmanager
def _cluster(address: str) -> Iterator[Submit]:
    from rigctl.kinds.inflight_draws import reduce_unit

    try:
        from distributed import Client
    except ImportError:
        raise ConfigError(
            "procedure.scheduler: the cluster's client is not installed; pip install 'rigctl[cluster]'"
        ) from None
    try:
        client: Any = cast(Any, Client)(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise LinkError(f"procedure.scheduler: no scheduler answers at {address} ({error}); start it first") from None
    with client:
        yield lambda unit: client.submit(reduce_unit, unit, pure=False)
