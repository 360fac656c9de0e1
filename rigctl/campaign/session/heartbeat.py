"""A campaign's heartbeat: its process touches the store's lock file once a second, whatever its procedure waits for.

A process that is stopped or swapped out holds its lock and says nothing: only the age of the last beat tells.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

from rigctl.campaign.session.locks import store_lock

BEAT_S = 1.0
STALLED_S = 5.0
"""No sign of life for so long is an alarm: five beats, more than a busy computer or a slow disk keeps back."""


def beat(store: Path) -> None:
    """Give a sign of life; a file that cannot be touched is no reason to end a campaign."""
    with suppress(OSError):
        os.utime(store_lock(store))


def beat_age_s(store: Path) -> float | None:
    """Seconds since the last beat, at least 0; None where there never was one."""
    try:
        return max(time.time() - store_lock(store).stat().st_mtime, 0.0)
    except OSError:
        return None


def written_age_s(store: Path) -> float | None:
    """Seconds since anything was last written into a store, at least 0; None when it is not there."""
    times = []
    for path in (store, store.with_name(f"{store.name}-wal")):
        with suppress(OSError):
            times.append(path.stat().st_mtime)
    return max(time.time() - max(times), 0.0) if times else None
