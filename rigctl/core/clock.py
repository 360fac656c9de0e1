"""Rig time: what drivers and procedures wait on.

A real bench runs at speed 1. A simulated one may run `speed` times faster, or on a virtual clock that
jumps to the next event (`simulators.clock`). Everybody who waits, waits here, so nobody knows which it is.
"""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Protocol


class Clock(Protocol):
    """Rig time in seconds; `speed` is rig seconds per wall-clock second (inf when virtual)."""

    @property
    def speed(self) -> float:
        """Rig seconds per wall-clock second."""

    def now_s(self) -> float:
        """Seconds of rig time since the clock's origin."""

    def sleep_s(self, duration_s: float) -> None:
        """Return when `duration_s` of rig time has passed."""


class RealClock:
    """The wall clock, `speed` times as fast; `start_s` when it is made."""

    def __init__(self, speed: float = 1.0, start_s: float = 0.0) -> None:
        self._speed = speed
        self._start_s = start_s
        # The time of day can be set while a campaign waits.
        self._origin = time.monotonic()

    @property
    def speed(self) -> float:
        """Rig seconds per wall-clock second."""
        return self._speed

    def now_s(self) -> float:
        """Seconds of rig time since the clock's origin."""
        return self._start_s + (time.monotonic() - self._origin) * self._speed

    def sleep_s(self, duration_s: float) -> None:
        """Sleep `duration_s` of rig time."""
        if duration_s > 0:
            time.sleep(duration_s / self._speed)


def utc_now() -> str:
    """The time of day, UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
