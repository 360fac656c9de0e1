"""One socket of a Newport XPS: `Function(arguments)` out, `code,values,EndOfAPI` back.

A socket takes one function at a time. After any failure the connection is given up, so that an answer that
comes late is never taken for the next one's; the next exchange makes a new connection.
"""

from __future__ import annotations

import re
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial

from drivers.conversation import Check, Conversation
from drivers.numbers import decimal
from drivers.transport import Connect, Transport
from rigctl.core.errors import BadReply

END = b",EndOfAPI"
SOCKET_CLOSED = -108
FIRMWARE = "FirmwareVersionGet(char *)"
"""Answered by a text that no other function answers."""
_REPLY = re.compile(r"(-?\d{1,4})(?:,(.*))?", re.DOTALL | re.ASCII)


@dataclass(frozen=True)
class Reply:
    """The code a function ended with and its values as they came (the request, when the code is negative)."""

    code: int
    text: str

    def numbers(self, count: int) -> tuple[float, ...]:
        """Exactly `count` finite numbers; `ValueError` otherwise."""
        fields = self.text.split(",")
        if len(fields) != count:
            raise ValueError(f"expected {count} finite numbers")
        return tuple(map(decimal, fields))


def parse_reply(data: bytes) -> Reply:
    """Take a reply apart; `ValueError` when it is not `code,...,EndOfAPI`."""
    # Digits bounded, so that bytes of another instrument do not become a code.
    match = _REPLY.fullmatch(data.removesuffix(END).decode("latin-1"))
    if match is None or not data.endswith(END):
        raise ValueError(f"expected '<code>,<values>,EndOfAPI', got {data[:80]!r}")
    return Reply(int(match[1]), match[2] or "")


class XpsSocket:
    """One socket's functions, one at a time."""

    def __init__(self, name: str, connect: Connect, timeout_s: float) -> None:
        self._name = name
        self._conversation = Conversation(
            name, connect, Check(FIRMWARE.encode("ascii"), partial(self._is_firmware, timeout_s)), anew=True
        )

    def open(self) -> None:
        """Connect."""
        self._conversation.open()

    def close(self) -> None:
        """Disconnect for good; an exchange in another thread ends with `LinkLost`."""
        self._conversation.close()

    def urgently(self) -> AbstractContextManager[None]:
        """Connected even if it is not open, and before all others."""
        return self._conversation.urgently()

    def exchange(self, request: str, timeout_s: float, start: AbstractContextManager[None] | None = None) -> Reply:
        """Call a function and wait for its end; the request is sent within `start`, which may refuse.

        Raises `LinkTimeout`, `LinkLost`, `OutOfStep`, or `BadReply` for bytes that are no reply; after all but
        `OutOfStep` the function may have been executed or not.
        """
        reply = self._conversation.ask(request.encode("ascii"), partial(self._read, request, timeout_s), start)
        # The controller is closing this socket: the next function needs another.
        if reply.code == SOCKET_CLOSED:
            self._conversation.doubt()
        return reply

    def confirm_in_step(self) -> None:
        """`OutOfStep` when the firmware is not the answer to its question, or something else is unread."""
        self._conversation.confirm_in_step()

    def give_up(self) -> None:
        """Make a new connection for the next function: the reply to the last one may still come."""
        self._conversation.doubt()

    def confirm_unless_busy(self) -> None:
        """As `confirm_in_step`, where no reply is awaited: that of a motion is still to come."""
        if self._conversation.lock.acquire(blocking=False):
            try:
                self.confirm_in_step()
            finally:
                self._conversation.lock.release()

    def _is_firmware(self, timeout_s: float, transport: Transport) -> bool:
        return "XPS" in self._read(FIRMWARE, timeout_s, transport).text

    def _read(self, request: str, timeout_s: float, transport: Transport) -> Reply:
        data = transport.read_until(END, timeout_s)
        try:
            return parse_reply(data)
        except ValueError as error:
            raise BadReply(
                f"{self._name}: to {request!r}: {error}; is this port 5001 of an XPS?", instrument=self._name
            ) from error
