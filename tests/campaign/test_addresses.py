"""Which instrument an address means: spellings of one instrument conflict, different instruments do not."""

from __future__ import annotations

import os
import socket
import threading
from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.session import addresses
from rigctl.campaign.session.addresses import Claim, claims_of, conflict

METER = "192.0.2.20"
NAMES = {
    "localhost": ["127.0.0.1", "::1"],
    "meter": [METER, "2001:db8::20"],
    "meter.lab.example": [METER],
    "six": ["2001:db8::20"],
    "other": ["192.0.2.21"],
    "bench-pc": ["198.51.100.7"],
}
OURS = "198.51.100.7"


@pytest.fixture(autouse=True)
def network(monkeypatch: pytest.MonkeyPatch) -> None:
    """A name server that knows `NAMES` only, and a machine with the address `OURS`."""
    real, is_this_machine = socket.getaddrinfo, addresses._is_this_machine

    def getaddrinfo(host: str, *rest: Any, **options: Any) -> Any:
        found = [real(ip, *rest, flags=socket.AI_NUMERICHOST, **options) for ip in NAMES.get(host, [host])]
        return [entry for entries in found for entry in entries]

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)
    monkeypatch.setattr(addresses, "_is_this_machine", lambda ip: str(ip) == OURS or is_this_machine(ip))


ONE_INSTRUMENT = [
    [
        "tcp://127.0.0.1:5001",
        "tcp://localhost:5001",
        "TCP://LOCALHOST:05001/",
        "tcp://127.1:5001",
        "tcp://0.0.0.0:5001",
        "tcp://[::1]:5001",
        "tcp://[::ffff:127.0.0.1]:5001",
        "tcp://localhost.:5001",
        f"tcp://{OURS}:5001",
        "tcp://bench-pc:5001",
        "TCPIP::127.0.0.1::5001::SOCKET",
        "tcpip3::localhost::05001::socket",
        "visa:TCPIP::localhost::5001::SOCKET?backend=@ivi",
        "TCPIP::localhost::hislip0,5001::INSTR",
        " tcp://127.0.0.1:5001 ",
    ],
    [
        "TCPIP::meter::INSTR",
        "TCPIP::METER",
        f"TCPIP0::{METER}::inst0::INSTR",
        "TCPIP::six::hislip0::INSTR",
        "TCPIP::meter.lab.example::hislip0,4880::INSTR",
        "VICP::meter::INSTR",
    ],
    [f"tcp://{METER}:5025", "TCPIP::meter::5025::SOCKET", "tcp://meter:5024"],
    ["TCPIP::localhost::hislip0,4880::INSTR", "tcp://localhost:4880"],
    ["tcp://unheard-of:1", "tcp://Unheard-Of.:01/"],
    ["TCPIP::other::gpib0,12::INSTR", "TCPIP::192.0.2.21::GPIB0,12::INSTR"],
    ["GPIB::12::INSTR", "gpib0::012", "visa:GPIB0::12::65535::INSTR?backend=@ivi"],
    ["GPIB0::13::2::INSTR", "GPIB0::13::02::INSTR"],
    ["USB::0x2A8D::0x0101::MY123::INSTR", "usb0::10893::257::my123::0::INSTR"],
    ["ASRL3::INSTR", "asrl3::instr"],
    ["what is this", "What is this"],
]
CROSSWISE = [
    ("TCPIP::meter::INSTR", "tcp://meter:5025"),
    ("TCPIP::meter::INSTR", f"tcp://{METER}:1234"),
    ("TCPIP::localhost::INSTR", "tcp://127.0.0.1:5025"),
    ("GPIB0::13::INSTR", "GPIB0::13::2::INSTR"),
]
APART = [
    ("tcp://localhost:5001", "tcp://localhost:5002"),
    ("tcp://localhost:5024", "tcp://localhost:5025"),
    ("tcp://meter:5001", "tcp://other:5001"),
    ("tcp://other:5001", "tcp://other:5025"),
    ("TCPIP::localhost::hislip0,5001::INSTR", "tcp://localhost:5002"),
    ("TCPIP::other::gpib0,12::INSTR", "TCPIP::other::gpib0,13::INSTR"),
    ("TCPIP::other::inst0::INSTR", "TCPIP::other::inst1::INSTR"),
    ("GPIB0::12::INSTR", "GPIB0::13::INSTR"),
    ("GPIB0::13::1::INSTR", "GPIB0::13::2::INSTR"),
    ("GPIB0::12::INSTR", "GPIB1::12::INSTR"),
    ("USB::1::2::A::INSTR", "USB::1::2::B::INSTR"),
    ("tcp://unheard-of:1", "tcp://unknown:1"),
]


@pytest.mark.parametrize(("one", "other"), [(s[0], other) for s in ONE_INSTRUMENT for other in s] + CROSSWISE)
def test_spellings_of_one_instrument_conflict(one: str, other: str) -> None:
    assert conflict(claims_of(one), claims_of(other))
    assert conflict(claims_of(other), claims_of(one))


@pytest.mark.parametrize(("one", "other"), APART)
def test_different_instruments_do_not(one: str, other: str) -> None:
    assert not conflict(claims_of(one), claims_of(other))
    assert not conflict(claims_of(other), claims_of(one))


def test_a_serial_line_is_the_device_whatever_leads_to_it(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    device = os.ttyname(theirs)
    try:
        (tmp_path / "by-id").symlink_to(device)
        (tmp_path / "again").symlink_to("by-id")
        claims = claims_of(f"serial:{device}?baud=9600")
        for spelling in (f"SERIAL:{tmp_path}/again", f"ASRL{tmp_path}/by-id::INSTR", f"serial:/dev/../{device}"):
            assert conflict(claims, claims_of(spelling)), spelling
        assert not conflict(claims, claims_of("serial:/dev/null"))
    finally:
        os.close(ours)
        os.close(theirs)
    gone = claims_of("serial:/dev/ttyUSB77")
    assert gone == claims_of("ASRL/dev/ttyUSB77::INSTR") == {Claim("device /dev/ttyUSB77")}


def test_a_name_server_that_is_silent_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    answered = threading.Event()
    monkeypatch.setattr(addresses, "RESOLVE_S", 0.01)
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: answered.wait(60) and [])
    assert {claim.name for claim in claims_of("tcp://Meter:5001")} == {"meter sockets", "meter port 5001"}
    answered.set()


def test_a_pseudo_terminal_that_takes_a_number_given_back_is_another() -> None:
    ours, theirs = os.openpty()
    path = os.ttyname(theirs)
    made_ns, before = Path(path).stat().st_ctime_ns, claims_of(f"serial:{path}")
    assert conflict(before, claims_of(f"serial:{path}?baud=9600"))
    while Path(path).exists() and Path(path).stat().st_ctime_ns == made_ns:  # the kernel's clock has ticks
        os.close(ours)
        os.close(theirs)
        ours, theirs = os.openpty()
    assert not conflict(before, claims_of(f"serial:{path}"))
    os.close(ours)
    os.close(theirs)
