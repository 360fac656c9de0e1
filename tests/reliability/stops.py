"""What the bytes of the motion controllers mean: this sets an axis in motion, that brings it to rest.

From the controllers' protocols, not from the drivers.
"""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from tests.reliability.wires import Sent

MOTION = re.compile(
    rb"(?P<stop>GroupMoveAbort|GroupKill|KillAll|\bABORT\b|\d+ST\b|\bAB\b)"
    rb"|(?P<motion>GroupInitialize|GroupHomeSearch|GroupMove(?:Absolute|Relative)|GroupMotionEnable|GroupJog"
    rb"|\bENABLE\b|\bHOME(?:ASYNC)?\b|\bMOVE(?:ABS|INC)\b|\bOSCILLATE\b|\bLINEAR\b|\bFREERUN\b|\bPROGRAM RUN\b"
    rb"|\d+(?:MO(?!\?)|OR|PA(?!\?)|PR(?!\?)|MV))"
)


@dataclass(frozen=True)
class Order:
    """One command that moves or stops an axis, when it went over the wire (monotonic clock)."""

    at_s: float
    instrument: str
    what: Literal["motion", "stop"]
    text: str


def orders(sent: Iterable[Sent]) -> list[Order]:
    """Every command that moves or stops, in the order of the wires."""
    return [
        Order(piece.at_s, piece.instrument, "stop" if found["stop"] else "motion", found.group().decode())
        for piece in sent
        for found in MOTION.finditer(piece.data)
    ]


def at_rest(kind: str, port: int, within_s: float) -> bool:
    """Ask a controller on a port of 127.0.0.1, by a client of our own, until it is at rest."""
    deadline_s = time.monotonic() + within_s
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as line:
        while _moves(kind, line):
            if time.monotonic() > deadline_s:
                return False
            time.sleep(0.05)
    return True


def _moves(kind: str, line: socket.socket) -> bool:
    if kind == "newport-xps":
        line.sendall(b"GroupStatusGet(Group1,int *)")
        return int(line.recv(4096).split(b",")[1]) in {40, 41, *range(43, 49)}
    line.sendall(b"AXISSTATUS(X)\n")
    return bool(int(line.recv(4096).strip().lstrip(b"%")) & (1 << 3 | 1 << 14))
