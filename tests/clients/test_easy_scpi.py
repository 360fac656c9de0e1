"""easy-scpi, whose attributes become SCPI commands, on a 34465A and a 33500B."""

from __future__ import annotations

from typing import Any

import easy_scpi
import numpy as np
import pytest

from simulators.keysight_33500b import Simulated33500B
from simulators.keysight_34465a import Simulated34465A
from simulators.wiring import VoltageLine
from tests.clients.conftest import Serve

VOLTS = 0.25


def connected(serve: Serve, build: Any) -> Any:
    address = serve(build, "tcp")
    instrument = easy_scpi.Instrument(
        f"TCPIP0::127.0.0.1::{address.port}::SOCKET",
        port_match=False,
        backend="@py",
        read_termination="\n",
        write_termination="\n",
    )
    instrument.connect()
    return instrument


def test_the_meter_is_set_and_reads_by_attributes(serve: Serve) -> None:
    meter = connected(
        serve,
        lambda clock: Simulated34465A(
            clock, lambda times_s: np.full_like(times_s, VOLTS), lambda times_s: np.full_like(times_s, 20.0)
        ),
    )
    assert "34465A" in meter.id
    meter.reset()
    meter.conf.volt.dc("10")
    meter.sens.volt.dc.nplc("1")
    assert float(meter.sens.volt.dc.nplc()) == 1.0
    assert float(meter.query("READ?")) == pytest.approx(VOLTS, abs=1e-4)
    assert meter.syst.err().startswith("+0")
    meter.disconnect()


def test_the_generator_is_set_by_attributes(serve: Serve) -> None:
    generator = connected(serve, lambda clock: Simulated33500B(clock, {1: VoltageLine(), 2: VoltageLine()}))
    generator.sour1.func("SIN")
    generator.sour1.freq("0.1")
    generator.outp1("ON")
    assert float(generator.sour1.freq()) == 0.1
    assert generator.outp1() == "1"
    assert generator.syst.err().startswith("+0")
    generator.disconnect()
