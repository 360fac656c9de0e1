"""How long a campaign still takes, as its status says it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from rigctl.campaign.session.heartbeat import STALLED_S
from rigctl.report.quantities import duration


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
