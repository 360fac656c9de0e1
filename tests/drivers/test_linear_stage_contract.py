"""What every `LinearStage` promises, held against each backend.

A real stage is tested with `pytest -m bench_attached` and its address in RIGCTL_LINEAR_STAGE
(`tcp://host:8000`). It is homed and moved by up to 5 mm about its home.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Sequence
from typing import Any

import pytest

from drivers.aerotech_ensemble import AerotechEnsemble, EnsembleSettings
from drivers.connect import connector
from drivers.transport import InProcessTransport
from rigctl.core.clock import RealClock
from simulators.aerotech_ensemble import GENTLE, EnsembleDialect, EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.clock import SimulationClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine
from tests.drivers.linear_stage_contract import *  # noqa: F403 - the suite itself
from tests.drivers.linear_stage_contract import Backend, MakeBackend


def simulated_ensemble(clock: SimulationClock, dialect: EnsembleDialect, *, by_program: bool = True) -> Backend:
    settings = EnsembleSimulatorSettings(home_search_s=0.2, home_position_mm=1.0, dialect=dialect)
    ensemble = SimulatedEnsemble(clock, MotionAxis(), TriggerLine(), settings)

    def connect() -> InProcessTransport:
        return InProcessTransport("sim:stage", ensemble, clock)

    configured = EnsembleSettings(
        move_speed_mm_s=2.0,
        program="rigctl.bcx" if by_program else "",
        oscillate_distance=dialect.oscillate_distance,
        oscillate_answers="at once",
    )
    return Backend(AerotechEnsemble("stage", configured, connect, clock), clock)


def attached_ensemble() -> Backend:
    address = os.environ.get("RIGCTL_LINEAR_STAGE")
    if not address:
        pytest.skip("no stage attached: set RIGCTL_LINEAR_STAGE")
    clock = RealClock()
    return Backend(AerotechEnsemble("stage", EnsembleSettings(), connector(address, clock), clock), clock)


HARDEST = EnsembleDialect()
SWITCHES = tuple(EnsembleDialect.model_fields)
NOT_OVER_ASCII = {"oscillate_over_ascii", "oscillate_waits", "oscillate_shows", "capture_over_ascii"}
"""Readings with which the ASCII commands are refused: tests/drivers/test_aerotech_ways.py."""


def hard(*switches: str) -> EnsembleDialect:
    """The gentle reading of the manual but for these switches."""
    return GENTLE.model_copy(update={switch: getattr(HARDEST, switch) for switch in switches})


def each_of(combinations: Iterable[tuple[str, ...]], *, by_program: bool) -> list[Any]:
    """A backend for each set of switches."""
    way = "program" if by_program else "ascii"
    return [
        pytest.param(
            lambda clock, chosen=chosen: simulated_ensemble(clock, hard(*chosen), by_program=by_program),
            id=f"{way}: {' and '.join(chosen) or 'gentle'}",
        )
        for chosen in combinations
    ]


def combinations_of(switches: Sequence[str]) -> list[tuple[str, ...]]:
    """All at once, each alone, and with RIGCTL_ALL_PAIRS every two: `make dialects`."""
    pairs = itertools.combinations(switches, 2) if os.environ.get("RIGCTL_ALL_PAIRS") else ()
    return [tuple(switches), (), *((switch,) for switch in switches), *pairs]


BACKENDS: list[Any] = [
    *each_of(combinations_of(SWITCHES), by_program=True),
    *each_of(combinations_of([switch for switch in SWITCHES if switch not in NOT_OVER_ASCII]), by_program=False),
    pytest.param(lambda _: attached_ensemble(), id="attached", marks=pytest.mark.bench_attached),
]


def test_every_switch_has_two_readings() -> None:
    assert [switch for switch in SWITCHES if getattr(HARDEST, switch) == getattr(GENTLE, switch)] == []


@pytest.fixture(params=BACKENDS)
def make_backend(request: pytest.FixtureRequest) -> MakeBackend:
    return request.param
