"""A rig served by `rigctl simulate`, and a rig file for programs that reach it over recorded wires."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.campaign.session.served import announced
from rigctl.files.rig_file import read_rig
from tests.reliability.commands import Process, until
from tests.reliability.wires import RecordedWires

START_S = 60.0


@dataclass(frozen=True)
class Served:
    """`rig` is the file for programs; `wires` know what they send.

    `motion` is name, kind and port of each motion controller that has one, not recorded.
    """

    rig: Path
    wires: RecordedWires
    motion: tuple[tuple[str, str, int], ...]


@contextmanager
def served(work: Path, rig_text: str, *options: str) -> Iterator[Served]:
    """Serve `rig_text`, with further options of `rigctl simulate`; programs take `Served.rig`."""
    (work / "served.toml").write_text(rig_text, encoding="utf-8")
    server = Process(work, "simulate", "served.toml", "--json", "--write-rig", "clients.toml", *options)
    try:
        if not until(lambda: server.out.exists() and "\n" in server.out.read_text(), START_S):
            raise RuntimeError(f"rigctl simulate: {server.ended(0.0).err}")
        with RecordedWires() as wires:
            instruments = json.loads(server.out.read_text())["instruments"]
            rig = _rewired(work, instruments, wires)
            # What stands before a simulator is one too, and needs no check of `rigctl check`.
            with announced(table.address for table in read_rig(rig).instruments.values()):
                yield Served(rig, wires, _motion(instruments))
    finally:
        server.signal(signal.SIGTERM)
        server.ended(START_S)


def _motion(instruments: list[dict[str, Any]]) -> tuple[tuple[str, str, int], ...]:
    return tuple(
        (entry["name"], entry["kind"], entry["port"])
        for entry in instruments
        if entry["kind"] in {"newport-xps", "aerotech-ensemble"}
    )


def _rewired(work: Path, instruments: list[dict[str, Any]], wires: RecordedWires) -> Path:
    """The clients' rig file with the addresses of recorded wires."""
    text = (work / "clients.toml").read_text(encoding="utf-8")
    for instrument in instruments:
        if instrument["kind"] == "operator":
            continue
        if instrument["transport"] == "serial":
            device = str(instrument["device"])
            text = re.sub(
                rf"{device}\b", wires.serial(str(instrument["name"]), device, int(instrument["baud"])), text
            )
        else:
            port = int(instrument["port"])
            text = re.sub(rf"\b{port}\b", str(wires.tcp(str(instrument["name"]), port)), text)
    path = work / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path
