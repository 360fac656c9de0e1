"""What a store keeps beside samples, as its readers get it: documents, and events of known kinds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

FAULT, LOST, BACK = "fault", "instrument-lost", "instruments-back"
RUN_REPEATED, STEP_REPEATED = "run-repeated", "step-repeated"
RUN_ENDED = "run-ended"
"""Keeps when a run was over."""
RESUMED = "resumed"
"""Another process goes on with the campaign."""
IMPORTED = "import"
"""Keeps what was found in the bundle that a store was made from."""
CERTIFIED = "certified"
"""Keeps that a certificate was issued: its number, its file and the item it is of."""
TEMPERATURE_MISSED = "temperature-missed"
"""A thermometer failed or had no valid value; no run is given up for it."""


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
