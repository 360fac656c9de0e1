"""Screen 5: everything that happened, searchable; alarms; every action of the operator."""

from __future__ import annotations

import json
from collections import deque
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import Input, RichLog, Static

if TYPE_CHECKING:
    from rigctl.console.feed import StoreView

KEPT = 2000
ALARMS = {"failed", "aborted", "mounting-lost", "alarm"}


class LogPane(Vertical):
    """One line per event, the newest at the end."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "search", "Search", key_display="/"),
        Binding("w", "alarms", "Alarms only"),
        Binding("escape", "leave", "Leave search", show=False),
    ]

    def __init__(self) -> None:
        super().__init__(id="log")
        self._lines: deque[tuple[str, str, str]] = deque(maxlen=KEPT)
        self._last_event: tuple[object, int] = (None, 0)
        self._only_alarms = False

    def compose(self) -> ComposeResult:
        """Search on top, lines below."""
        yield Input(placeholder="/ search: kind or text", compact=True, id="search")
        yield Static("", id="log-line")
        yield RichLog(id="events", max_lines=KEPT, wrap=True, auto_scroll=True, min_width=20)

    def add(self, time: str, kind: str, text: str) -> None:
        """Something happened in this console: an action, a note, an alarm."""
        self._lines.append((time, kind, text))
        self._write((time, kind, text))

    def show_store(self, view: StoreView) -> None:
        """Events of the store that have not been shown."""
        path, last = self._last_event
        if path != view.path:
            last = 0
        for event in view.events:
            if event.id > last:
                self.add(event.time, event.kind, _told(event.data))
                last = event.id
        self._last_event = (view.path, last)

    def action_search(self) -> None:
        """Into the search."""
        self.query_one(Input).focus()

    def action_leave(self) -> None:
        """Back to the lines."""
        self.query_one(RichLog).focus()

    def action_alarms(self) -> None:
        """Alarms only, or all."""
        self._only_alarms = not self._only_alarms
        self._rewrite()

    def on_input_changed(self) -> None:
        """Search as one types."""
        self._rewrite()

    def on_input_submitted(self) -> None:
        """Back to what was found."""
        self.query_one(RichLog).focus()

    def _rewrite(self) -> None:
        log = self.query_one(RichLog)
        log.clear()
        for line in self._lines:
            self._write(line)
        shown = sum(map(self._wanted, self._lines))
        only = ", alarms only" if self._only_alarms else ""
        self.query_one("#log-line", Static).update(f"{shown} of {len(self._lines)} lines{only}")

    def _wanted(self, line: tuple[str, str, str]) -> bool:
        if self._only_alarms and line[1] not in ALARMS:
            return False
        return self.query_one(Input).value.lower() in " ".join(line).lower()

    def _write(self, line: tuple[str, str, str]) -> None:
        if not self._wanted(line):
            return
        time, kind, told = line
        text = Text()
        text.append(f"{time[11:19]} ", style="dim")
        text.append(f"{'! ' if kind in ALARMS else '  '}{kind:<13} ", style="bold" if kind in ALARMS else "")
        text.append(told)
        self.query_one(RichLog).write(text)


def _told(data: object) -> str:
    if isinstance(data, dict):
        parts = (f"{key}: {value if isinstance(value, str) else json.dumps(value)}" for key, value in data.items())
        return ", ".join(parts)
    return json.dumps(data)
