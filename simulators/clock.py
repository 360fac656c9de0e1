"""Time for simulated instruments: an event queue on a virtual clock, or on the wall clock speeded up."""

from __future__ import annotations

import heapq
import itertools
import math
import threading
import time
from collections.abc import Callable


class SimulationClock:
    """Rig time with scheduled events; the base of both kinds.

    Everything a simulated instrument does happens under `lock`: receiving bytes, and events.
    """

    speed: float

    def __init__(self) -> None:
        # Re-entrant: an event may have an instrument answer, which takes the lock again.
        self.lock = threading.RLock()
        self._queue: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()

    def now_s(self) -> float:
        """Rig time [s]."""
        raise NotImplementedError

    def call_at(self, at_s: float, callback: Callable[[], None]) -> None:
        """Run `callback` under the lock when rig time reaches `at_s` (at once on the next advance if past)."""
        with self.lock:
            # Events of one time run in the order in which they were asked for, and callbacks are never compared.
            heapq.heappush(self._queue, (at_s, next(self._order), callback))

    def next_event_s(self) -> float:
        """Rig time of the next event, inf when there is none."""
        with self.lock:
            return self._queue[0][0] if self._queue else math.inf

    def run_due(self) -> None:
        """Run every event whose time has come."""
        with self.lock:
            # An event may ask for another one at once.
            while self._queue and self._queue[0][0] <= self.now_s():
                heapq.heappop(self._queue)[2]()

    def go_on_from(self, at_s: float) -> None:
        """Leave out the time until `at_s`, if that is to come: a world started anew is as late as the one before."""
        raise NotImplementedError

    def sleep_s(self, duration_s: float) -> None:
        """Return when `duration_s` of rig time has passed and its events have run."""
        self.wait_for(lambda: False, duration_s)

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Let time pass until `condition` holds; False when `timeout_s` passed first."""
        raise NotImplementedError


class VirtualClock(SimulationClock):
    """Jumps from event to event: a night's campaign in seconds."""

    def __init__(self, start_s: float = 0.0) -> None:
        super().__init__()
        self.speed = math.inf
        self._now_s = start_s

    def now_s(self) -> float:
        """Rig time [s]."""
        return self._now_s

    def go_on_from(self, at_s: float) -> None:
        """Leave out the time until `at_s`, but no event."""
        self.sleep_s(at_s - self._now_s)

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Run events in order of time until `condition` holds or the deadline is reached."""
        with self.lock:
            deadline_s = self._now_s + timeout_s
            while not condition():
                if self.next_event_s() > deadline_s:
                    # A negative time-out must not take the clock back.
                    self._now_s = max(self._now_s, deadline_s)
                    return False
                at_s, _, callback = heapq.heappop(self._queue)
                # Nor may an event that was due before now.
                self._now_s = max(self._now_s, at_s)
                callback()
            return True


class ScaledClock(SimulationClock):
    """The wall clock, `speed` times as fast."""

    def __init__(self, speed: float = 1.0, start_s: float = 0.0) -> None:
        super().__init__()
        self.speed = speed
        self._start_s = start_s
        self._origin = time.monotonic()

    def now_s(self) -> float:
        """Rig time [s]."""
        return self._start_s + (time.monotonic() - self._origin) * self.speed

    def go_on_from(self, at_s: float) -> None:
        """Leave out the time until `at_s`."""
        with self.lock:
            self._start_s += max(at_s - self.now_s(), 0.0)

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Sleep from event to event until `condition` holds or the deadline is reached."""
        deadline_s = self.now_s() + timeout_s
        while True:
            self.run_due()
            # Conditions look at instruments, which events of other threads change.
            with self.lock:
                if condition():
                    return True
            now_s = self.now_s()
            if now_s >= deadline_s:
                return False
            # Another thread's command may bring the condition about: look again soon even without an event.
            until_s = min(deadline_s, self.next_event_s())
            time.sleep(min(max(until_s - now_s, 0.0) / self.speed, 0.005))
