"""newportxps' functions of the XPS."""

from __future__ import annotations

from typing import Any

import pytest
from newportxps.XPS_C8_drivers import XPS

from simulators.motion import MotionAxis
from simulators.newport_xps import SimulatedXps
from tests.clients.conftest import Serve

GROUP, POSITIONER = "Group1", "Group1.Pos"
READY, NOT_INITIALISED = range(10, 20), range(10)


@pytest.fixture
def xps(serve: Serve) -> tuple[Any, int]:
    address = serve(lambda clock: SimulatedXps(clock, {"Group1": {"Pos": MotionAxis()}}), "tcp")
    client = XPS()
    socket = client.TCP_ConnectToServer("127.0.0.1", address.port, 20)
    assert socket >= 0
    return client, socket


def succeeded(reply: list[Any]) -> list[Any]:
    assert reply[0] == 0, reply
    return reply[1:]


def test_it_is_known_and_its_errors_have_texts(xps: tuple[Any, int]) -> None:
    client, socket = xps
    assert "XPS" in str(succeeded(client.FirmwareVersionGet(socket))[0])
    assert "-22" in str(succeeded(client.ErrorStringGet(socket, -22))[0])


def test_the_gains_of_a_positioner_are_read_and_set(xps: tuple[Any, int]) -> None:
    client, socket = xps
    _, *gains = succeeded(client.PositionerCorrectorPIDFFVelocityGet(socket, POSITIONER))
    gains[0] *= 2.0
    succeeded(client.PositionerCorrectorPIDFFVelocitySet(socket, POSITIONER, 1, *gains))
    assert succeeded(client.PositionerCorrectorPIDFFVelocityGet(socket, POSITIONER)) == [True, *gains]


def test_a_group_is_initialised_homed_and_moved(xps: tuple[Any, int]) -> None:
    client, socket = xps
    assert int(succeeded(client.GroupStatusGet(socket, GROUP))[0]) in NOT_INITIALISED
    assert client.GroupMoveAbsolute(socket, POSITIONER, [5.0])[0] == -22
    succeeded(client.GroupInitialize(socket, GROUP))
    succeeded(client.GroupHomeSearch(socket, GROUP))
    assert int(succeeded(client.GroupStatusGet(socket, GROUP))[0]) in READY
    succeeded(client.GroupMoveAbsolute(socket, POSITIONER, [5.0]))
    assert float(succeeded(client.GroupPositionCurrentGet(socket, GROUP, 1))[0]) == pytest.approx(5.0, abs=1e-3)
    assert client.GroupMoveAbsolute(socket, "Nowhere", [5.0])[0] == -19
