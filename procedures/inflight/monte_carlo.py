"""The Monte Carlo study of the in-flight calibration: many draws, by all cores or by a cluster.

Draws come in blocks that are flown at once: all sessions of a block, then its estimates. What is reduced is in the
store, so that an interrupted study goes on with what is left. What comes out does not depend on where a unit was run.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from procedures.campaigns import Instruments, Plan, Work
from procedures.inflight.bench import Flight, flight_of
from procedures.inflight.calibration import calibrate, check
from procedures.inflight.tables import MonteCarlo
from rigctl.analysis.kept import Kept, Packed, Recipe
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.parts import Part
from rigctl.core.errors import ConfigError, DataError
from rigctl.core.satellites import SatelliteEnsemble
from rigctl.core.workers import Workers, in_order, outcomes_of
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

RECIPE = Recipe("inflight draws", 4)


@dataclass(frozen=True)
class Unit:
    """A session of some draws of an ensemble; it can be pickled."""

    ensemble: SatelliteEnsemble
    study: MonteCarlo
    orbit_period_s: float
    name: SessionName
    run: int
    draws: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.name} of {self.draws[0]} to {self.draws[-1]}"

    @property
    def flown(self) -> Flown:
        """Its session as the analysis knows it."""
        return flown(self.study, self.name, self.orbit_period_s, self.ensemble.sample_period_s)


def flown(study: MonteCarlo, name: SessionName, orbit_period_s: float, step_s: float) -> Flown:
    """A session of a study as the analysis knows it."""
    return Flown(
        session_of(name, study.conditions(name, step_s), orbit_period_s, step_s),
        study.session(name, orbit_period_s).duration_s,
        ExpectedNoise(study.expected_m_s2_rthz, study.expected_corner_hz, study.expected_readout_m_rthz),
    )


def _nothing() -> None:
    return


def reduce_unit(unit: Unit, going_on: Callable[[], None] = _nothing) -> Packed:
    """Simulate a unit and reduce it; `going_on` is called all along, and raises when nobody waits any more."""
    flight_session = unit.study.session(unit.name, unit.orbit_period_s)
    telemetry = unit.ensemble.telemetry(unit.draws, unit.run, flight_session, chunk_of(unit.flown))
    return reduced(unit.flown, telemetry, unit.ensemble.columns, unit.draws, going_on)


@dataclass(frozen=True)
class MonteCarloPlan(Plan):
    """A study, waiting for its ensemble, and who flies it."""

    study: MonteCarlo
    workers: Workers

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
        return MonteCarloWork(flight, self, ensemble, rig.simulation.operate)

    def forecast(self, rig: Instruments) -> Mapping[str, Any]:
        """How many draws of what."""
        del rig
        sessions = self.study.sessions
        orbits = sum(self.study.orbits_of(name) for name in sessions)
        return {"draws": self.study.draws, "sessions": list(sessions), "orbits": orbits}

    def by(self, workers: Workers) -> MonteCarloPlan:
        """The same study flown by others."""
        return replace(self, workers=workers)


def plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin]) -> MonteCarloPlan:
    """The study a campaign file asks for; `ConfigError`."""
    del part, plugins
    study = validated(MonteCarlo, campaign.procedure, campaign.path, "procedure")
    return MonteCarloPlan(study, Workers(study.workers, study.scheduler))


@dataclass(frozen=True)
class MonteCarloWork(Work):
    """A study and its ensemble; `operate` are the hands that choose the satellite whose samples are kept."""

    flight: Flight
    plan: MonteCarloPlan
    ensemble: SatelliteEnsemble
    operate: Callable[[Mapping[str, Any]], float]

    def run(self, session: Session) -> None:
        """Carry it out; draws that are in the store already are not simulated again."""
        session.plan(self.plan.runs)
        study = self.plan.study
        if study.kept_draw >= 0:
            self.operate({"draw": study.kept_draw})
            calibrate(session, self.flight, study)
        blocks = [self._block(draws) for draws in self._draws()]
        known = session.store.reduced_names(str(RECIPE))
        left = [unit for block in blocks for unit in block if str(unit) not in known]
        # Here, the work heeds the operator itself, as a unit of sixteen draws takes seconds.
        work = partial(reduce_unit, going_on=session.checkpoint) if self.plan.workers.here(len(left)) else reduce_unit
        with outcomes_of(work, left, self.plan.workers, session.checkpoint) as outcomes:
            self._score(session, blocks, known, in_order(outcomes))

    def _draws(self) -> list[tuple[int, ...]]:
        """As many at a time as fill the compiled loop: one alone would cost as much."""
        everything, at_once = range(self.plan.study.draws), self.ensemble.at_once
        return [tuple(everything[at : at + at_once]) for at in everything[::at_once]]

    def _block(self, draws: tuple[int, ...]) -> list[Unit]:
        """All sessions of some draws."""
        study = self.plan.study
        return [
            Unit(self.ensemble, study, self.flight.orbit_period_s, name, run, draws)
            for run, name in enumerate(study.sessions, 1)
        ]

    def _score(
        self, session: Session, blocks: Sequence[Sequence[Unit]], known: Collection[str], new: Iterator[Packed]
    ) -> None:
        """All sessions of some draws and their estimates, then those of the next: errors are seen on the way."""
        kept = Kept(session.store, RECIPE)
        scored = {int(document.data["draw"]) for document in session.store.documents(DRAW)}
        for block in blocks:
            draws = block[0].draws
            with session.step(f"draws {draws[0]} to {draws[-1]}"):
                for unit in block:
                    if str(unit) not in known:
                        kept.put(str(unit), next(new))
                    session.counted(len(unit.draws), replayed=str(unit) in known)
                # Scores that are kept need neither their units nor another estimate.
                if unscored := sorted(set(draws) - scored):
                    self._estimate(session, kept, block, unscored)

    def _estimate(self, session: Session, kept: Kept, block: Sequence[Unit], draws: Sequence[int]) -> None:
        sessions: dict[str, Flown] = {unit.name: unit.flown for unit in block}
        units: dict[str, Packed] = {unit.name: _there(kept, unit) for unit in block}
        for draw in draws:
            session.checkpoint()
            scores = estimated(draw, sessions, units, self.ensemble.truths(draw))
            session.store.add_document(DRAW, scores.as_json())


def _there(kept: Kept, unit: Unit) -> Packed:
    """A reduced unit; `DataError` when it cannot be read."""
    reduced_unit = kept.get(str(unit), lambda packed: packed)
    if reduced_unit is None:
        raise DataError(
            f"the reduced sessions {unit} of the study cannot be read; run the study again in a new store"
        )
    return reduced_unit
