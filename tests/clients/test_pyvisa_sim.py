"""Our VISA transport and our driver of the 34465A on instruments that pyvisa-sim plays: its own, and QCoDeS' 34465A.

They speak single questions and answers, and know no error queue and no samples: what is tried is the way there.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from drivers.connect import connector
from drivers.keysight_34465a import PacingVoltmeter
from drivers.keysight_settings import VoltmeterSettings
from rigctl.core.clock import RealClock
from rigctl.core.errors import BadReply, LinkTimeout


def definition(package: str, *parts: str) -> Path:
    """A file of an installed package, which is not imported."""
    found = importlib.util.find_spec(package)
    assert found is not None
    assert found.submodule_search_locations is not None
    return Path(found.submodule_search_locations[0], *parts)


@pytest.mark.parametrize(
    ("resource", "end"),
    [
        ("ASRL1::INSTR", b"\r\n"),
        ("USB::0x1111::0x2222::0x1234::0::INSTR", b"\n"),
        ("TCPIP::localhost::inst0::INSTR", b"\n"),
        ("TCPIP::localhost::10001::SOCKET", b"\n"),
        ("GPIB::8::INSTR", b"\n"),
    ],
)
def test_the_transport_talks_to_every_kind_of_resource(resource: str, end: bytes) -> None:
    wire = connector(f"visa:{resource}?backend={definition('pyvisa_sim', 'default.yaml')}@sim", RealClock())()
    try:
        for question, answer in ((b"?IDN", b"LSG Serial #1234"), (b"!FREQ 2500.00", b"OK"), (b"?FREQ", b"2500.00")):
            wire.write(question + end)
            assert wire.read_until(b"\n", 2.0).strip() == answer
        # Nothing is left over, and silence is a time-out and no loss.
        with pytest.raises(LinkTimeout):
            wire.read_until(b"\n", 0.1)
        wire.write(b"?IDN" + end)
        assert wire.read_until(b"\n", 2.0).strip() == b"LSG Serial #1234"
    finally:
        wire.close()


def test_a_34465a_that_knows_no_error_queue_is_refused_in_one_line() -> None:
    sim = definition("qcodes", "instrument", "sims", "Keysight_34465A.yaml")
    connect = connector(f"visa:GPIB::1::INSTR?backend={sim}@sim", RealClock())
    wire = connect()
    wire.write(b"*IDN?\n")
    assert wire.read_until(b"\n", 2.0).startswith(b"Keysight, 34465A, 1000, A.02.16")
    wire.close()
    settings = VoltmeterSettings(channel="accel_v", range_v=1.0, aperture_s=1e-3)
    meter = PacingVoltmeter("accel", settings, connect, RealClock())
    with pytest.raises(BadReply, match=r"accel: SYST:ERR\? was answered 'ERROR', expected a code and a text"):
        meter.open()
    meter.close()
