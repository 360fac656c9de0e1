"""A store as the screens show it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # with numpy and SQLite, which the first paint does not wait for
    from rigctl.campaign.recording import ChannelInfo, RunRecord
    from rigctl.campaign.session.questions import Question
    from rigctl.campaign.store.entries import Event
    from rigctl.core.arrays import FloatArray


@dataclass(frozen=True)
class StoreView:
    """A store at one moment; `events` are the newest ones, `samples` those of the run under way, else of the last."""

    path: Path
    status: Mapping[str, Any]
    alive: bool
    runs: tuple[RunRecord, ...]
    events: tuple[Event, ...]
    identities: Mapping[str, Mapping[str, Any]]
    question: Question | None
    run_id: str = ""
    samples: Mapping[str, FloatArray] = field(default_factory=dict)
    sampled_s: float = math.nan
    """When the newest sample was recorded, on this computer's monotonic clock; NaN when nobody knows."""
    run_ended_s: float = math.nan
    """When the last finished run was over, on the same clock."""
    title: str = ""
    campaign_toml: str = ""
    rig_toml: str = ""
    channels: Mapping[str, ChannelInfo] = field(default_factory=dict)

    @property
    def state(self) -> str:
        """running, paused, done, aborted or interrupted."""
        return str(self.status.get("state", "?"))

    @property
    def killed(self) -> bool:
        """Whether the campaign's process is gone and could not say how it ended."""
        return bool(self.status.get("killed"))
