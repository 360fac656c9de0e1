"""Who moves a rig is stopped by a signal at any time, while it is still connecting too."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path
from typing import Any

import pytest

from drivers.transport import InProcessTransport
from rigctl.charge import in_charge
from rigctl.core.errors import Aborted
from rigctl.files.rig_file import read_rig
from rigctl.rig import Rig

PATIENCE_S = 20.0
SLOW = "lasers_a"


class Wires:
    """Those of this process; the lasers' takes until `made` is set. `stages` is set when both stages were stopped."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.making, self.made, self.stages = threading.Event(), threading.Event(), threading.Event()
        self.sent: list[tuple[str, bytes]] = []
        write = InProcessTransport.write
        wires = self

        def noted(self: InProcessTransport, data: bytes) -> None:
            write(self, data)
            wires.note(self.address.split()[0], data)

        monkeypatch.setattr(InProcessTransport, "write", noted)
        monkeypatch.setattr("rigctl.rig.InProcessTransport", self.connected)

    def connected(self, address: str, *arguments: Any) -> InProcessTransport:
        if address.startswith(SLOW):
            self.making.set()
            assert self.made.wait(PATIENCE_S)
        return InProcessTransport(address, *arguments)

    def note(self, name: str, data: bytes) -> None:
        self.sent.append((name, data))
        if {"rotation", "stage"} <= {who for who, what in self.sent if b"Abort" in what or b"ABORT" in what}:
            self.stages.set()


def test_a_signal_while_an_instrument_connects_stops_the_others_at_once_and_connects_to_no_further(
    campaigns: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wires = Wires(monkeypatch)
    rig = Rig(read_rig(campaigns / "isa-rig.toml"))
    opened: list[str] = []
    for name, instrument in rig.instruments.items():
        monkeypatch.setattr(instrument, "open", noting(opened, name, instrument.open))
    at_once: list[bool] = []

    def interrupt() -> None:
        assert wires.making.wait(PATIENCE_S)
        os.kill(os.getpid(), signal.SIGTERM)
        at_once.append(wires.stages.wait(PATIENCE_S))
        wires.made.set()

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(Aborted, match="interrupted by SIGTERM") as ended, in_charge(rig):
        pytest.fail("it went on")
    thread.join()
    assert at_once == [True]
    assert opened == ["rotation", "stage", SLOW]
    assert (SLOW, b"AP\r") in wires.sent
    assert getattr(ended.value, "__notes__", []) == []


def noting(called: list[str], name: str, act: Any) -> Any:
    def noted() -> None:
        called.append(name)
        act()

    return noted
