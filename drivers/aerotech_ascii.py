"""Aerotech's ASCII command interface (Ensemble, Soloist): one line out, one status character and a value back.

Whether a bare acknowledge is followed by a line feed depends on the controller's set-up ("Always Send
EOS"), so a line feed before a status character is passed over and never awaited.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import NamedTuple

from drivers.conversation import Check, Conversation
from drivers.transport import Connect, Transport
from rigctl.core.errors import BadReply, LinkError, LinkLost, OutOfStep

SUCCESS, INVALID, FAULT, TIMEOUT = "%", "!", "#", "$"
STATUSES = SUCCESS + INVALID + FAULT + TIMEOUT
LINE_ENDS = b"\r\n"
VERSION = "VERSION"


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
        self._name = name
        self._timeout_s = timeout_s
        self._conversation = Conversation(
            name,
            connect,
            Check(_bytes(VERSION), self._is_version),
            anew=True,
            # A line feed behind a bare acknowledge may arrive late: it is part of no reply.
            harmless=lambda unread: not unread.strip(LINE_ENDS),
        )
        self._version = Answer("")
        self.lock = self._conversation.lock

    def open(self) -> None:
        """Connect."""
        self._conversation.open()

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._conversation.close()

    def urgently(self) -> AbstractContextManager[None]:
        """Connected even if it is not open, and before all others."""
        return self._conversation.urgently()

    def version(self) -> Answer:
        """The firmware's version, `4.01.000`: a value that no other question has."""
        self._version = self.ask(VERSION)
        return self._version

    # Queries only: a command may have been carried out although its answer was lost (docs/decisions/008).
    def ask(self, line: str) -> Answer:
        """Send a query; asked again on a new connection when the old one turns out to be lost."""
        with self.lock:
            try:
                return self._exchange(line, self._timeout_s, query=True)
            except LinkLost:
                return self._exchange(line, self._timeout_s, query=True)

    def ask_each(self, lines: Sequence[str]) -> list[Answer]:
        """Send queries, each once the one before is answered; stops after one that fails.

        What is answered as the query before it, or with another number of digits than that, is asked again: a
        reply that came twice, or not whole, would look like that. `OutOfStep` when the second answer is another.
        """
        with self.lock:
            # One after the other: the interpreter takes no second line before it has answered the first.
            answers = self._conversation.ask_each(
                [_bytes(line) for line in lines],
                self._read_line,
                lambda answer: answer.status == SUCCESS,
            )
            for place in _in_doubt([answer.value for answer in answers]):
                # The same answer twice is believed: two neighbouring positions may well be equal.
                if self._exchange(lines[place], self._timeout_s, query=True) != answers[place]:
                    raise OutOfStep(f"{self._name}: {lines[place]!r} was answered in two ways; measure again")
            return answers

    def tell(self, line: str, *, timeout_s: float | None = None) -> Answer:
        """Send a command, once."""
        return self._exchange(line, timeout_s or self._timeout_s, query=False)

    def insist(self, line: str) -> Answer:
        """Send a command that does no harm when given twice; repeated once on a new connection."""
        with self.lock:
            try:
                return self.tell(line)
            except LinkError:
                return self.tell(line)

    def confirm_in_step(self) -> None:
        """`OutOfStep` when the version is not the answer to its question, or something else is unread."""
        with self.lock:
            # The version is the check question; what it answers is learned at the first time it is asked.
            if not self._version.value:
                self.version()
            self._conversation.confirm_in_step()

    def _is_version(self, transport: Transport) -> bool:
        return self._read(VERSION, self._timeout_s, True, transport) == self._version

    def _exchange(self, line: str, timeout_s: float, *, query: bool) -> Answer:
        return self._conversation.ask(_bytes(line), partial(self._read, line, timeout_s, query))

    def _read(self, line: str, timeout_s: float, query: bool, transport: Transport) -> Answer:
        status = self._status(transport, timeout_s)
        if status not in b"%!#$":
            raise BadReply(
                f"{self._name}: answered {line!r} with {status!r} instead of one of % ! # $; "
                "check that an Aerotech ASCII interface listens there",
                instrument=self._name,
            )
        if not (query and status == b"%"):
            return Answer(status.decode("ascii"))
        value = transport.read_until(b"\n", timeout_s)
        return Answer(SUCCESS, value.decode("ascii", errors="replace").strip("\r\n"))

    def _read_line(self, transport: Transport) -> Answer:
        """As `_read` of a query, in one piece: a refusal without its line end is then a time-out."""
        line = b""
        # Passes over the line feed that a bare acknowledge before this query may have left.
        while not line:
            line = transport.read_until(b"\n", self._timeout_s).strip(LINE_ENDS)
        text = line.decode("ascii", errors="replace")
        if text[0] not in STATUSES:
            raise BadReply(f"{self._name}: {text[:60]!r} came, without one of % ! # $", instrument=self._name)
        return Answer(text[0], text[1:])

    def _status(self, transport: Transport, timeout_s: float) -> bytes:
        status = transport.read_exactly(1, timeout_s)
        while status in LINE_ENDS:
            status = transport.read_exactly(1, timeout_s)
        return status


def _bytes(line: str) -> bytes:
    return line.encode("ascii") + b"\n"


def _in_doubt(values: Sequence[str]) -> list[int]:
    """Where a value is that of the place before, and both sides of where the number of digits changes."""
    doubtful = set()
    for place, (before, value) in enumerate(itertools.pairwise(values), start=1):
        if value == before:
            doubtful.add(place)
        elif _digits(value) != _digits(before):
            doubtful |= {place - 1, place}
    return sorted(doubtful)


def _digits(value: str) -> int:
    return len(value.lstrip("+-"))
