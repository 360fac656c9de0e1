"""Screen 5: everything that happened, searchable; alarms; every action of the operator."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widget import Widget
from textual.widgets import Input, RichLog, Static

from rigctl.console.log_lines import LogLine, Search, lines_of
from rigctl.console.messages import SearchAsked
from rigctl.console.store_view import StoreView

KEPT = 2000
SHOWN = 300
"""So many are written at once, the newest: who looks for another searches."""


class LogPane(Vertical):
    """One line per event, the newest at the end."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "search", "Search", key_display="/"),
        Binding("w", "alarms", "Alarms only"),
    ]

    def __init__(self) -> None:
        super().__init__(id="log")
        self.search = Search()
        self._lines: deque[LogLine] = deque(maxlen=KEPT)
        self._earlier: list[LogLine] = []
        self._store: Path | None = None
        self._last_event = 0
        self._unseen: list[LogLine] = []
        self._width = 0

    def compose(self) -> ComposeResult:
        """Search on top, lines below."""
        yield Input(placeholder="/ search: kind or text", compact=True, id="search")
        yield Static("", id="log-line")
        yield RichLog(id="events", max_lines=KEPT, wrap=True, auto_scroll=True, min_width=20)

    def add(self, time: str, kind: str, text: str) -> None:
        """Something happened in this console: an action, a note, an alarm."""
        self._append([LogLine(time, kind, text)])

    def show_store(self, view: StoreView) -> None:
        """Events of the store that have not been shown."""
        if self._store != view.path:
            self._store, self._last_event, self._earlier = view.path, 0, []
        fresh = lines_of(event for event in view.events if event.id > self._last_event)
        if fresh:
            self._last_event = fresh[-1].event
            self._append(fresh)

    def show_earlier(self, search: Search, lines: Sequence[LogLine]) -> None:
        """What a search has found among the events of the store that are not kept here."""
        if search == self.search:
            self._earlier = list(lines)
            self._rewrite()

    @property
    def first_event(self) -> int:
        """The number of the first event of the store that is kept here; beyond the last one without any."""
        return next((line.event for line in self._lines if line.event), self._last_event + 1)

    def action_search(self) -> None:
        """Into the search."""
        self.screen.set_focus(self.query_one(Input))

    def rest(self) -> Widget:
        """Where the focus is while nothing is searched."""
        return self.query_one(RichLog)

    def action_alarms(self) -> None:
        """Alarms only, or all."""
        self._look_for(Search(self.search.words, not self.search.only_alarms))

    def on_input_changed(self, event: Input.Changed) -> None:
        """Search as one types."""
        self._look_for(Search(event.value, self.search.only_alarms))

    def on_input_submitted(self) -> None:
        """Back to what was found."""
        self.screen.set_focus(self.rest())

    def _look_for(self, search: Search) -> None:
        self.search, self._earlier = search, []
        # What is kept here at once; what lies further back comes when the store has been gone through.
        self._rewrite()
        if search != Search():
            self.post_message(SearchAsked(search))

    def _append(self, lines: Sequence[LogLine]) -> None:
        self._lines.extend(lines)
        self._write(line for line in lines if self.search.finds(line))

    def on_show(self) -> None:
        """Another screen was shown before."""
        self.call_after_refresh(self._fit)

    def on_resize(self) -> None:
        """The terminal has another size."""
        self.call_after_refresh(self._fit)

    def _fit(self) -> None:
        """Write what came while nothing was seen; all of it anew where lines are wrapped to another width."""
        width = self._seen_width()
        if width and self._width and width != self._width:
            self._rewrite()
        elif width:
            unseen, self._unseen = self._unseen, []
            self._write(unseen)

    def _seen_width(self) -> int:
        """To which lines are wrapped; 0 while another screen is shown."""
        log = self.query_one(RichLog)
        # Its scrollbar is always there, but not yet when the screen has just been shown.
        return max(log.region.width - log.styles.gutter.width - log.styles.scrollbar_size_vertical, 0)

    def _rewrite(self) -> None:
        self._unseen = []
        self.query_one(RichLog).clear()
        lines = [*self._earlier, *(line for line in self._lines if self.search.finds(line))]
        self._write(lines)
        newest = f", the newest {SHOWN} are shown" if len(lines) > SHOWN else ""
        only = ", alarms only" if self.search.only_alarms else ""
        count = f"{len(lines)} lines{only}{newest}" if self.search != Search() else ""
        self.query_one("#log-line", Static).update(count)

    def _write(self, lines: Iterable[LogLine]) -> None:
        newest, width = list(lines)[-SHOWN:], self._seen_width()
        if not width:
            # On another screen nobody knows yet to which width lines will be wrapped.
            self._unseen = [*self._unseen, *newest][-SHOWN:]
            return
        self._width = width
        if newest:  # all at once: line by line it takes several times as long
            self.query_one(RichLog).write(Text("\n").join(map(_shown, newest)), width=width)


def _shown(line: LogLine) -> Text:
    text = Text()
    text.append(f"{line.time[11:19]} ", style="dim")
    text.append(f"{'! ' if line.alarm else '  '}{line.kind:<13} ", style="bold" if line.alarm else "")
    text.append(line.text)
    return text
