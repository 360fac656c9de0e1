"""How long a campaign still takes, as its status says it, and any work on many items, by its pace so far."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

from rigctl.campaign.session.heartbeat import STALLED_S
from rigctl.report.quantities import duration

SAY_EVERY_S = 2.0


class Pace:
    """Tells how far work on many items is, every other second and at its end: "3 of 12 written, 40 s left"."""

    def __init__(self, word: str, tell: Callable[[str], None]) -> None:
        self._word, self._tell = word, tell
        self._began_s = self._said_s = time.monotonic()

    def reached(self, done: int, items: int) -> None:
        """So many of all items are done, one at least."""
        now_s = time.monotonic()
        if now_s - self._said_s >= SAY_EVERY_S or done == items:
            self._said_s, left_s = now_s, (now_s - self._began_s) / done * (items - done)
            self._tell(f"{done} of {items} {self._word}, {duration(left_s)} left")


def time_left(status: Mapping[str, Any], now: datetime | None = None) -> str:
    """Of a campaign that runs, less what has passed since it was worked out; of one that does not, the work left.

    `status` is as `rigctl.campaign.status.status_of` gives it. "" when it is done. `now`: the present, if not given.
    """
    state, eta_s, updated = status.get("state"), status.get("eta_s"), status.get("updated")
    if state == "done":
        return ""
    if eta_s is None or not updated or (status.get("heartbeat_age_s") or 0.0) > STALLED_S:
        return "time left unknown"
    if state != "running":
        return f"{duration(eta_s)} of work left"
    passed_s = ((now or datetime.now(UTC)) - datetime.fromisoformat(str(updated))).total_seconds()
    left_s = float(eta_s) - passed_s
    return f"{duration(left_s)} left" if left_s >= 0.0 else f"{duration(-left_s)} later than expected"
