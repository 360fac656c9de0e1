"""When readings are taken, and where they are kept until they are fetched."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.wiring import TriggerLine

BOUNDLESS = 1_000_000_000
"""What TRIG:COUN INF comes to: at 50 000 readings per second, five and a half hours."""


class Readings(Protocol):
    """The instants of an acquisition's readings, given out once each and in order.

    A reading is there `lag_s` after its instant.
    """

    def due(self, now_s: float) -> FloatArray:
        """The instants of the readings that are there and were not given out yet."""
        ...

    def reached_s(self, count: int) -> float:
        """When the `count`-th of those still to come will be there; inf when nobody can tell."""
        ...

    @property
    def remaining(self) -> int:
        """How many are still to come."""
        ...


class TimedReadings:
    """On the meter's own sample timer."""

    def __init__(self, first_s: float, period_s: float, count: float, lag_s: float) -> None:
        self.first_s, self.period_s, self._lag_s = first_s, period_s, lag_s
        self.count = int(min(count, BOUNDLESS))
        self._taken = 0

    def due(self, now_s: float) -> FloatArray:
        """The instants of the readings that are there and were not given out yet."""
        # Two more than are due, as rounding may be off by one; what is not there yet is cut off below.
        reach = 2 + math.floor((now_s - self._lag_s - self.first_s) / self.period_s)
        times = self.first_s + self.period_s * np.arange(self._taken, min(reach, self.count), dtype=np.float64)
        times = times[times + self._lag_s <= now_s]
        self._taken += len(times)
        return times

    def reached_s(self, count: int) -> float:
        """When the `count`-th of those still to come will be there."""
        index = self._taken + count - 1
        return self.first_s + self.period_s * index + self._lag_s if index < self.count else math.inf

    @property
    def next_s(self) -> float:
        """The instant of the next."""
        return self.first_s + self.period_s * self._taken

    @property
    def remaining(self) -> int:
        """How many are still to come."""
        return self.count - self._taken


class PacedReadings:
    """`samples` readings after each edge of a trigger line; edges that come while these last are missed."""

    def __init__(
        self,
        line: TriggerLine | None,
        armed_s: float,
        triggers: float,
        samples: float,
        delay_s: float,
        period_s: float,
        lag_s: float,
    ) -> None:
        self._lag_s = lag_s
        self._line = line or TriggerLine()
        self._seen_s = armed_s
        self._triggers = int(min(triggers, BOUNDLESS))
        self._offsets_s = delay_s + period_s * np.arange(int(samples))
        # While its readings last the meter hears no edge.
        self._busy_s = float(self._offsets_s[-1]) + period_s
        self._ready_s = -math.inf
        self._scheduled = np.empty(0)

    def due(self, now_s: float) -> FloatArray:
        """The instants of the readings that are there and were not given out yet."""
        accepted = self._accept(self._line.edges(self._seen_s, now_s))[: self._triggers]
        self._seen_s = now_s
        self._triggers -= len(accepted)
        self._scheduled = np.concatenate([self._scheduled, np.add.outer(accepted, self._offsets_s).ravel()])
        count = int(np.count_nonzero(self._scheduled + self._lag_s <= now_s))
        times, self._scheduled = self._scheduled[:count], self._scheduled[count:]
        return times

    def reached_s(self, count: int) -> float:
        """When the `count`-th of those still to come will be there, if the edges for it are announced."""
        if count <= len(self._scheduled):
            return float(self._scheduled[count - 1]) + self._lag_s
        trigger, sample = divmod(count - len(self._scheduled) - 1, len(self._offsets_s))
        edges = self._line.edges(self._seen_s, math.inf)
        if trigger >= len(edges):
            return math.inf
        return float(edges[trigger] + self._offsets_s[sample]) + self._lag_s

    @property
    def remaining(self) -> int:
        """How many are still to come."""
        return self._triggers * len(self._offsets_s) + len(self._scheduled)

    def _accept(self, edges: FloatArray) -> FloatArray:
        # Edges that follow each other as fast as readings must not be missed for rounding.
        tolerance_s = 1e-9
        if not len(edges):
            return edges
        gaps_s = np.diff(edges, prepend=self._ready_s - self._busy_s)
        # The usual case, all edges far enough apart, without a loop.
        if np.all(gaps_s >= self._busy_s - tolerance_s):
            self._ready_s = float(edges[-1]) + self._busy_s
            return edges
        kept = []
        for edge_s in edges:
            if edge_s >= self._ready_s - tolerance_s:
                kept.append(edge_s)
                self._ready_s = edge_s + self._busy_s
        return np.array(kept)


class Memory:
    """Reading memory: when it is full the oldest are lost."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._values = np.empty(0)
        self.last: float | None = None

    def __len__(self) -> int:
        return len(self._values)

    def append(self, values: FloatArray) -> bool:
        """Keep readings; True when older ones were lost."""
        if not len(values):
            return False
        self.last = float(values[-1])
        self._values = np.concatenate([self._values, values])
        overflow = len(self._values) > self._capacity
        self._values = self._values[-self._capacity :]
        return overflow

    def all(self) -> FloatArray:
        """What is there; it stays."""
        return self._values

    def take(self, count: int) -> FloatArray:
        """The oldest readings, which are erased."""
        taken, self._values = self._values[:count], self._values[count:]
        return taken

    def clear(self) -> None:
        """Forget all."""
        self._values = np.empty(0)
        self.last = None
