"""The Monte Carlo study of the in-flight calibration: many draws, on all cores or on a cluster.

Draws come in blocks that are flown at once: all sessions of a block, then its estimates. What is reduced is in the
store, so that an interrupted study goes on with what is left. What comes out does not depend on where a unit was run.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event
from typing import Any, Protocol, cast

from procedures.campaigns import Instruments, Plan, Work
from procedures.inflight.bench import Flight, flight_of
from procedures.inflight.calibration import calibrate, check
from procedures.inflight.tables import MonteCarlo
from rigctl.analysis.kept import Kept, Packed, Recipe
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.parts import Part
from rigctl.core.errors import ConfigError, DataError, LinkError
from rigctl.core.satellites import SatelliteEnsemble
from rigctl.effects.plugins import Plugin
from rigctl.experiments.inflight.observe.sessions import SessionName, session_of
from rigctl.experiments.inflight.result.draws import (
    ExpectedNoise,
    Flown,
    chunk_of,
    estimated,
    reduced,
)
from rigctl.experiments.inflight.result.monte_carlo import DRAW
from rigctl.files.campaign_file import CampaignFile
from rigctl.files.toml_files import validated

RECIPE = Recipe("inflight draws", 3)
LOOKED_S = 0.2
"""While it waits for a unit, the study looks so often whether the operator asked for a pause or an end."""


class Promise(Protocol):
    """A unit that is being worked on."""

    def result(self, timeout: float | None = None) -> Packed:
        """What came of it; `TimeoutError` when it takes longer."""
        ...


@dataclass(frozen=True)
class Unit:
    """A session of some draws of an ensemble: it can be pickled, so it may be reduced elsewhere."""

    ensemble: SatelliteEnsemble
    study: MonteCarlo
    orbit_period_s: float
    name: SessionName
    run: int
    draws: tuple[int, ...]

    @property
    def flown(self) -> Flown:
        """Its session as the analysis knows it."""
        return flown(self.study, self.name, self.orbit_period_s, self.ensemble.sample_period_s)


Submit = Callable[[Unit], Promise]


def flown(study: MonteCarlo, name: SessionName, orbit_period_s: float, step_s: float) -> Flown:
    """A session of a study as the analysis knows it."""
    return Flown(
        session_of(name, study.conditions(name, step_s), orbit_period_s, step_s),
        study.session(name, orbit_period_s).duration_s,
        ExpectedNoise(study.expected_m_s2_rthz, study.expected_corner_hz, study.expected_readout_m_rthz),
    )


def _never() -> bool:
    return False


def reduce_unit(unit: Unit, unwanted: Callable[[], bool] = _never) -> Packed:
    """Simulate a unit and reduce it. `NotWanted` as soon as it is `unwanted`."""
    flight_session = unit.study.session(unit.name, unit.orbit_period_s)
    telemetry = unit.ensemble.telemetry(unit.draws, unit.run, flight_session, chunk_of(unit.flown))
    # Asked by the reduction while telemetry comes, as a unit of sixteen draws takes seconds.
    return reduced(unit.flown, telemetry, unit.ensemble.columns, unit.draws, unwanted)


@dataclass(frozen=True)
class MonteCarloPlan(Plan):
    """A study, waiting for its ensemble."""

    study: MonteCarlo

    @property
    def runs(self) -> int:
        """Sessions of all draws, and those whose samples are kept."""
        kept = len(self.study.sessions) if self.study.kept_draw >= 0 else 0
        return len(self.study.sessions) * self.study.draws + kept

    def on(self, rig: Instruments) -> MonteCarloWork:
        """With the simulated satellites of a rig; `ConfigError` for a real one, and where telemetry gets lost."""
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

    def forecast(self, rig: Instruments) -> Mapping[str, Any]:
        """How many draws of what."""
        del rig
        sessions = self.study.sessions
        orbits = sum(self.study.orbits_of(name) for name in sessions)
        return {"draws": self.study.draws, "sessions": list(sessions), "orbits": orbits}


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> MonteCarloPlan:
    """The study a campaign file asks for; `ConfigError`."""
    del part, plugins
    return MonteCarloPlan(validated(MonteCarlo, campaign.procedure, campaign.path, "procedure"))


@dataclass(frozen=True)
class MonteCarloWork(Work):
    """A study and its ensemble; `operate` are the hands that choose the satellite whose samples are kept."""

    flight: Flight
    study: MonteCarlo
    ensemble: SatelliteEnsemble
    operate: Callable[[Mapping[str, Any]], float]

    def run(self, session: Session) -> None:
        """Carry it out; draws that are in the store already are not simulated again."""
        session.plan(MonteCarloPlan(self.study).runs)
        if self.study.kept_draw >= 0:
            self.operate({"draw": self.study.kept_draw})
            calibrate(session, self.flight, self.study)
        with _workers(self.study) as submit:
            self._calibrate(session, submit)

    def _units(self, run: int, name: SessionName) -> dict[str, Unit]:
        everything = range(self.study.draws)
        # As many draws as fill the compiled loop: one alone would cost as much.
        draws = [tuple(everything[at : at + self.ensemble.at_once]) for at in everything[:: self.ensemble.at_once]]
        return {
            f"{name} of {some[0]} to {some[-1]}": Unit(
                self.ensemble, self.study, self.flight.orbit_period_s, name, run, some
            )
            for some in draws
        }

    def _calibrate(self, session: Session, submit: Submit) -> None:
        """All sessions of some draws and their estimates, then those of the next: errors are seen on the way."""
        sessions = [list(self._units(run, name).items()) for run, name in enumerate(self.study.sessions, 1)]
        blocks = [dict(units) for units in zip(*sessions, strict=True)]
        kept = Kept(session.store, RECIPE)
        reduced_keys = session.store.reduced_names(str(RECIPE))
        scored = {int(document.data["draw"]) for document in session.store.documents(DRAW)}
        # All at once, so that workers are never idle; what comes of them is taken in order.
        promised = {key: submit(unit) for block in blocks for key, unit in block.items() if key not in reduced_keys}
        for block in blocks:
            draws = next(iter(block.values())).draws
            with session.step(f"draws {draws[0]} to {draws[-1]}"):
                for key, unit in block.items():
                    if key in promised:
                        kept.put(key, _awaited(session, promised.pop(key)))
                    session.counted(len(unit.draws), replayed=key in reduced_keys)
                # Scores that are kept need neither their units nor another estimate.
                if unscored := sorted(set(draws) - scored):
                    self._estimate(session, kept, block, unscored)

    def _estimate(self, session: Session, kept: Kept, block: Mapping[str, Unit], draws: Sequence[int]) -> None:
        sessions: dict[str, Flown] = {unit.name: unit.flown for unit in block.values()}
        units: dict[str, Packed] = {unit.name: _there(kept, key) for key, unit in block.items()}
        for draw in draws:
            session.checkpoint()
            scores = estimated(draw, sessions, units, self.ensemble.truths(draw))
            session.store.add_document(DRAW, scores.as_json())


def _there(kept: Kept, key: str) -> Packed:
    """A reduced unit; `DataError` when it cannot be read."""
    unit = kept.get(key, lambda packed: packed)
    if unit is None:
        raise DataError(f"the reduced sessions {key} of the study cannot be read; run the study again in a new store")
    return unit


def _awaited(session: Session, promise: Promise) -> Packed:
    while True:
        session.checkpoint()
        try:
            return promise.result(timeout=LOOKED_S)
        except TimeoutError:
            continue


@contextmanager
def _workers(study: MonteCarlo) -> Iterator[Submit]:
    """Threads of this process (the loops let go of the interpreter), or the workers of a dask scheduler."""
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
