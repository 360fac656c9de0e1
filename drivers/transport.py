"""The one small thing every driver talks through; no driver knows which it has."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from rigctl.core.errors import LinkLost, LinkTimeout


class Transport(Protocol):
    """A byte stream to one instrument.

    `timeout_s` is rig time. Bytes that arrive after a terminator are kept for the next read. One user at a
    time; a driver that may be asked from several threads holds a lock around each exchange.
    """

    address: str
    guarded: bool
    """No bit turns on the way without being noticed: the wire has check sums, or parity."""

    def write(self, data: bytes) -> None:
        """Send all of `data`; `LinkLost` when the other end is gone."""
        ...

    def read_until(self, terminator: bytes, timeout_s: float) -> bytes:
        """Bytes up to and including `terminator`; `LinkTimeout` (naming what came so far) or `LinkLost`."""
        ...

    def read_exactly(self, count: int, timeout_s: float) -> bytes:
        """Exactly `count` bytes; `LinkTimeout` or `LinkLost`."""
        ...

    def unread(self) -> bytes:
        """Take what has arrived and nobody has read; looks, no wait. `LinkLost` when there is nothing but an end."""
        ...

    def close(self) -> None:
        """End the connection; may be called twice."""
        ...


@runtime_checkable
class Clearable(Protocol):
    """A transport that may reach an instrument past its input buffer, as GPIB's device clear does."""

    def device_clear(self) -> bool:
        """Have it drop what it does and what it has to say; False where this wire has no such thing."""
        ...


Connect = Callable[[], Transport]
"""Opens one connection to an instrument; drivers that need two sockets call it twice."""


class Connection(Protocol):
    """The instrument's end of one connection."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the client."""
        ...

    def close(self) -> None:
        """The client has gone."""
        ...


class Endpoint(Protocol):
    """Something in this process that takes and gives an instrument's bytes."""

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client, which is sent bytes through `send`."""
        ...


class WaitingClock(Protocol):
    """A clock that can wait for a condition which events in this process bring about."""

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Let time pass until `condition` holds; False when `timeout_s` of rig time passed first."""
        ...


class InProcessTransport:
    """A connection to an endpoint in this process; `guarded` is false where it stands for a line without parity."""

    def __init__(self, address: str, endpoint: Endpoint, clock: WaitingClock, *, guarded: bool = True) -> None:
        self.address = address
        self.guarded = guarded
        self._clock = clock
        self._received = bytearray()
        self._open = True
        # The endpoint appends to the buffer itself: no thread, no queue in between.
        self._connection = endpoint.connect(self._received.extend)

    def write(self, data: bytes) -> None:
        """Hand `data` to the instrument's end."""
        if self._ended():
            raise self._lost()
        self._connection.receive(data)

    def read_until(self, terminator: bytes, timeout_s: float) -> bytes:
        """Bytes up to and including `terminator`."""
        if terminator not in self._received:  # most instruments answer at once: no need to let time pass
            self._await(lambda: terminator in self._received, f"{terminator!r}", timeout_s)
        return self._take(self._received.index(terminator) + len(terminator))

    def read_exactly(self, count: int, timeout_s: float) -> bytes:
        """Exactly `count` bytes."""
        if len(self._received) < count:
            self._await(lambda: len(self._received) >= count, f"{count} bytes", timeout_s)
        return self._take(count)

    def unread(self) -> bytes:
        """Take what has arrived and nobody has read; `LinkLost` when there is nothing but an end."""
        if self._received:
            return self._take(len(self._received))
        if self._ended():
            raise self._lost()
        return b""

    def close(self) -> None:
        """End the connection."""
        if self._open:
            self._open = False
            self._received.clear()
            self._connection.close()

    def _take(self, count: int) -> bytes:
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken

    def _await(self, complete: Callable[[], bool], wanted: str, timeout_s: float) -> None:
        settled = self._clock.wait_for(lambda: complete() or self._ended(), timeout_s)
        if not settled:
            raise timed_out(self.address, wanted, timeout_s, bytes(self._received))
        if not complete():
            raise self._lost()

    def _ended(self) -> bool:
        # Only simulated faults hang up; a plain endpoint has no such attribute.
        return not self._open or bool(getattr(self._connection, "hung_up", False))

    def _lost(self) -> LinkLost:
        return lost(self.address, "the instrument ended the connection" if self._open else "it is closed here")


def lost(address: str, why: str) -> LinkLost:
    """The one wording of a lost connection: where and why, and what to try."""
    return LinkLost(f"{address}: no connection, {why}; check power and cable, then reconnect")


def timed_out(address: str, wanted: str, timeout_s: float, received: bytes) -> LinkTimeout:
    """The one wording of a time-out: what was awaited, how long, what came instead."""
    came = f"only {received[:60]!r} came" if received else "nothing came"
    error = LinkTimeout(
        f"{address}: waited {timeout_s:g} s for {wanted}, {came}; check power, cable, address and settings"
    )
    error.received = received
    return error
