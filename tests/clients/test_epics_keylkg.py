"""The protocol of ISIS' EPICS support for the LK-G (github.com/ISISComputingGroup/EPICS-Keylkg) on an LK-G3001.

It is what StreamDevice sends to controllers at their beamlines, and what it takes for an answer; read here by
`stream_protocol`. RIGCTL_KEYLKG names a checkout.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import serial

from simulators.keyence_lkg import Lkg3001Settings, SimulatedLkg3001
from simulators.wiring import TriggerLine
from tests.clients.conftest import BAUD, SPEED, Serve
from tests.clients.stream_protocol import Protocols

CHECKOUT = os.environ.get("RIGCTL_KEYLKG")
pytestmark = pytest.mark.skipif(CHECKOUT is None, reason="RIGCTL_KEYLKG names no checkout of EPICS-Keylkg")

STATUS_ERROR = 1
"""In its list of errors."""


@pytest.fixture
def record(serve: Serve) -> Iterator[Protocols]:
    """Output 1 stands at 1.25 mm, output 2 has no target; measuring begins half a second after R0."""
    heads = [lambda t: np.full_like(t, 1.25), lambda t: np.full_like(t, np.nan)]
    settings = Lkg3001Settings(mode_return_s=0.3, mode_settle_s=0.2)
    address = serve(lambda clock: SimulatedLkg3001(clock, heads, TriggerLine(), settings), "serial")
    assert CHECKOUT is not None
    text = (Path(CHECKOUT) / "keylkgSup/keylkg.proto").read_text()
    with serial.Serial(address.device, BAUD, timeout=5.0) as line:

        def answer() -> bytes:
            read = line.read_until(b"\r")
            assert read.endswith(b"\r"), read
            return read[:-1]

        waiting = threading.Event()
        yield Protocols(text, line.write, answer, lambda ms: waiting.wait(1e-3 * ms / SPEED))


def test_values_and_what_is_no_value(record: Protocols) -> None:
    read = record.run("getValueOutput1")
    assert (read.matched, read.values) == (True, [1.25])
    assert not record.run("getValueOutput2").matched


def test_settings_are_written_and_read_back(record: Protocols) -> None:
    for head, mode in (("A", 3), ("B", 4)):
        assert record.run(f"setMeasureModeHead{head}", mode).matched
        read = record.run(f"getMeasureModeHead{head}")
        assert (read.matched, read.values) == (True, [mode])
    for output, offset in ((1, -12345), (2, 500)):
        assert record.run(f"setOffsetOutput{output}", offset).matched
        read = record.run(f"getOffsetOutput{output}")
        assert (read.matched, read.values) == (True, [offset / 10_000])
    # An offset is part of what is measured.
    assert record.run("getValueOutput1").values == [pytest.approx(1.25 - 1.2345, abs=1e-9)]
    assert record.run("resetOutput1").matched
    assert record.run("resetOutput2").matched


def test_its_modes_and_what_is_refused_in_them(record: Protocols) -> None:
    assert record.run("setMode", 1, "PREFIX:", "ERROR").matched
    refused = record.run("getValueOutput1", None, "PREFIX:", "ERROR")
    assert (refused.matched, refused.elsewhere) == (False, {"PREFIX:ERROR": STATUS_ERROR})
    assert record.run("setMode", 0, "PREFIX:", "ERROR").matched
    assert record.run("getValueOutput1", None, "PREFIX:", "ERROR").values == [1.25]
