"""Two programs on one instrument, the second by another spelling of its address: it is refused, and sends nothing."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from tests.reliability.commands import Process, until
from tests.reliability.served import Served, served
from tests.reliability.signals import CAMPAIGN, quick_rig
from tests.reliability.stops import orders

PROMISE = "A second program on an instrument is refused however its address is spelled, and sends it nothing"

MOVES_S = 40.0
ENDS_S = 30.0


@dataclass(frozen=True)
class Spelling:
    """Another way to write an address, or to be another user of the machine."""

    name: str
    instrument: str
    spell: Callable[[str, Path], str]
    another_tmpdir: bool = False


def _tcp(text: str) -> Callable[[str, Path], str]:
    """`text` with the port in place of {port}."""

    def spell(address: str, _: Path) -> str:
        return text.format(port=address.rsplit(":", 1)[1])

    return spell


def _device(address: str) -> str:
    return address.removeprefix("serial:").split("?")[0]


def _linked(address: str, work: Path) -> str:
    link = work / "ttyLasers"
    link.symlink_to(_device(address))
    return address.replace(_device(address), str(link))


def _roundabout(address: str, _: Path) -> str:
    return address.replace("/dev/", "/dev/../dev/")


def _same(address: str, _: Path) -> str:
    return address


SPELLINGS = (
    Spelling("localhost", "rotation", _tcp("tcp://localhost:{port}")),
    Spelling("VISA socket", "rotation", _tcp("TCPIP::127.0.0.1::{port}::SOCKET")),
    Spelling("VISA socket of a name", "stage", _tcp("TCPIP0::localhost::{port}::SOCKET")),
    Spelling("leading zero", "rotation", _tcp("tcp://127.0.0.1:0{port}")),
    Spelling("capitals", "stage", _tcp("TCP://127.0.0.1:{port}")),
    Spelling("slash at the end", "rotation", _tcp("tcp://127.0.0.1:{port}/")),
    Spelling("another TMPDIR", "stage", _same, another_tmpdir=True),
    Spelling("a link to the device", "lasers_a", _linked),
    Spelling("a roundabout path", "lasers_a", _roundabout),
)
FIRSTS = ("run", "move")
CASES = tuple(product(SPELLINGS, FIRSTS))


def trial(seed: int, work: Path) -> dict[str, Any]:
    """One pair of programs."""
    spelling, first = CASES[seed % len(CASES)]
    with served(work, quick_rig("isa-rig.toml")) as reached:
        (work / "campaign.toml").write_text(CAMPAIGN.format(axis="X"), encoding="utf-8")
        holder = _held(work, first)
        try:
            if not until(lambda: _at_work(reached), MOVES_S):
                return {"failed": f"{first} did not begin: {holder.ended(0.0).message}"}
            told = {"spelling": spelling.name, "first": first}
            return {**told, **_second(work, reached, spelling)}
        finally:
            holder.ended(0.0)


def _held(work: Path, first: str) -> Process:
    """A program that holds the rig for longer than the trial."""
    if first == "move":
        return Process(work, "move", "rig.toml", "rotation", "-160")
    return Process(work, "run", "campaign.toml", "--store", "x.rig.sqlite", "--yes")


def _at_work(reached: Served) -> bool:
    return any(order.what == "motion" for order in orders(reached.wires.sent))


def _second(work: Path, reached: Served, spelling: Spelling) -> dict[str, Any]:
    """`check`-like use of one instrument by its other name."""
    table = tomllib.loads(reached.rig.read_text(encoding="utf-8"))["instruments"][spelling.instrument]
    address = spelling.spell(table["address"], work)
    text = _only(reached.rig.read_text(encoding="utf-8"), spelling.instrument).replace(table["address"], address)
    (work / "second.toml").write_text(text, encoding="utf-8")
    (work / "tmp").mkdir()
    environment = {"TMPDIR": str(work / "tmp")} if spelling.another_tmpdir else {}
    connections = reached.wires.connections[spelling.instrument]
    second = Process(work, "home", "second.toml", **environment)
    outcome = second.ended(ENDS_S)
    failed = outcome.broken()
    if not failed and outcome.status == 0:
        failed = f"{address} was let in beside {table['address']}"
    if not failed and reached.wires.connections[spelling.instrument] > connections:
        failed = f"{address} was connected to before it was refused"
    return {"status": outcome.status, "message": outcome.message, "failed": failed}


def _only(text: str, instrument: str) -> str:
    """The rig file with this instrument alone: no other's lock is to stand for its own."""
    tables = re.split(r"(?m)^(?=\[)", text)
    kept = [table for table in tables if re.match(rf"\[(?:rig|instruments\.{instrument})[\].]", table)]
    return "".join(kept)
