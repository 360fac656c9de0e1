"""How the ESP301 driver finds a controller whose baud rate nobody told it: over pseudo-terminals."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.connect import connector, serial_ways
from drivers.newport_esp301 import Esp301Settings, NewportEsp301
from drivers.newport_esp301_line import LINES
from rigctl.core.clock import RealClock
from rigctl.core.errors import LinkError, LinkTimeout
from simulators.clock import ScaledClock
from simulators.motion import MotionAxis
from simulators.newport_esp301 import SimulatedEsp301
from simulators.newport_esp301.settings import Esp301Dialect, Esp301SimulatorSettings
from simulators.serve import Server

SPEED = 50.0
"""Rig seconds per second: a time-out of 2 s is over soon, and the floor of a real one is lowered."""


@contextmanager
def served(dialect: Esp301Dialect) -> Iterator[str]:
    """The device of a controller that is set up so."""
    clock = ScaledClock(SPEED)
    server = Server(clock)
    settings = Esp301SimulatorSettings(dialect=dialect, home_search_s=0.5)
    device = server.add_serial("stage", SimulatedEsp301(clock, [MotionAxis()], settings), 115200).device
    serving = threading.Thread(target=server.serve)
    serving.start()
    try:
        assert device is not None
        yield device
    finally:
        server.stop()
        serving.join(20.0)
        server.close()


def stage_at(address: str) -> NewportEsp301:
    clock = RealClock(SPEED)
    return NewportEsp301("rotation", Esp301Settings(), connector(address, clock, floor_s=0.3), clock)


@pytest.mark.parametrize("baud", [921600, 19200])
@pytest.mark.parametrize("keypad", [False, True])
def test_it_is_found_at_either_rate_and_the_one_found_is_named(baud: int, keypad: bool) -> None:
    with served(Esp301Dialect(baud=baud, keypad_lock=keypad)) as device:
        stage = stage_at(f"serial:{device}")
        stage.open()
        try:
            assert stage.identify().text == f"ESP301 Version 3.0.1 6/1/99, at {baud} baud"
            stage.home()
            stage.move_to(3.0)
            assert stage.angle().value == pytest.approx(3.0)
        finally:
            stage.close()


def test_what_the_address_says_is_not_guessed() -> None:
    with served(Esp301Dialect(baud=19200)) as device:
        stage = stage_at(f"serial:{device}?baud=19200&rtscts=1")
        stage.open()
        assert stage.identify().text == "ESP301 Version 3.0.1 6/1/99"
        stage.close()
        wrong = stage_at(f"serial:{device}?baud=9600")
        with pytest.raises(LinkError) as raised:
            wrong.open()
        assert "tried" not in str(raised.value)


def test_silence_at_both_rates_names_both() -> None:
    class Deaf(SimulatedEsp301):
        """A line nobody listens on at the rates tried."""

        @property
        def baud(self) -> int:
            return 57600

    clock = ScaledClock(SPEED)
    server = Server(clock)
    device = server.add_serial("stage", Deaf(clock, [MotionAxis()]), 115200).device
    serving = threading.Thread(target=server.serve)
    serving.start()
    try:
        with pytest.raises(LinkTimeout, match="tried 921600 baud and 19200 baud with RTS/CTS"):
            stage_at(f"serial:{device}").open()
    finally:
        server.stop()
        serving.join(20.0)
        server.close()


def test_each_way_keeps_what_the_address_says() -> None:
    clock = RealClock()
    assert [words for words, _ in serial_ways(connector("serial:/dev/null", clock), LINES)] == [
        "921600 baud",
        "19200 baud",
    ]
    (one,) = serial_ways(connector("serial:/dev/null?baud=38400", clock), LINES)
    assert one[0] == "38400 baud"
    (net,) = serial_ways(connector("tcp://localhost:5001", clock), LINES)
    assert net[0] == ""
