"""QCoDeS' drivers of the meter and the generator."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from qcodes.instrument_drivers.Keysight import Keysight33522B, Keysight34465A

from simulators.keysight_33500b import Simulated33500B
from simulators.keysight_34465a import Simulated34465A
from simulators.wiring import VoltageLine
from tests.clients.conftest import Serve

VOLTS = 0.25


@pytest.fixture
def meter(serve: Serve) -> Iterator[Any]:
    address = serve(
        lambda clock: Simulated34465A(
            clock, lambda times_s: np.full_like(times_s, VOLTS), lambda times_s: np.full_like(times_s, 20.0)
        ),
        "tcp",
    )
    meter = Keysight34465A(
        "dmm", f"TCPIP::127.0.0.1::{address.port}::SOCKET", visalib="@py", terminator="\n", silent=True
    )
    yield meter
    meter.close()


@pytest.fixture
def generator(serve: Serve) -> Iterator[Any]:
    address = serve(lambda clock: Simulated33500B(clock, {1: VoltageLine(), 2: VoltageLine()}), "tcp")
    generator = Keysight33522B("gen", f"TCPIP::127.0.0.1::{address.port}::SOCKET", visalib="@py", terminator="\n")
    yield generator
    generator.close()


def unanswered(parameters: dict[str, Any]) -> list[str]:
    return [name for name, parameter in parameters.items() if parameter.get("value", 0) is None]


def test_the_meter_is_known_and_reads(meter: Any) -> None:
    assert meter.get_idn()["model"] == "34465A"
    assert meter.volt() == pytest.approx(VOLTS, abs=1e-4)
    assert meter.error() == (0, "No error")


def test_the_meter_takes_all_that_is_set_and_samples_on_its_timer(meter: Any) -> None:
    for setting, value in (("autorange", "OFF"), ("range", 10.0), ("autozero", "OFF"), ("NPLC", 1)):
        getattr(meter, setting)(value)
        assert meter.parameters[setting]() == value
        assert meter.error() == (0, "No error"), setting
    meter.sample.count(5)
    meter.sample.source("TIM")
    meter.sample.timer(0.1)
    np.testing.assert_allclose(meter.read(), VOLTS, atol=1e-4)
    assert meter.error() == (0, "No error")


def test_a_snapshot_of_the_generator_is_answered_in_full(generator: Any) -> None:
    snapshot = generator.snapshot(update=True)
    assert {name: unanswered(each["parameters"]) for name, each in snapshot["submodules"].items()} == {
        name: [] for name in snapshot["submodules"]
    }
    assert unanswered(snapshot["parameters"]) == []
    assert generator.error() == (0, "No error")


def test_the_generator_is_set_and_says_what_it_is_set_to(generator: Any) -> None:
    channel = generator.ch2
    for setting, value in (("function_type", "SIN"), ("frequency", 0.1), ("amplitude", 1.0), ("offset", 0.2)):
        getattr(channel, setting)(value)
        assert channel.parameters[setting]() == value
    channel.output("ON")
    assert (channel.output(), generator.error()) == ("ON", (0, "No error"))
