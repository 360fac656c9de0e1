"""What connects simulated instruments with each other and with the world."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.stretches import stretches

Signal = Callable[[FloatArray], FloatArray]
"""A quantity of the world at given rig times [s], same shape; NaN where there is none (a laser's target lost)."""

LINE_HISTORY_S = 7200.0
"""How far back a voltage is remembered; longer than any meter's memory goes unread."""


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
        # The train may be days long: only those near the interval are looked at.
        first = self._index(after_s) - 1
        times = self.first_s + self.period_s * np.arange(max(first, 0), self._index(until_s) + 2, dtype=np.float64)
        return times[(times > after_s) & (times <= until_s)]

    def _index(self, at_s: float) -> int:
        """The number of edges before `at_s`, give or take one, and at most what makes the train complete."""
        return math.floor(min(max((at_s - self.first_s) / self.period_s, 0.0), self.count - 2.0))


class VoltageLine:
    """A wire with a voltage on it: one instrument drives it, any number measure it. 0 V until it is driven."""

    def __init__(self) -> None:
        self._courses: list[tuple[float, Signal]] = [(-math.inf, np.zeros_like)]

    def drive(self, from_s: float, volts: Signal) -> None:
        """The voltage from now on; `from_s` never runs backwards."""
        # Of two voltages set at one instant the later one counts.
        kept = [course for course in self._courses if course[0] < from_s]
        # The oldest one goes when the next one covers all that is remembered.
        while len(kept) > 1 and kept[1][0] < from_s - LINE_HISTORY_S:
            kept.pop(0)
        self._courses = [*kept, (from_s, volts)]

    def sample(self, times_s: FloatArray) -> FloatArray:
        """The voltage at rig times of the recent past [V], same shape."""
        course_of = np.searchsorted([start_s for start_s, _ in self._courses[1:]], times_s, side="right")
        volts = np.empty_like(times_s)
        for index, chosen in stretches(course_of):
            volts[chosen] = self._courses[index][1](times_s[chosen])
        return volts


VM_COMP_PULSE_S = 2e-6
"""How long a pulse of a multimeter's VM COMP is."""


class TriggerLine:
    """A wire with pulses on it, `pulse_s` long: one instrument gives trains, any number listen."""

    def __init__(self, pulse_s: float = VM_COMP_PULSE_S) -> None:
        self.pulse_s = pulse_s
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


class StretchedLine(TriggerLine):
    """What a pulse stretcher makes of a line: the same edges, pulses of another length."""

    def __init__(self, line: TriggerLine, pulse_s: float) -> None:
        super().__init__(pulse_s)
        self._line = line

    @property
    def train(self) -> Train | None:
        """The latest train."""
        return self._line.train

    def edges(self, after_s: float, until_s: float) -> FloatArray:
        """All edges in (after_s, until_s]."""
        return self._line.edges(after_s, until_s)
