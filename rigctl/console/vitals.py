"""Signs of life of a campaign, as its files show them: how long ago its process beat, and anything was recorded."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from rigctl.campaign.session.heartbeat import STALLED_S, beat_age_s, written_age_s

NOTHING_RECORDED_S = 120.0
"""A campaign that lives and neither asks nor records for so long is worth a look: samples come every second."""


@dataclass(frozen=True)
class Vitals:
    """Of a store, with times on this computer's monotonic clock; None where there is no such sign."""

    path: Path
    alive: bool
    beat_s: float | None = None
    written_s: float | None = None

    def beat_age_s(self) -> float | None:
        """Seconds since the process of the campaign gave a sign of life; None when none runs."""
        return None if self.beat_s is None or not self.alive else time.monotonic() - self.beat_s

    def written_age_s(self) -> float | None:
        """Seconds since anything was recorded."""
        return None if self.written_s is None else time.monotonic() - self.written_s

    @property
    def stalled(self) -> bool:
        """Whether the process holds its store and gives no sign of life."""
        age_s = self.beat_age_s()
        return age_s is not None and age_s > STALLED_S

    @property
    def silent(self) -> bool:
        """Whether the process lives and has recorded nothing for long."""
        age_s = self.written_age_s()
        return self.alive and not self.stalled and age_s is not None and age_s > NOTHING_RECORDED_S


def vitals_of(store: Path, alive: bool) -> Vitals:
    """As they are now."""
    now_s = time.monotonic()
    beat, written = beat_age_s(store), written_age_s(store)
    return Vitals(store, alive, None if beat is None else now_s - beat, None if written is None else now_s - written)
