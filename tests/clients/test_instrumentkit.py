"""InstrumentKit's NewportESP301 and Agilent34410a on an ESP301 and a 34465A."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import quantities
from instruments.agilent import Agilent34410a
from instruments.newport import NewportESP301
from instruments.newport.errors import NewportError

from simulators.keysight_34465a import Simulated34465A
from simulators.motion import MotionAxis
from simulators.newport_esp301 import SimulatedEsp301
from tests.clients.conftest import BAUD, Serve

VOLTS = 0.25


@pytest.fixture
def controller(serve: Serve) -> Iterator[Any]:
    address = serve(lambda clock: SimulatedEsp301(clock, [MotionAxis(), MotionAxis(), MotionAxis()]), "serial")
    controller = NewportESP301.open_serial(address.device, BAUD, timeout=5)
    yield controller
    # Its own `close` shuts a serial line down as a socket.
    controller._file._conn.close()


def await_rest(axis: Any) -> None:
    """Its own `is_motion_done` takes the text of any answer for true: asked as it asks."""
    while axis._controller._newport_cmd("MD?", target=axis.axis_id, errcheck=False).strip() != "1":
        time.sleep(0.005)


def test_an_axis_is_read_homed_and_moved(controller: Any) -> None:
    axis = controller.axis[0]
    axis.enable()
    axis.search_for_home()
    await_rest(axis)
    axis.move(2.5 * quantities.deg)
    await_rest(axis)
    assert float(axis.position.rescale("deg")) == pytest.approx(2.5, abs=1e-3)
    assert float(axis.left_limit.rescale("deg")) == pytest.approx(-170.0)


def test_a_refusal_is_its_exception(controller: Any) -> None:
    with pytest.raises(NewportError, match="MOTOR NOT ENABLED"):
        controller.axis[0].move(5.0 * quantities.deg)


def test_the_meter_reads(serve: Serve) -> None:
    address = serve(
        lambda clock: Simulated34465A(
            clock, lambda times_s: np.full_like(times_s, VOLTS), lambda times_s: np.full_like(times_s, 20.0)
        ),
        "tcp",
    )
    meter = Agilent34410a.open_tcpip("127.0.0.1", address.port)
    assert "34465A" in meter.name
    volts = meter.measure(meter.Mode.voltage_dc)
    assert float(volts.rescale("V")) == pytest.approx(VOLTS, abs=1e-4)
    meter.sample_count = 3
    assert meter.sample_count == 3
    meter.init()
    # Its own `fetch` asks for the mode first, and does not know the quotes around a 34465A's answer.
    assert [float(each) for each in meter.query("FETC?").split(",")] == pytest.approx(3 * [VOLTS], abs=1e-4)
