"""What happened, a line each: events of a store and what was done at this console."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.campaign.store.entries import Event  # with numpy, which the first paint does not wait for

ALARMS = {
    "aborted",
    "alarm",
    "failed",
    "fault",
    "found-moving",
    "instrument-lost",
    "mounting-lost",
    "run-repeated",
    "step-repeated",
}
BOOKKEEPING = {"run-ended"}
"""What a resumed campaign needs to know and no operator."""


@dataclass(frozen=True)
class LogLine:
    """One thing that happened: `time` is UTC, ISO 8601; `event` its number in the store, 0 for this console's own."""

    time: str
    kind: str
    text: str
    event: int = 0

    @property
    def alarm(self) -> bool:
        """Whether it needs attention."""
        return self.kind in ALARMS


@dataclass(frozen=True)
class Search:
    """What is looked for: words in any line, or in alarms alone; without words everything."""

    words: str = ""
    only_alarms: bool = False

    def finds(self, line: LogLine) -> bool:
        """Whether a line is wanted."""
        if self.only_alarms and not line.alarm:
            return False
        return self.words.lower() in f"{line.time} {line.kind} {line.text}".lower()


def lines_of(events: Iterable[Event]) -> list[LogLine]:
    """The events of a store that an operator wants to know of."""
    return [
        LogLine(event.time, event.kind, _data_text(event.data), event.id)
        for event in events
        if event.kind not in BOOKKEEPING
    ]


def _data_text(data: Mapping[str, Any]) -> str:
    return ", ".join(f"{key}: {_shown(value)}" for key, value in data.items())


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, str):
        return value
    if isinstance(value, list):
        return f"[{', '.join(map(_shown, value))}]"
    if isinstance(value, dict):
        return f"{{{_data_text(value)}}}"
    import json  # none is shown before the first paint

    return json.dumps(value)
