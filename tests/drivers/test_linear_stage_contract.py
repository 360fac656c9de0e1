"""What every `LinearStage` promises, held against each backend.

A real stage is tested with `pytest -m bench_attached` and its address in RIGCTL_LINEAR_STAGE
(`tcp://host:8000`). It is homed and moved by up to 5 mm about its home.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pytest

from drivers.aerotech_ensemble import AerotechEnsemble, EnsembleSettings
from drivers.aerotech_soloist import AerotechSoloist, SoloistSettings
from drivers.connect import connector
from drivers.transport import Connect, InProcessTransport
from rigctl.core.clock import RealClock
from simulators.aerotech_ensemble import GENTLE, EnsembleDialect, EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.aerotech_ensemble.dialect import StageDialect
from simulators.aerotech_soloist import GENTLE as GENTLE_SOLOIST
from simulators.aerotech_soloist import SimulatedSoloist, SoloistDialect, SoloistSimulatorSettings
from simulators.clock import SimulationClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine
from tests.drivers.linear_stage_contract import *  # noqa: F403 - the suite itself
from tests.drivers.linear_stage_contract import Backend, MakeBackend


@dataclass(frozen=True)
class Family:
    """One kind of Aerotech's controllers: its readings, and its driver on its simulator."""

    name: str
    hardest: StageDialect
    gentle: StageDialect
    switches: tuple[str, ...]
    make: Callable[[SimulationClock, Any, dict[str, Any]], Backend]

    def hard(self, *switches: str) -> StageDialect:
        """The gentle reading of the manual but for these switches."""
        return self.gentle.model_copy(update={switch: getattr(self.hardest, switch) for switch in switches})


def simulated(family: Family, clock: SimulationClock, dialect: StageDialect, *, by_program: bool = True) -> Backend:
    configured = {
        "move_speed_mm_s": 2.0,
        "program": "rigctl.bcx" if by_program else "",
        "oscillate_distance": dialect.oscillate_distance,
        "oscillate_answers": "at once",
    }
    return family.make(clock, dialect, configured)


SIMULATED = {"home_search_s": 0.2, "home_position_mm": 1.0}


def connected(instrument: SimulatedEnsemble, clock: SimulationClock) -> Connect:
    return lambda: InProcessTransport("sim:stage", instrument, clock)


def ensemble(clock: SimulationClock, dialect: EnsembleDialect, configured: dict[str, Any]) -> Backend:
    settings = EnsembleSimulatorSettings(dialect=dialect, **SIMULATED)
    instrument = SimulatedEnsemble(clock, MotionAxis(), TriggerLine(), settings)
    stage = AerotechEnsemble("stage", EnsembleSettings(**configured), connected(instrument, clock), clock)
    return Backend(stage, clock)


def soloist(clock: SimulationClock, dialect: SoloistDialect, configured: dict[str, Any]) -> Backend:
    settings = SoloistSimulatorSettings(dialect=dialect, **SIMULATED)
    instrument = SimulatedSoloist(clock, MotionAxis(), TriggerLine(), settings)
    said = SoloistSettings(unit="mm", **configured)
    return Backend(AerotechSoloist("stage", said, connected(instrument, clock), clock), clock)


def attached_ensemble() -> Backend:
    address = os.environ.get("RIGCTL_LINEAR_STAGE")
    if not address:
        pytest.skip("no stage attached: set RIGCTL_LINEAR_STAGE")
    clock = RealClock()
    return Backend(AerotechEnsemble("stage", EnsembleSettings(), connector(address, clock), clock), clock)


ENSEMBLE = Family("ensemble", EnsembleDialect(), GENTLE, tuple(EnsembleDialect.model_fields), ensemble)
OWN = tuple(name for name in SoloistDialect.model_fields if name not in StageDialect.model_fields)
"""The switches that a Soloist has besides those of its language, which the Ensemble is tried on."""
SOLOIST = Family("soloist", SoloistDialect(), GENTLE_SOLOIST, OWN, soloist)
NOT_OVER_ASCII = {"oscillate_over_ascii", "oscillate_waits", "oscillate_shows", "capture_over_ascii"}
"""Readings with which the ASCII commands are refused: tests/drivers/test_aerotech_ways.py."""


def each_of(family: Family, combinations: Iterable[tuple[str, ...]], *, by_program: bool) -> list[Any]:
    """A backend for each set of switches."""
    way = "program" if by_program else "ascii"
    return [
        pytest.param(
            lambda clock, chosen=chosen: simulated(family, clock, family.hard(*chosen), by_program=by_program),
            id=f"{family.name}, {way}: {' and '.join(chosen) or 'gentle'}",
        )
        for chosen in combinations
    ]


def combinations_of(switches: Sequence[str]) -> list[tuple[str, ...]]:
    """All at once, each alone, and with RIGCTL_ALL_PAIRS every two: `make dialects`."""
    pairs = itertools.combinations(switches, 2) if os.environ.get("RIGCTL_ALL_PAIRS") else ()
    return [tuple(switches), (), *((switch,) for switch in switches), *pairs]


BACKENDS: list[Any] = [
    *each_of(ENSEMBLE, combinations_of(ENSEMBLE.switches), by_program=True),
    *each_of(ENSEMBLE, combinations_of([s for s in ENSEMBLE.switches if s not in NOT_OVER_ASCII]), by_program=False),
    *each_of(SOLOIST, [tuple(SoloistDialect.model_fields), *combinations_of(OWN)], by_program=True),
    *each_of(SOLOIST, [OWN], by_program=False),
    pytest.param(lambda _: attached_ensemble(), id="attached", marks=pytest.mark.bench_attached),
]


@pytest.mark.parametrize("family", [ENSEMBLE, SOLOIST], ids=lambda family: family.name)
def test_every_switch_has_two_readings(family: Family) -> None:
    switches = type(family.hardest).model_fields
    assert [switch for switch in switches if getattr(family.hardest, switch) == getattr(family.gentle, switch)] == []


@pytest.fixture(params=BACKENDS)
def make_backend(request: pytest.FixtureRequest) -> MakeBackend:
    return request.param
