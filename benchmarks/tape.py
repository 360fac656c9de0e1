"""Conversations with instruments, recorded and played back: the instruments' ends with nothing behind them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

from drivers.transport import Endpoint
from simulators.clock import SimulationClock


@dataclass
class Exchange:
    """What was written, and what came back until the next write, each with its delay in rig time."""

    asked: bytes
    replies: list[tuple[float, bytes]] = field(default_factory=list)


class Tape:
    """An endpoint that passes everything on and, between `record` and `play`, remembers it."""

    def __init__(self, endpoint: Endpoint, clock: SimulationClock) -> None:
        self._endpoint = endpoint
        self._clock = clock
        self._lines: list[TapedLine] = []

    def connect(self, send: Callable[[bytes], None]) -> TapedLine:
        """Serve one more client."""
        line = TapedLine(self._endpoint, send, self._clock)
        self._lines.append(line)
        return line

    def record(self) -> None:
        """Begin the tape here."""
        for line in self._lines:
            line.exchanges.clear()

    def play(self) -> int:
        """From now on answer from the tape, over and over; returns the exchanges on it."""
        for line in self._lines:
            line.play()
        return sum(len(line.exchanges) for line in self._lines)


class TapedLine:
    """One client's end of a tape."""

    def __init__(self, endpoint: Endpoint, send: Callable[[bytes], None], clock: SimulationClock) -> None:
        self.exchanges: list[Exchange] = []
        self._send = send
        self._clock = clock
        self._asked_s = 0.0
        self._played: Iterator[Exchange] | None = None
        self._live = endpoint.connect(self._came)

    @property
    def hung_up(self) -> bool:
        """True once the instrument has ended the connection; a tape never does."""
        return self._played is None and bool(getattr(self._live, "hung_up", False))

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; `ValueError` when the tape has others here: other questions, other answers."""
        if self._played is None:
            self.exchanges.append(Exchange(data))
            self._asked_s = self._clock.now_s()
            self._live.receive(data)
            return
        exchange = next(self._played)
        if data != exchange.asked:
            raise ValueError(f"the tape has {exchange.asked!r}, now {data!r} was sent")
        for delay_s, reply in exchange.replies:
            if delay_s:
                self._clock.call_at(self._clock.now_s() + delay_s, partial(self._send, reply))
            else:
                self._send(reply)

    def close(self) -> None:
        """The client has gone."""
        self._live.close()

    def play(self) -> None:
        """Answer from the tape, over and over."""
        self._played = itertools.cycle(self.exchanges)

    def _came(self, data: bytes) -> None:
        if self.exchanges:
            self.exchanges[-1].replies.append((self._clock.now_s() - self._asked_s, data))
        self._send(data)
