"""What a store keeps beside samples, as its readers get it: events and documents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Event:
    """Something that happened: `time` is UTC, ISO 8601; `rig_time_s` where the rig's clock was known."""

    id: int
    time: str
    rig_time_s: float | None
    kind: str
    data: dict[str, Any]


@dataclass(frozen=True)
class Document:
    """Something worked out from the runs: a model version, a fit, a diagnosis."""

    id: int
    time: str
    kind: str
    data: dict[str, Any]
