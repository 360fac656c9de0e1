"""One client's line: commands end with CR, and each gets its reply before the next is looked at.

Line feeds and empty lines are passed over: mecode, on a real LK-G, ends its lines with CR LF, some twice, and is not
answered twice.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from simulators.clock import SimulationClock

LINE_MAX = 200


@dataclass(frozen=True)
class Answer:
    """A reply and how long it takes."""

    text: str
    delay_s: float = 0.0


class Session:
    """A connection: cuts the bytes into lines and keeps the order of replies."""

    def __init__(
        self, clock: SimulationClock, answer: Callable[[bytes], Answer], send: Callable[[bytes], None]
    ) -> None:
        self._clock = clock
        self._answer = answer
        self._send = send
        self._buffer = bytearray()
        self._overlong = False
        self._lines: deque[bytes] = deque()
        self._replying = False
        self._closed = False

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; whole or partial commands."""
        with self._clock.lock:
            self._buffer += data
            self._cut()
            self._serve()

    def close(self) -> None:
        """The client has gone; replies under way are lost."""
        with self._clock.lock:
            self._closed = True
            self._lines.clear()

    def _cut(self) -> None:
        *lines, rest = bytes(self._buffer).split(b"\r")
        self._buffer = bytearray(rest)
        for line in lines:
            # The end of a line that was refused already.
            if self._overlong:
                self._overlong = False
            elif command := line.lstrip(b"\n"):
                self._lines.append(command)
        if len(rest) > LINE_MAX:
            # Refused at once: who never sends a CR would wait forever.
            if not self._overlong:
                self._lines.append(rest)
            self._overlong = True
            self._buffer.clear()

    def _serve(self) -> None:
        # The next command is looked at only after the reply to the one before has gone.
        while self._lines and not self._replying:
            answer = self._answer(self._lines.popleft())
            reply = answer.text.encode("ascii") + b"\r"
            if answer.delay_s > 0:
                self._replying = True
                self._clock.call_at(self._clock.now_s() + answer.delay_s, partial(self._late, reply))
            else:
                self._send(reply)

    def _late(self, reply: bytes) -> None:
        self._replying = False
        if not self._closed:
            self._send(reply)
            self._serve()
