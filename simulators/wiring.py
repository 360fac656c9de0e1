"""What connects simulated instruments with each other and with the world."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Signal = Callable[[FloatArray], FloatArray]
"""A quantity of the world at given rig times [s], same shape; NaN where there is none (a laser's target lost)."""


class Connection(Protocol):
    """The instrument's end of one connection."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; whole or partial commands."""
        ...

    def close(self) -> None:
        """The client has gone."""
        ...


@runtime_checkable
class EndsItself(Protocol):
    """A connection its instrument may end: an idle time-out, a reboot, another client's request.

    Whoever carries the bytes looks at `hung_up` after every receive and event; once it is True it sends what
    is left, ends the connection and calls `close`.
    """

    hung_up: bool


class SimulatedInstrument(Protocol):
    """Takes and gives an instrument's bytes; called under the clock's lock only."""

    kind: str

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client, which is sent bytes through `send`."""
        ...


@dataclass
class Train:
    """Equally spaced edges: first_s + k period_s, k < count."""

    first_s: float
    period_s: float
    count: int

    def edges(self, after_s: float, until_s: float) -> FloatArray:
        """The edges in (after_s, until_s]."""
        times = self.first_s + self.period_s * np.arange(self.count, dtype=np.float64)
        return times[(times > after_s) & (times <= until_s)]


class TriggerLine:
    """A wire with pulses on it: one instrument gives trains, any number listen."""

    def __init__(self) -> None:
        self._trains: deque[Train] = deque(maxlen=8)

    @property
    def train(self) -> Train | None:
        """The latest train."""
        return self._trains[-1] if self._trains else None

    def begin(self, first_s: float, period_s: float, count: int) -> None:
        """A new train; it ends the one before."""
        self.end(first_s)
        self._trains.append(Train(first_s, period_s, count))

    def end(self, at_s: float) -> None:
        """Cut the latest train: no edge after `at_s`."""
        if self._trains:
            train = self._trains[-1]
            train.count = len(train.edges(-np.inf, at_s))

    def edges(self, after_s: float, until_s: float) -> FloatArray:
        """All edges in (after_s, until_s]."""
        parts = [train.edges(after_s, until_s) for train in self._trains]
        return np.concatenate(parts) if parts else np.empty(0)
