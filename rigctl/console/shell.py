"""What the operator sees of the console: five screens, what is looked at on them, and what is told on all."""

from __future__ import annotations

import gc
from collections.abc import Callable, Coroutine, Sequence
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from textual import work
from textual.app import App, ComposeResult
from textual.command import CommandPalette
from textual.events import Resize
from textual.reactive import Reactive
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import ContentSwitcher, Static

from rigctl.console import messages as say
from rigctl.console import state
from rigctl.console.campaigns import Campaigns, last_line
from rigctl.console.feed import Feed
from rigctl.console.help import COMMANDS, text_for
from rigctl.console.holding import Holding
from rigctl.console.log_lines import Search
from rigctl.console.store_view import StoreView
from rigctl.console.telling import Bell, Notes
from rigctl.console.terminal import TerminalDriver
from rigctl.console.themes import DARK, THEMES
from rigctl.console.typed import OrderedKeys
from rigctl.console.widgets.bars import AlarmStrip, KeyBar, Standing, TabBar, Telling, TopBar
from rigctl.console.widgets.pages import pages_of
from rigctl.core.clock import utc_now
from rigctl.core.errors import RigError
from rigctl.core.making_safe import Rest

if TYPE_CHECKING:
    from rigctl.campaign.session.questions import Question
    from rigctl.console.alarms import Alarm
    from rigctl.console.analyses import Analyses
    from rigctl.console.asking import Asking
    from rigctl.console.screens.panes import Panes

P = ParamSpec("P")
Window = TypeVar("Window", bound=App[None])

SMALLEST = (80, 24)


class Base(Screen[None]):
    """What lies under all dialogs. Where the focus goes is drawn by the two widgets concerned, not by all of them."""

    focused: Reactive[Widget | None] = Reactive(None, repaint=False)


def while_running(show: Callable[Concatenate[Window, P], None]) -> Callable[Concatenate[Window, P], None]:
    """What threads say while the console closes is not shown: there is nothing left to show it on."""

    @wraps(show)
    def shown(self: Window, /, *args: P.args, **kwargs: P.kwargs) -> None:
        if self.is_running:
            show(self, *args, **kwargs)

    return shown


