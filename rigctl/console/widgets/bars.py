"""What every screen has: the state and STOP on top, and what the operator must not miss."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from rich.console import Console as RichConsole
from rich.console import ConsoleOptions
from rich.style import Style
from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.events import Click
from textual.reactive import reactive
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Static

SCREENS = {"rig": "Rig", "campaign": "Campaign", "results": "Results", "workbench": "Workbench", "log": "Log"}


class StopButton(Static):
    """The STOP, for the mouse; F8 is its key."""

    DEFAULT_CSS = "StopButton { width: 11; text-style: bold; background: $error; color: $stop-text; }"

    def __init__(self) -> None:
        super().__init__(" ■ STOP F8 ", id="stop")

    async def on_click(self, event: Click) -> None:
        """STOP."""
        event.stop()
        await self.app.run_action("stop")


@dataclass(frozen=True)
class Standing:
    """What the top line says."""

    name: str = "nothing is open"
    campaign: str = ""
    alarms: int = 0
    bell: bool = True


class TopBar(Horizontal):
    """One line: what is open, how the campaign stands, alarms, STOP."""

    DEFAULT_CSS = "TopBar { height: 1; background: $panel; } TopBar #standing { width: 1fr; }"
    standing = reactive(Standing())

    def compose(self) -> ComposeResult:
        """A line of text and the button."""
        yield Static(id="standing")
        yield StopButton()

    def watch_standing(self, standing: Standing) -> None:
        """Say it."""
        if not self.is_mounted:
            return
        alarms = f" ! {standing.alarms} alarm{'s' if standing.alarms != 1 else ''}" if standing.alarms else ""
        bell = "" if standing.bell else " bell off"
        right = f"{standing.campaign}{alarms}{bell} "
        room = max(self.size.width - 12 - len(right), 8)
        # A space before what follows it.
        name = standing.name if len(standing.name) <= room - 2 else standing.name[: room - 3] + "…"
        text = Text(f" {name:<{room - 1}}", no_wrap=True)
        text.append(standing.campaign, style="bold")
        text.append(alarms, style="bold reverse" if alarms else "")
        text.append(bell, style="dim")
        self.query_one("#standing", Static).update(text)

    def on_resize(self) -> None:
        """The room has changed."""
        self.watch_standing(self.standing)


class TabBar(Horizontal):
    """The five screens; the one that is shown is in brackets as well as coloured."""

    DEFAULT_CSS = "TabBar { height: 1; } TabBar Static { width: auto; }"
    current = reactive("rig")

    def compose(self) -> ComposeResult:
        """One label each."""
        for name in SCREENS:
            yield Static(self._label(name), id=f"tab-{name}")

    def watch_current(self, before: str, current: str) -> None:
        """Mark it."""
        for name in {before, current} if self.is_mounted else ():
            # As wide as it was.
            self.query_one(f"#tab-{name}", Static).update(self._label(name), layout=False)

    def _label(self, name: str) -> Text:
        number, title = list(SCREENS).index(name) + 1, SCREENS[name]
        shown = name == self.current
        return Text(f"[{number} {title}]" if shown else f" {number} {title} ", style="bold reverse" if shown else "")

    async def on_click(self, event: Click) -> None:
        """Show the screen that was clicked."""
        name = (event.widget.id or "").removeprefix("tab-") if event.widget is not None else ""
        if name in SCREENS:
            await self.app.run_action(f"screen('{name}')")


ALARM_ROWS = 6
"""A screen of 24 rows has no more for alarms."""


class _Alarms:
    """Alarms whole where they fit, else a row each; what is beyond is counted, never left out without a word."""

    def __init__(self, lines: Sequence[str]) -> None:
        self._lines = lines

    def __rich_console__(self, console: RichConsole, options: ConsoleOptions) -> Iterator[Text]:
        told = [Text(f"! {line}", style="bold") for line in self._lines]
        if sum(len(each.wrap(console, options.max_width)) for each in told) > ALARM_ROWS:
            if len(told) > ALARM_ROWS:
                beyond = len(told) - (ALARM_ROWS - 1)
                told = [*told[: ALARM_ROWS - 1], Text(f"! and {beyond} more: 5 has all", style="bold")]
            for each in told:
                each.truncate(options.max_width, overflow="ellipsis")
        yield from told


class AlarmStrip(Static):
    """A line for each thing that needs the operator, as long as it is so; not there when there is nothing."""

    DEFAULT_CSS = """
    AlarmStrip { height: auto; display: none; background: $warning; color: $stop-text; }
    AlarmStrip.shown { display: block; }
    """

    def __init__(self) -> None:
        super().__init__()
        self._lines: tuple[str, ...] = ()

    def say(self, lines: Sequence[str]) -> None:
        """Show these."""
        if tuple(lines) == self._lines:
            return
        self._lines = tuple(lines)
        self.set_class(bool(lines), "shown")
        self.update(_Alarms(self._lines))

    async def on_click(self) -> None:
        """Deal with what is asked."""
        await self.app.run_action("answer")


class Telling(Static):
    """What is being worked out, and for a while the last thing that was told; not there when there is nothing."""

    DEFAULT_CSS = """
    Telling { height: auto; max-height: 4; display: none; background: $panel; }
    Telling.shown { display: block; }
    """

    def __init__(self) -> None:
        super().__init__()
        self._text = Text()

    def say(self, text: Text) -> None:
        """Show this; an empty one hides it."""
        if text == self._text:
            return
        self._text = text
        self.set_class(bool(text.plain), "shown")
        self.update(text)


class KeyBar(Widget):
    """One line: the keys that do something where the focus is; a click on one is as good as pressing it.

    Textual's own footer has a widget for each key, made anew whenever the focus changes.
    """

    DEFAULT_CSS = """
    KeyBar { height: 1; dock: bottom; background: $footer-background; }
    KeyBar > .key-bar--key { color: $footer-key-foreground; background: $footer-background; text-style: bold; }
    """
    COMPONENT_CLASSES: ClassVar[set[str]] = {"key-bar--key"}

    def __init__(self) -> None:
        super().__init__()
        self._keys: list[tuple[str, str, str]] = []

    def on_mount(self) -> None:
        """Hear of keys that come and go."""
        self.screen.bindings_updated_signal.subscribe(self, self._look)

    def _look(self, screen: Screen[Any]) -> None:
        if screen is not self.screen:  # a dialog's
            return
        shown = [binding for _, binding, _, _ in screen.active_bindings.values() if binding.show]
        # Of several keys for one action the first.
        first = {binding.action: binding for binding in reversed(shown)}
        keys = [(each.key, self.app.get_key_display(each), each.description) for each in reversed(first.values())]
        if keys != self._keys:
            self._keys = keys
            self.refresh()

    def render(self) -> Text:
        """Each key and what it does."""
        style = self.get_component_rich_style("key-bar--key")
        line = Text(no_wrap=True, overflow="ellipsis")
        for key, shown, description in self._keys:
            press = Style(meta={"key": key})
            line.append(shown, style + press).append(f" {description}", press).append(" ")
        return line

    def on_click(self, event: Click) -> None:
        """Press the key that was clicked."""
        if key := event.style.meta.get("key"):
            self.app.simulate_key(key)
