"""PyMeasure's ESP300 on an ESP301, and its Agilent33500 on a 33522B."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from pymeasure.instruments.agilent import Agilent33500
from pymeasure.instruments.newport import ESP300

from simulators.keysight_33500b import Simulated33500B
from simulators.motion import MotionAxis
from simulators.newport_esp301 import SimulatedEsp301
from tests.clients.conftest import Serve


@pytest.fixture
def controller(serve: Serve) -> Iterator[Any]:
    address = serve(lambda clock: SimulatedEsp301(clock, [MotionAxis(), MotionAxis(), MotionAxis()]), "serial")
    controller = ESP300(f"ASRL{address.device}::INSTR", visa_library="@py", baud_rate=19200)
    yield controller
    controller.adapter.close()


# It does not know whether the controller speaks SCPI, and says so to whoever looks on.
pytestmark = pytest.mark.filterwarnings("ignore:It is not known whether:FutureWarning")


def test_an_axis_is_enabled_homed_and_moved(controller: Any) -> None:
    controller.clear_errors()
    axis = controller.x
    assert not axis.enabled
    axis.enable()
    assert axis.enabled
    axis.home()
    axis.wait_for_stop(interval=0.01)
    axis.position = 2.5
    axis.wait_for_stop(interval=0.01)
    assert axis.position == pytest.approx(2.5, abs=1e-3)
    assert axis.units == "degree"
    assert axis.left_limit == pytest.approx(-170.0)
    assert controller.errors == []


def test_its_errors_are_those_of_the_list(controller: Any) -> None:
    controller.clear_errors()
    controller.x.position = 500.0
    errors = controller.errors
    assert errors
    controller.clear_errors()
    assert controller.errors == []


@pytest.fixture
def generator(serve: Serve) -> Iterator[Any]:
    address = serve(Simulated33500B, "tcp")
    line = {"read_termination": "\n", "write_termination": "\n"}
    generator = Agilent33500(f"TCPIP::127.0.0.1::{address.port}::SOCKET", visa_library="@py", **line)
    yield generator
    generator.adapter.close()


def test_the_generator_is_set_and_says_what_it_is_set_to(generator: Any) -> None:
    channel = generator.ch_2
    for setting, value in (("shape", "SIN"), ("frequency", 0.1), ("voltage_high", 1.5), ("voltage_low", -0.5)):
        setattr(channel, setting, value)
        assert getattr(channel, setting) == pytest.approx(value)
    assert (channel.amplitude, channel.offset) == (2.0, 0.5)
    generator.display = "in use"
    generator.beep()
    channel.output = True
    assert channel.output is True
    assert generator.next_error[0] == 0


def test_what_the_generator_does_not_do_is_answered(generator: Any) -> None:
    asked = ("square_dutycycle", "pulse_hold", "pulse_period", "pulse_dutycycle", "burst_state", "ext_trig_out")
    assert [getattr(generator, name) for name in asked] == [50.0, "WIDT", 1e-3, 10.0, False, False]
    assert generator.next_error[0] == 0
