"""What transports over real wires share: a buffer, a deadline, and how reads are cut from the stream."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod

from drivers.transport import timed_out
from rigctl.core.clock import Clock
from rigctl.core.errors import LinkError, LinkLost

REPLY_BYTES_MAX = 1 << 24
"""Longer than any reply: a laser's 1.2 million stored values are 11 MB."""
WALL_FLOOR_S = 1.0
"""Shortest wall-clock wait: a speeded-up simulation still needs real time to schedule two processes."""


class BufferedTransport(ABC):
    """A `drivers.transport.Transport` over something that receives in pieces.

    A read of `timeout_s` rig seconds gives up after `timeout_s / clock.speed` seconds of wall-clock time,
    but never before `floor_s`. Bytes that came before a time-out stay for the next read.
    """

    def __init__(self, address: str, clock: Clock, floor_s: float = WALL_FLOOR_S, *, guarded: bool = True) -> None:
        self.address = address
        self.guarded = guarded
        self._clock = clock
        self._floor_s = floor_s
        self._received = bytearray()

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send all of `data`; `LinkLost` when the other end is gone."""

    @abstractmethod
    def close(self) -> None:
        """End the connection; may be called twice."""

    @abstractmethod
    def _receive(self, wait_s: float) -> bytes:
        """All that is there now, or the first that comes within `wait_s` wall-clock seconds; else b""."""

    def read_until(self, terminator: bytes, timeout_s: float) -> bytes:
        """Bytes up to and including `terminator`; `LinkTimeout` or `LinkLost`."""
        deadline = self._deadline(timeout_s)
        searched = 0
        while (place := self._received.find(terminator, searched)) < 0:
            # Bytes looked through are not searched again, but for a terminator that may be cut in two.
            searched = max(0, len(self._received) - len(terminator) + 1)
            self._fill(deadline, repr(terminator), timeout_s)
        return self._take(place + len(terminator))

    def read_exactly(self, count: int, timeout_s: float) -> bytes:
        """Exactly `count` bytes; `LinkTimeout` or `LinkLost`."""
        deadline = self._deadline(timeout_s)
        while len(self._received) < count:
            self._fill(deadline, f"{count} bytes", timeout_s)
        return self._take(count)

    def unread(self) -> bytes:
        """Take what has arrived and nobody has read; `LinkLost` when there is nothing but an end.

        `LinkError` when it does not end.
        """
        try:
            # Until nothing more is there: one look gives only what the system hands over at once.
            while came := self._receive(0.0):
                self._keep(came, "silence")
        except LinkLost:
            # What came before the end is still told; the loss shows at the next look.
            if not self._received:
                raise
        return self._take(len(self._received))

    def _deadline(self, timeout_s: float) -> float:
        # Time-outs are rig time; a clock speeded up 50 times must not leave a process 40 ms to answer.
        return time.monotonic() + max(timeout_s / self._clock.speed, self._floor_s)

    def _fill(self, deadline: float, wanted: str, timeout_s: float) -> None:
        came = self._receive(max(deadline - time.monotonic(), 0.0))
        if not came:
            raise timed_out(self.address, wanted, timeout_s, bytes(self._received))
        self._keep(came, wanted)

    def _keep(self, came: bytes, wanted: str) -> None:
        self._received += came
        # Something that sends without end would fill the memory before any time-out, and never be silent.
        if len(self._received) > REPLY_BYTES_MAX:
            self._received.clear()
            raise LinkError(
                f"{self.address}: {REPLY_BYTES_MAX} bytes came and no {wanted}; is it another instrument?"
            )

    def _take(self, count: int) -> bytes:
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken
