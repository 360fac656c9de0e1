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
    """A campaign's status in two lines; more when runs were repeated, or readings of a table are marked invalid."""
    runs = f"{status['runs_done']} of {status['runs_planned']} runs ({status['runs_invalid']} invalid)"
    lines = [", ".join(filter(None, [f"{status['state']}: {runs}", time_left(status)]))]
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
    return list(filter(None, lines))
