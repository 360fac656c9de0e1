"""One socket of a Newport XPS: `Function(arguments)` out, `code,values,EndOfAPI` back.

A socket takes one function at a time. After any failure the connection is given up, so that an answer that
comes late is never taken for the next one's; the next exchange makes a new connection.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass

from drivers.transport import Connect, Transport
from rigctl.errors import BadReply, LinkError, LinkLost

END = b",EndOfAPI"
SOCKET_CLOSED = -108
_REPLY = re.compile(r"(-?\d{1,4})(?:,(.*))?", re.DOTALL)


@dataclass(frozen=True)
class Reply:
    """The code a function ended with and its values as they came (the request, when the code is negative)."""

    code: int
    text: str

    def numbers(self, count: int) -> tuple[float, ...]:
        """Exactly `count` finite numbers; `ValueError` otherwise."""
        values = tuple(map(float, self.text.split(",")))
        if len(values) != count or not all(map(math.isfinite, values)):
            raise ValueError(f"expected {count} finite numbers")
        return values


def parse_reply(data: bytes) -> Reply:
    """Take a reply apart; `ValueError` when it is not `code,...,EndOfAPI`."""
    match = _REPLY.fullmatch(data.removesuffix(END).decode("latin-1"))
    if match is None or not data.endswith(END):
        raise ValueError(f"expected '<code>,<values>,EndOfAPI', got {data[:80]!r}")
    return Reply(int(match[1]), match[2] or "")


class XpsSocket:
    """A connection that is replaced when it fails."""

    def __init__(self, name: str, connect: Connect) -> None:
        self._name = name
        self._connect = connect
        self._lock = threading.RLock()
        self._busy = False
        self._transport: Transport | None = None
        self._wanted = False

    def open(self) -> None:
        """Connect."""
        self.close()
        self._wanted = True
        self._connected()

    def close(self) -> None:
        """Disconnect for good; an exchange in another thread ends with `LinkLost`."""
        self._wanted = False
        self._drop()

    def exchange(self, request: str, timeout_s: float, start: AbstractContextManager[None] | None = None) -> Reply:
        """Call a function and wait for its end; the request is sent within `start`, which may refuse.

        Raises `LinkTimeout`, `LinkLost`, or `BadReply` for bytes that are no reply; the function may then have
        been executed or not.
        """
        with self._one_at_a_time():
            transport = self._cleared()
            with start or nullcontext(), self._given_up_on_failure():
                transport.write(request.encode("ascii"))
            with self._given_up_on_failure():
                reply = self._parse(request, transport.read_until(END, timeout_s))
            if reply.code == SOCKET_CLOSED:
                self._drop()
            return reply

    @contextmanager
    def _one_at_a_time(self) -> Iterator[None]:
        """A signal handler may come in the middle of its own thread's exchange: it gets a new connection."""
        with self._lock:
            if self._busy:
                self._drop()
            self._busy = True
            try:
                yield
            finally:
                self._busy = False

    def _parse(self, request: str, data: bytes) -> Reply:
        try:
            return parse_reply(data)
        except ValueError as error:
            raise BadReply(
                f"{self._name}: to {request!r}: {error}; is this port 5001 of an XPS?", instrument=self._name
            ) from error

    @contextmanager
    def _given_up_on_failure(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self._drop()
            raise

    def _cleared(self) -> Transport:
        """A connection with nothing left on it; a new one when the controller has ended the old one."""
        transport = self._connected()
        try:
            transport.discard_input()
        except LinkError:
            self._drop()
            return self._connected()
        return transport

    def _connected(self) -> Transport:
        if not self._wanted:
            raise LinkLost(f"{self._name}: not connected; open it first")
        if self._transport is None:
            self._transport = self._connect()
        return self._transport

    def _drop(self) -> None:
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()
