"""A rig served on real sockets and pseudo-terminals, and its client, on one virtual clock.

The client's drivers open what `rigctl simulate` writes into its rig file: pyvisa's sockets, pyserial's lines. Time
goes on only when every byte that was sent on any of them has come, and somebody waits: a night's campaign in seconds,
over the wire, and always the same.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from drivers.connect import connector, serial_ways
from drivers.transport import Connect, InProcessTransport, Transport
from drivers.transport_serial import SerialSettings
from rigctl.core.errors import LinkLost
from rigctl.files.rig_file import RigFile, parse_rig, read_rig
from rigctl.rig import build_simulation
from rigctl.serving import Served
from simulators.clock import VirtualClock
from simulators.rig import SimulatedRig
from simulators.serve import Server

PATIENCE_S = 20.0
"""Wall-clock time for a byte on loopback, on a machine as busy as it likes."""


@dataclass
class Line:
    """All connections to one instrument: bytes and ends as they were sent and as they came.

    Either side may end a connection. `digest` is of all that was said.
    """

    written: int = 0
    heard: int = 0
    said: int = 0
    read: int = 0
    closed: int = 0
    ended: int = 0
    digest: Any = field(default_factory=hashlib.sha256)

    @property
    def quiet(self) -> bool:
        """Nothing is on its way."""
        return (self.written, self.said, self.closed) == (self.heard, self.read, self.ended)


class LockstepClock(VirtualClock):
    """Lets no time pass while something is on its way."""

    carry: Callable[[], None] = staticmethod(lambda: None)

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """As ever, but for the wires that are carried before every look."""

        def carried() -> bool:
            self.carry()
            return condition()

        return super().wait_for(carried, timeout_s)


class HeardInstrument:
    """The instrument's end: counts what comes and goes."""

    def __init__(self, inner: Any, line: Line) -> None:
        self._inner, self._line = inner, line

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def connect(self, send: Callable[[bytes], None]) -> Any:
        line = self._line

        def say(data: bytes) -> None:
            line.said += len(data)
            line.digest.update(b"<" + data)
            send(data)

        connection = self._inner.connect(say)
        receive, close = connection.receive, connection.close

        def hear(data: bytes) -> None:
            line.heard += len(data)
            line.digest.update(b">" + data)
            receive(data)

        def end() -> None:
            line.ended += 1
            close()

        connection.receive, connection.close = hear, end
        return connection


class Wire:
    """The client's end of a connection: what a driver writes and reads goes through the real transport."""

    def __init__(self, lockstep: Lockstep, inner: Transport, line: Line) -> None:
        self._lockstep, self._inner, self._line = lockstep, inner, line
        self.hung_up = False
        self.given: Callable[[bytes], None] = lambda _: None

    def connect(self, send: Callable[[bytes], None]) -> Wire:
        self.given = send
        return self

    def receive(self, data: bytes) -> None:
        with self._lockstep.clock.lock:
            self._inner.write(data)
            self._line.written += len(data)
            self._lockstep.carry()

    def take(self) -> None:
        """Hand on what has come."""
        try:
            data = self._inner.unread()
        except LinkLost:
            self._line.closed += not self.hung_up
            self.hung_up = True
            return
        self._line.read += len(data)
        self.given(data)

    def close(self) -> None:
        with self._lockstep.clock.lock:
            self._lockstep.wires.remove(self)
            self._inner.close()
            # A terminal has no connection that ends.
            self._line.closed += not (self.hung_up or self._inner.address.startswith("serial:"))
            self._lockstep.carry()


@dataclass(frozen=True)
class LockstepConnect:
    """Opens real connections to a served instrument."""

    lockstep: Lockstep
    real: Connect
    line: Line

    def __call__(self) -> Transport:
        inner = self.real()
        wire = Wire(self.lockstep, inner, self.line)
        self.lockstep.wires.append(wire)
        return InProcessTransport(inner.address, wire, self.lockstep.clock, guarded=inner.guarded)

    def ways(self, settings: Sequence[SerialSettings]) -> list[tuple[str, Connect]]:
        return [
            (words, LockstepConnect(self.lockstep, real, self.line))
            for words, real in serial_ways(self.real, settings)
        ]


class Lockstep:
    """Carries bytes between a server and its clients until all have come."""

    def __init__(self) -> None:
        self.clock = LockstepClock()
        self.clock.carry = self.carry
        self.server: Server
        self.simulated: SimulatedRig
        self.lines: dict[str, Line] = {}
        self.wires: list[Wire] = []

    def serve(self, clock: Any) -> Server:
        self.server = Server(clock)
        return self.server

    def simulation(self, file: RigFile, clock: Any) -> SimulatedRig:
        made = build_simulation(file, clock)
        self.lines = {name: Line() for name in made.instruments}
        heard: dict[str, Any] = {
            name: HeardInstrument(each, self.lines[name]) for name, each in made.instruments.items()
        }
        made.instruments = heard
        self.simulated = made
        return made

    def carry(self) -> None:
        """Return when nothing is on its way any more."""
        deadline = time.monotonic() + PATIENCE_S
        while not all(line.quiet for line in self.lines.values()):
            once = iter((False, True))
            self.server.wake()
            self.server.serve(lambda once=once: next(once))
            for wire in self.wires:
                wire.take()
            assert time.monotonic() < deadline, str(self.lines)

    def digests(self) -> dict[str, str]:
        """What was said on each line so far, in a word."""
        return {name: line.digest.hexdigest() for name, line in self.lines.items()}


@contextmanager
def served(rig: Path, patch: pytest.MonkeyPatch) -> Iterator[tuple[RigFile, Lockstep]]:
    """The rig file of a client of this rig, which is served meanwhile; one at a time."""
    lockstep = Lockstep()
    with patch.context() as during:
        during.setattr("rigctl.serving.ScaledClock", lambda _: lockstep.clock)
        during.setattr("rigctl.serving.Server", lockstep.serve)
        during.setattr("rigctl.serving.build_simulation", lockstep.simulation)
        with Served(read_rig(rig)) as made:
            file = parse_rig(made.rig_text(), rig)
            names = {table.address: name for name, table in file.instruments.items()}

            def connect(address: str, clock: Any) -> Connect:
                return LockstepConnect(lockstep, connector(address, clock), lockstep.lines[names[address]])

            during.setattr("rigctl.rig.connector", connect)
            during.setattr("rigctl.rig.RealClock", lambda *_: lockstep.clock)
            during.setattr("rigctl.rig._operator_link", lambda *_: made.simulation)
            yield file, lockstep
