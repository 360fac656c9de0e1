"""How far a campaign is, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.campaign.session.heartbeat import STALLED_S
from rigctl.report.quantities import counted, duration
from rigctl.report.time_left import time_left


def repeats_line(repeated: Mapping[str, int]) -> str:
    """How many runs were repeated and why; empty when none was."""
    if not repeated:
        return ""
    why = ", ".join(f"{error} {count}" for error, count in repeated.items())
    return f"{sum(repeated.values())} repeated after a fault ({why})"


def status_lines(status: Mapping[str, Any]) -> list[str]:
    """A campaign's status in two lines; more for what it asks, what is wrong, what was repeated or left out."""
    runs = f"{status['runs_done']} of {status['runs_planned']} runs ({status['runs_invalid']} invalid)"
    asked = status.get("question")
    # While it waits for a person nobody knows how long that takes.
    left = "" if asked else time_left(status)
    lines = [", ".join(filter(None, [f"{status['state']}: {runs}", left]))]
    if asked:
        words = "|".join(asked["choices"])
        # What to type there is of the campaign's own terminal.
        text = asked["text"].partition(" Type ")[0].strip()
        lines.append(f"WAITS FOR YOU: {text} Answer at its terminal, or with `rigctl answer STORE {words}`")
    age_s = status.get("heartbeat_age_s")
    if age_s is not None and age_s > STALLED_S:
        lines.append(
            f"STALLED: its process has given no sign of life for {duration(age_s)}; `rigctl stop RIG` stops the rig"
        )
    if status.get("killed"):
        lines.append(
            "its process is gone without a word; `rigctl stop RIG` brings the rig to rest, `rigctl resume` goes on"
        )
    if rows := status.get("readings_invalid"):
        lines.append(f"{counted(rows, 'reading')} left out, marked invalid in readings.csv")
    lines += [str(status.get("step", "")), repeats_line(status.get("runs_repeated", {}))]
    if repeat := status.get("last_repeat"):
        lines.append(f"last repeated: {repeat['key']}, because of: {repeat['reason']}")
    for remark in status.get("remarks", []):
        what = "has a remark" if remark["valid"] else "is invalid"
        lines.append(f"run {remark['run_id']} {what}: {remark['reason']}")
    return list(filter(None, lines))
