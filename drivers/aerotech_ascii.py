"""Aerotech's ASCII command interface (Ensemble, Soloist): one line out, one status character and a value back.

Whether a bare acknowledge is followed by a line feed depends on the controller's set-up ("Always Send
EOS"), so a line feed before a status character is passed over and never awaited.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import NamedTuple

from drivers.transport import Connect, Transport
from rigctl.errors import BadReply, LinkError, LinkLost

SUCCESS, INVALID, FAULT, TIMEOUT = "%", "!", "#", "$"


class Answer(NamedTuple):
    """The status character, and the value when it was a query that succeeded."""

    status: str
    value: str = ""


class AsciiLink:
    """The one connection such a controller serves; usable from any thread, one exchange at a time.

    The controller disconnects a silent client, so a connection found lost is opened again where that is safe:
    always before a line is sent, and afterwards for queries and for commands that may be given twice. After
    a time-out the connection is dropped: a late answer must not be taken for that to the next line.
    """

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self.lock = threading.RLock()
        self.wanted = False
        self._name = name
        self._connect = connect
        self._timeout_s = timeout_s
        self._transport: Transport | None = None

    def open(self) -> None:
        """Connect."""
        with self.lock:
            self.wanted = True
            self._connected()

    def close(self) -> None:
        """Disconnect; may be called twice."""
        with self.lock:
            self.wanted = False
            self._drop()

    def ask(self, line: str) -> Answer:
        """Send a query; asked again on a new connection when the old one turns out to be lost."""
        with self.lock:
            try:
                return self._exchange(line, self._timeout_s, query=True)
            except LinkLost:
                return self._exchange(line, self._timeout_s, query=True)

    def ask_each(self, lines: Sequence[str]) -> list[Answer]:
        """Send queries one after the other, each when the one before is answered; stops after one that fails.

        Nothing else comes between them, so whether the controller has hung up is looked at once, not for each.
        """
        with self.lock:
            answers = [self.ask(lines[0])] if lines else []
            for line in lines[1:]:
                if answers[-1].status != SUCCESS:
                    break
                try:
                    answers.append(self._converse(self._connected(), line, self._timeout_s, query=True))
                except LinkLost:
                    answers.append(self._exchange(line, self._timeout_s, query=True))
            return answers

    def tell(self, line: str, *, timeout_s: float | None = None) -> Answer:
        """Send a command, once."""
        with self.lock:
            return self._exchange(line, timeout_s or self._timeout_s, query=False)

    def insist(self, line: str) -> Answer:
        """Send a command that does no harm when given twice; repeated once on a new connection."""
        with self.lock:
            try:
                return self.tell(line)
            except LinkError:
                return self.tell(line)

    def _exchange(self, line: str, timeout_s: float, *, query: bool) -> Answer:
        return self._converse(self._awake(), line, timeout_s, query=query)

    def _converse(self, transport: Transport, line: str, timeout_s: float, *, query: bool) -> Answer:
        try:
            transport.write(line.encode("ascii") + b"\n")
            status = transport.read_exactly(1, timeout_s)
            while status in b"\r\n":
                status = transport.read_exactly(1, timeout_s)
            if query and status == b"%":
                value = transport.read_until(b"\n", timeout_s)
                return Answer(SUCCESS, value.decode("ascii", errors="replace").strip())
        except LinkError:
            self._drop()
            raise
        if status not in b"%!#$":
            self._drop()
            raise BadReply(
                f"{self._name}: answered {line!r} with {status!r} instead of one of % ! # $; "
                "check that an Aerotech ASCII interface listens there",
                instrument=self._name,
            )
        return Answer(status.decode("ascii"))

    def _connected(self) -> Transport:
        if not self.wanted:
            raise LinkLost(f"{self._name}: not open; open it first")
        if self._transport is None:
            self._transport = self._connect()
        return self._transport

    def _awake(self) -> Transport:
        """The connection, opened again when the controller has ended it for idleness: nothing is sent yet."""
        transport = self._connected()
        try:
            transport.discard_input()
        except LinkLost:
            self._drop()
            transport = self._connected()
        return transport

    def _drop(self) -> None:
        if self._transport is not None:
            self._transport.close()
            self._transport = None
