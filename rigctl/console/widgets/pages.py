"""Pages of a screen under a line of their names: one is shown. The same two keys go through them on every screen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Click
from textual.widget import Widget
from textual.widgets import Static


class Page(Vertical):
    """What is seen under one name."""

    DEFAULT_CSS = "Page { height: 1fr; }"

    def __init__(self, title: str, *children: Widget, id: str) -> None:  # noqa: A002
        super().__init__(*children, id=id)
        self.title = title

    def rest(self) -> Widget | None:
        """What has the focus when this page comes up; None where nothing on it can have it."""
        return next((each for each in self.query("*").results(Widget) if each.focusable), None)


class Names(Static):
    """The line of names."""

    DEFAULT_CSS = "Names { height: 1; width: 1fr; text-wrap: nowrap; color: $text-muted; background: $surface; }"


class Pages(Vertical, can_focus=True):
    """Several pages; `active` is the id of the one that is shown. Nothing but the operator's key changes it."""

    DEFAULT_CSS = "Pages { height: 1fr; }"

    def __init__(self, *pages: Page, id: str) -> None:  # noqa: A002
        super().__init__(id=id)
        self._pages = list(pages)
        self.active = pages[0].id or ""
        self._names = Names()

    def compose(self) -> ComposeResult:
        """Names, then all pages, one of them to be seen."""
        yield self._names
        yield from self._pages

    def on_mount(self) -> None:
        """Show the first."""
        self.show(self.active)

    def show(self, name: str) -> None:
        """Show the page with this id; one that is not there leaves what is shown."""
        if name in {page.id for page in self._pages}:
            self.active = name
        for page in self._pages:
            page.display = page.id == self.active
        self._names.update(self._line())

    def step(self, by: int) -> None:
        """Show the next page, or the one before."""
        ids = [page.id or "" for page in self._pages]
        self.show(ids[(ids.index(self.active) + by) % len(ids)])

    def rest(self) -> Widget:
        """What has the focus while nothing else is asked for."""
        page = next(page for page in self._pages if page.id == self.active)
        return page.rest() or self

    async def replace(self, pages: Sequence[Page], kept: Sequence[str] = ()) -> None:
        """Other pages before those that are `kept`; the one that is shown stays, where there still is one."""
        stay = [page for page in self._pages if page.id in kept]
        for page in self._pages:
            if page not in stay:
                await page.remove()
        # Keys come while pages are mounted: what is active is always one of them.
        self._pages = [*pages, *stay]
        ids = [page.id for page in self._pages]
        self.active = self.active if self.active in ids else str(ids[0])
        await self.mount_all(pages, after=self._names)
        self.show(self.active)

    def _line(self) -> Text:
        line = Text()
        for page in self._pages:
            shown = page.id == self.active
            line.append(f"[{page.title}]" if shown else f" {page.title} ", style="bold" if shown else "")
        line.append("  , . change", style="dim")
        return line

    async def on_click(self, event: Click) -> None:
        """Show the page whose name was clicked."""
        if event.widget is not self._names:
            return
        place = 0
        for page in self._pages:
            width = len(page.title) + 2
            if place <= event.x < place + width:
                await self.app.run_action(f"page('{page.id}')")
                return
            place += width


def pages_of(pane: Widget) -> Pages | None:
    """The pages of a screen, if it has some."""
    found: Any = pane.query(Pages)
    return found.first() if found else None
