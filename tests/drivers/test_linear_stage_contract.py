"""What every `LinearStage` promises, held against each backend.

A real stage is tested with `pytest -m bench_attached` and its address in RIGCTL_LINEAR_STAGE
(`tcp://host:8000`). It is homed and moved by up to 5 mm about its home.
"""

from __future__ import annotations

import os
from typing import Any

import pytest

from drivers.aerotech_ensemble import AerotechEnsemble, EnsembleSettings
from drivers.connect import connector
from drivers.transport import InProcessTransport
from rigctl.core.clock import RealClock
from simulators.aerotech_ensemble import EnsembleSimulatorSettings, SimulatedEnsemble
from simulators.clock import SimulationClock
from simulators.motion import MotionAxis
from simulators.wiring import TriggerLine
from tests.drivers.linear_stage_contract import *  # noqa: F403 - the suite itself
from tests.drivers.linear_stage_contract import Backend, MakeBackend


def simulated_ensemble(clock: SimulationClock, simulated: dict[str, Any], **configured: Any) -> Backend:
    settings = EnsembleSimulatorSettings(home_search_s=0.2, home_position_mm=1.0, **simulated)
    ensemble = SimulatedEnsemble(clock, MotionAxis(), TriggerLine(), settings)

    def connect() -> InProcessTransport:
        return InProcessTransport("sim:stage", ensemble, clock)

    return Backend(
        AerotechEnsemble("stage", EnsembleSettings(move_speed_mm_s=2.0, **configured), connect, clock), clock
    )


def attached_ensemble() -> Backend:
    address = os.environ.get("RIGCTL_LINEAR_STAGE")
    if not address:
        pytest.skip("no stage attached: set RIGCTL_LINEAR_STAGE")
    clock = RealClock()
    return Backend(AerotechEnsemble("stage", EnsembleSettings(), connector(address, clock), clock), clock)


BACKENDS: list[Any] = [
    pytest.param(lambda clock: simulated_ensemble(clock, {}), id="ensemble"),
    pytest.param(
        lambda clock: simulated_ensemble(
            clock,
            {"always_send_eos": False, "limit_reply": "fault", "oscillate_distance": "amplitude"},
            oscillate_distance="amplitude",
        ),
        id="ensemble without EOS",
    ),
    pytest.param(
        lambda clock: simulated_ensemble(clock, {"homing_asynchronous": False, "wait_mode": "inpos"}, axis="@0"),
        id="ensemble that blocks",
    ),
    pytest.param(lambda _: attached_ensemble(), id="attached", marks=pytest.mark.bench_attached),
]


@pytest.fixture(params=BACKENDS)
def make_backend(request: pytest.FixtureRequest) -> MakeBackend:
    return request.param