class Shell(OrderedKeys):
    """The screens of the console; `directory` is where its state is kept.

    The frame is painted first: what the screens are made of takes longer to import. Keys wait for them.
    """

    TITLE = "rigctl"
    CSS_PATH = "console.tcss"
    AT_ONCE = frozenset({"f8", "ctrl+x"})
    _panes: Panes
    _analyses: Analyses
    _asking: Asking

    def __init__(self, plugins: Sequence[Path], directory: Path | None) -> None:
        super().__init__()
        self.keys_wait = True
        # What the terminal itself sends is read by the driver; a console without one has none.
        self.driver_class = TerminalDriver
        self.directory = directory or state.state_directory()
        self.kept = state.load(self.directory)
        self._plugins = plugins
        self._view: StoreView | None = None
        self._shown_view: StoreView | None = None
        self._drawn: set[str] = set()
        self._holding = Holding(self.post_message, self.call_from_thread)
        self._feed = Feed(self.post_message)
        self._campaigns = Campaigns(self.post_message)
        self._alarms = 0
        self._notes = Notes()
        self._bell = Bell(lambda: self.action_ring())
        self._unsafe: dict[str, Rest] = {}
        self._titled = ""
        for theme in THEMES.values():
            self.register_theme(theme)
        self._begin_in(self.kept.theme if self.kept.theme in THEMES else DARK.name)

    def _begin_in(self, theme: str) -> None:
        """Have a theme from the beginning; one that is set has all styles read twice before the first paint."""
        self.set_reactive(Shell.theme, theme)
        self.stylesheet.set_variables(self.get_css_variables())
        dark = self.current_theme.dark
        self.update_classes({"-dark-mode": dark, "-light-mode": not dark, f"-theme-{theme}": True}, update=False)

    def get_default_screen(self) -> Screen[None]:
        """The one under all dialogs."""
        return Base(id="_default")

    def compose(self) -> ComposeResult:
        """The frame: top line, tabs, alarms, where the screens will be, what is told, keys."""
        yield TopBar()
        yield TabBar()
        yield AlarmStrip()
        yield ContentSwitcher()
        yield Telling()
        yield Static(id="too-small")
        yield KeyBar()

    async def furnish(self) -> None:
        """Put the five screens into the frame."""
        from rigctl.console.analyses import Analyses
        from rigctl.console.asking import Asking
        from rigctl.console.screens.panes import panes_as_left

        self._panes = panes_as_left(self.kept)
        self._analyses = Analyses(self._panes, self._plugins, self._beside, self._note)
        self._asking = Asking(self, self._answer)
        self.stylesheet.read(Path(__file__).with_name("screens") / "screens.tcss")
        switcher, screens = self._base.query_one(ContentSwitcher), vars(self._panes).values()
        for screen in screens:
            screen.display = False
        await switcher.mount_all(screens)
        # What is there now stays: a full collection, which walks through all of it, would hold a key up for 0.1 s.
        gc.freeze()
        gc.enable()

    # Screens

    def action_screen(self, name: str) -> None:
        """Show one of the five."""
        # Below a dialog nothing changes, or it would ask about something that is no longer shown.
        if len(self.screen_stack) > 1:
            return
        self._base.query_one(ContentSwitcher).current = name
        self._base.query_one(TabBar).current = name
        self.kept.screen = name
        self._focus_pane()
        # With the screen, and not a tenth of a second after it: what is laid out once is painted once.
        self._draw()

    def _focus_pane(self) -> None:
        """Keys belong to the screen that is shown: something on it has to have the focus, before the next key."""
        pane = self._pane(self.kept.screen)
        # Not `focus`, which waits for the next turn.
        self._base.set_focus(pane.rest())

    def action_rest(self) -> None:
        """Leave whatever has been begun: an entry, a search, a cursor."""
        self._notes.forget()
        self._focus_pane()

    def action_step_page(self, by: int) -> None:
        """The next page of this screen, or the one before."""
        if (pages := pages_of(self._pane(self.kept.screen))) is not None:
            pages.step(by)
            self._turned()

    def action_page(self, name: str) -> None:
        """A page of this screen."""
        if (pages := pages_of(self._pane(self.kept.screen))) is not None:
            pages.show(name)
            self._turned()

    def _turned(self) -> None:
        self._drawn.discard(self.kept.screen)
        self._focus_pane()
        self._draw()

    def _pane(self, name: str) -> Any:
        return getattr(self._panes, name)

    def _keep_focus(self) -> None:
        if len(self.screen_stack) == 1 and self._base.focused is None:
            self._focus_pane()

    def action_pane(self, name: str, action: str, *arguments: str) -> None:
        """An action of a screen, from the palette."""
        self.action_screen(name)
        getattr(self._pane(name), f"action_{action}")(*arguments)

    def action_help(self) -> None:
        """Keys, those of this screen first."""
        from rigctl.console.widgets.dialogs import HelpDialog  # after the first paint

        self.push_screen(HelpDialog(text_for(self.kept.screen)))

    def on_resize(self, event: Resize) -> None:
        """A terminal that is too small says so."""
        width, height = event.size
        small = width < SMALLEST[0] or height < SMALLEST[1]
        self._base.set_class(small, "too-small")
        text = (
            f"This terminal has {width} x {height}; the console needs {SMALLEST[0]} x {SMALLEST[1]}.\n"
            "F8 still stops everything."
        )
        self._base.query_one("#too-small", Static).update(text)

    def action_command_palette(self) -> None:
        """Everything by name."""
        if not isinstance(self.screen, CommandPalette):
            self.search_commands(
                [(name, partial(self.run_action, action), text) for name, (action, text) in COMMANDS.items()]
            )

    def action_ring(self) -> None:
        """Ring, unless the bell is off."""
        if self.kept.bell:
            self.bell()

    def action_mute(self) -> None:
        """On or off."""
        self.kept.bell = not self.kept.bell
        self._tell_standing()

    def action_theme(self) -> None:
        """The next of them."""
        names = list(THEMES)
        self.theme = names[(names.index(self.theme) + 1) % len(names)]

    # Ten times a second

    def _draw(self) -> None:
        """Show what has changed on the screen that is looked at."""
        if not self.is_running:  # on the way out
            return
        self._keep_focus()
        self._tell_alarms()
        current = self.kept.screen
        bench, view, vitals = self._holding.bench, self._view, self._feed.vitals
        held = view is not None and view.alive
        # A campaign that holds the rig is asked for it by its store; our own bench is closed then.
        if current == "rig" and bench is not None and not held:
            self._panes.rig.show_bench(bench.views(), bench.strips())
        self._tell_standing()
        if view is None:
            if current == "rig" and bench is None:
                # Values of a rig that is no longer held are those of a moment ago, whatever their age said then.
                self._panes.rig.show_bench((), {})
            return
        # Of a campaign that runs on every screen: a run that is far from the model is an alarm.
        if current == "campaign" or held:
            self._analyses.follow(view)
        if current == "campaign":
            self._panes.campaign.show_vitals(vitals)
        if current == "rig" and view is self._shown_view and (held or bench is None):
            self._panes.rig.show_ages(view)
        self._draw_store(current, view)

    def _draw_store(self, current: str, view: StoreView) -> None:
        """What the store tells, on the screen that is looked at and on those that may fall behind."""
        fresh = view is not self._shown_view
        if fresh:
            self._shown_view, self._drawn = view, set()
            self._panes.log.show_store(view)
        # A screen that was not looked at while the store changed is drawn when it is.
        ours = current == "rig" and not view.alive and self._holding.bench is not None
        if current not in self._drawn and not ours:
            self._drawn.add(current)
            if current == "rig":
                self._panes.rig.show_store(view)
        elif not fresh:
            return
        if fresh or current == "campaign":
            self._panes.campaign.show_store(view)

    def _tell_alarms(self) -> None:
        """What is wrong now, and what is being worked out."""
        from rigctl.console.alarms import alarms_of  # after the first paint

        bench, view = self._holding.bench, self._view
        views = bench.views() if bench is not None else ()
        far = self._analyses.far(view.path) if view is not None and view.alive else ()
        alarms = alarms_of(view, self._feed.vitals, views, self._unsafe.values(), far)
        self._base.query_one(AlarmStrip).say([alarm.text for alarm in alarms])
        self._base.query_one(Telling).say(self._notes.text([*self._analyses.jobs(), *self._investigated()]))
        self._bell.hear(alarms)
        self._asking.show(view)
        self._entitle(alarms)

    def _investigated(self) -> list[str]:
        """What an investigation that was started here is at, while it measures nothing."""
        view = self._view
        if view is None or view.alive or not self._campaigns.investigates(view.path):
            return []
        return [f"investigation of {view.path.name}: {last_line(view.path)}"]

    def _entitle(self, alarms: Sequence[Alarm]) -> None:
        """The terminal's title says what a window that is not looked at should say."""
        title = " ".join(filter(None, ["rigctl", self._campaign_told(), "!" if alarms else ""]))
        if title != self._titled and self._driver is not None and not self.is_headless:
            self._titled = title
            self._driver.write(f"\x1b]2;{title}\x07")

    # What the operator is told

    @while_running
    def on_noted(self, message: say.Noted) -> None:
        """Tell the operator."""
        self._note(message.text, message.severity)

    @while_running
    def _note(self, text: str, severity: say.Severity = "information") -> None:
        self._notes.tell(text, severity)
        self._panes.log.add(utc_now(), "alarm" if severity == "error" else "note", text)
        if severity == "error":
            self._alarms += 1
            self.action_ring()

    def _tell_standing(self) -> None:
        view = self._view
        file = self._panes.campaign.file
        held = f"{self._holding.rig} held" if self._holding.bench is not None else ""
        names = [held, str(view.path if view else file or "")]
        self._base.query_one(TopBar).standing = Standing(
            " · ".join(filter(None, names)) or "nothing is open", self._campaign_told(), self._alarms, self.kept.bell
        )

    def _campaign_told(self) -> str:
        view, vitals = self._view, self._feed.vitals
        if view is None:
            return ""
        stalled = vitals is not None and vitals.path == view.path and vitals.stalled
        state = "STALLED" if stalled else view.state.upper()
        return f"{state} {view.status.get('runs_done')}/{view.status.get('runs_planned')}"

    def _keep_state(self) -> None:
        self.kept.theme = self.theme
        if not self.keys_wait:  # the screens are there
            self.kept.jog_step = self._panes.rig.jog_step
            self.kept.covariate = self._panes.workbench.covariate
        state.save(self.directory, self.kept)

    @property
    def _base(self) -> Screen[Any]:
        """The screens are below whatever dialog is open."""
        return self.screen_stack[0]

    def _beside(self, group: str, work: Coroutine[Any, Any, None]) -> None:
        """Have it done while keys are read; of what concerns a file only the last."""
        self.run_worker(self._unless_leaving(work), group=group, exclusive=group in {"dry-run", "campaign-file"})

    async def _unless_leaving(self, work: Coroutine[Any, Any, None]) -> None:
        """On the way out widgets go one by one: what comes too late to be shown may find any of them missing."""
        try:
            await work
        except Exception:
            if self.is_running:
                raise

    def action_answer(self) -> None:
        """What the campaign asks."""
        self._asking.ask(self._view)

    def _answer(self, store: Path, question: Question, text: str) -> None:
        self._act(f"answer '{text}' to: {question.text.partition(' Type ')[0]}")
        # With its number: the campaign may ask something else by the time the word is written.
        self._send("answer", store, text, question.number)

    # What is kept, and searched

    def _act(self, action: str) -> None:
        """Record what the operator does: here, in the user's file, and in the store it is for."""
        self._panes.log.add(utc_now(), "action", action)
        view = self._view
        self._record(action)
        if view is not None and view.alive:
            self._send("add_note", view.path, action, severity="warning")

    @work(thread=True, group="record")
    def _record(self, action: str) -> None:
        state.record_action(self.directory, action)

    @work(thread=True, group="send")
    def _send(self, what: str, *arguments: Any, severity: say.Severity = "error") -> None:
        """A function of `rigctl.campaign.session.requests`; stores are imported after the first paint."""
        from rigctl.campaign.session import requests

        try:
            getattr(requests, what)(*arguments)
        except RigError as error:
            self.post_message(say.Noted(str(error), severity))

    def on_search_asked(self, message: say.SearchAsked) -> None:
        """Go through the whole store, unless all of it is on the screen."""
        view, log = self._view, self._panes.log
        if view is not None and log.first_event > 1:
            self._find(view.path, message.search, log.first_event)

    @work(thread=True, exclusive=True, group="search")
    def _find(self, store: Path, search: Search, before: int) -> None:
        from rigctl.console.store_watch import earlier  # stores are imported after the first paint

        try:
            lines = earlier(store, search, before)
        except RigError as error:
            self.post_message(say.Noted(str(error), "error"))
        else:
            self.post_message(say.EarlierFound(search, lines))

    @while_running
    def on_earlier_found(self, message: say.EarlierFound) -> None:
        """Show it above what is kept."""
        self._panes.log.show_earlier(message.search, message.lines)
