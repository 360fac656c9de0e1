"""The console: screens, keys, and what passes between them and the threads."""

from __future__ import annotations

import signal
import tomllib
from collections.abc import Callable, Coroutine, Sequence
from contextlib import ExitStack
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Concatenate, ParamSpec

from textual import work
from textual.app import App, ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.events import Resize
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import ContentSwitcher, Footer, Static

from rigctl.console import messages as say
from rigctl.console import state
from rigctl.console.analyses import Analyses
from rigctl.console.campaigns import Campaigns
from rigctl.console.feed import Feed, StoreView
from rigctl.console.help import TEXT
from rigctl.console.holding import Holding
from rigctl.console.log_lines import Search
from rigctl.console.palette import Commands
from rigctl.console.place import kind_of
from rigctl.console.screens.campaign import CampaignPane
from rigctl.console.screens.log import LogPane
from rigctl.console.screens.panes import Panes
from rigctl.console.screens.results import ResultsPane
from rigctl.console.screens.rig import RigPane
from rigctl.console.screens.workbench import WorkbenchPane
from rigctl.console.themes import DARK, LIGHT
from rigctl.console.widgets.bars import SCREENS, Banner, Standing, TabBar, TopBar
from rigctl.console.widgets.dialogs import ConfirmDialog, HelpDialog, OpenDialog, QuestionDialog
from rigctl.core.errors import RigError
from rigctl.core.making_safe import TERMINAL_LOST, Rest, ended_by_signals

if TYPE_CHECKING:
    from rigctl.console.bench import LiveBench

P = ParamSpec("P")

SMALLEST = (80, 24)

DRAW_S = 0.1
FIRST_S = 0.25
"""What is open at the start is opened after the first paint: its imports take seconds."""


def _while_running(tell: Callable[Concatenate[Console, P], None]) -> Callable[Concatenate[Console, P], None]:
    """What threads say while the console closes is not shown: there is nothing left to show it on."""

    @wraps(tell)
    def told(self: Console, /, *args: P.args, **kwargs: P.kwargs) -> None:
        if self.is_running:
            tell(self, *args, **kwargs)

    return told


class Console(App[None]):
    """The operator's console; `directory` is where its state is kept.

    `leave_terminal` is called, in any thread, when the terminal is lost.
    """

    TITLE = "rigctl"
    CSS_PATH = "console.tcss"
    COMMANDS: ClassVar[set[Any]] = {Commands}
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f8,ctrl+x", "stop", "STOP", priority=True, key_display="F8"),
        Binding("f1", "help", "Help", key_display="F1"),
        Binding("o", "open", "Open"),
        Binding("q", "leave", "Quit"),
        Binding("f9", "answer", "Answer", show=False),
        Binding("b", "mute", "Bell", show=False),
        Binding("t", "theme", "Theme", show=False),
        *(
            Binding(f"{number},f{number + 1}", f"screen('{name}')", title, show=False)
            for number, (name, title) in enumerate(SCREENS.items(), 1)
        ),
    ]

    def __init__(
        self,
        place: Path | None = None,
        plugins: Sequence[Path] = (),
        directory: Path | None = None,
        leave_terminal: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__()
        self._leave_terminal = leave_terminal
        self.directory = directory or state.state_directory()
        self.kept = state.load(self.directory)
        self._place = place
        self._feed = Feed(self.post_message)
        self._campaigns = Campaigns(self.post_message)
        self._holding = Holding(self.post_message, self.call_from_thread)
        self._view: StoreView | None = None
        self._panes = Panes(
            RigPane(self.kept.jog_step), CampaignPane(), ResultsPane(), WorkbenchPane(self.kept.covariate), LogPane()
        )
        self._signals = ExitStack()
        self.interrupted = ""
        self.unsafe: list[Rest] = []
        self._alarms = 0
        self._asked: tuple[Path, int] | None = None
        self._analyses = Analyses(self._panes, plugins, self._beside, self._note)
        self._shown_view: StoreView | None = None
        self.register_theme(DARK)
        self.register_theme(LIGHT)
        self.theme = self.kept.theme if self.kept.theme in {DARK.name, LIGHT.name} else DARK.name

    def compose(self) -> ComposeResult:
        """Top line, tabs, banner, the five screens, keys."""
        yield TopBar()
        yield TabBar()
        yield Banner()
        with ContentSwitcher(initial=self.kept.screen):
            yield from vars(self._panes).values()
        yield Static(id="too-small")
        yield Footer(show_command_palette=False, compact=True)

    # Beginning and end

    def on_mount(self) -> None:
        """Draw first, then open what is to be opened."""
        self._feed.start()
        self.set_interval(DRAW_S, self._draw)
        self.action_screen(self.kept.screen)
        self._signals.enter_context(ended_by_signals(self._signalled))
        self.set_timer(FIRST_S, self._open_first)

    def _open_first(self) -> None:
        if not self.is_running:
            return
        if self.kept.notice:
            self._note(self.kept.notice, "warning")
            self.kept.notice = ""
        for path in (
            [self._place] if self._place else [Path(p) for p in (self.kept.rig, self.kept.campaign, self.kept.store)]
        ):
            if path is not None and path.is_file():
                self._open(path)
        self._tell_standing()

    def on_unmount(self) -> None:
        """Leave everything in order: instruments at rest, state kept."""
        self._feed.close()
        self._analyses.close()
        self.make_safe()
        self._keep_state()
        self._signals.close()

    def make_safe(self) -> None:
        """Bring what is held to rest and give it free; who has not confirmed is in `unsafe`. May be called twice."""
        self.unsafe += [rest for rest in self._holding.close() if not rest.confirmed]

    def _signalled(self, reason: str) -> None:
        """On the thread that signals wake: what has to be done needs no screen, which may hang with its terminal."""
        lost = reason == TERMINAL_LOST
        if lost:
            self._leave_terminal()
        self._holding.bring_to_rest()
        if lost:
            self._terminal_lost()
        self.post_message(say.Signalled("" if lost else reason))

    @_while_running
    def on_signalled(self, message: say.Signalled) -> None:
        """Somebody ends this console from outside."""
        self.interrupted = message.reason
        self.exit()

    def _keep_state(self) -> None:
        self.kept.theme = self.theme
        self.kept.jog_step = self._panes.rig.jog_step
        self.kept.covariate = self._panes.workbench.covariate
        state.save(self.directory, self.kept)

    def _terminal_lost(self) -> None:
        """The terminal is gone: the campaign does what its file chose, a rig of ours comes to rest."""
        told = "The terminal was lost"
        if self._holding.bench is not None:
            told += "; the rig was brought to rest"
        view = self._view
        if view is not None and view.alive and self._campaigns.signal(view.path, signal.SIGHUP):
            stops = tomllib.loads(view.campaign_toml).get("on_terminal_lost") == "stop"
            told += f"; the campaign {'was stopped' if stops else 'went on'}, as its file chose ({view.path})"
        elif view is not None and view.alive:
            told += f"; the campaign went on, it was not this console's ({view.path})"
        self.kept.notice = f"{told}, {state.now()}"
        state.record_action(self.directory, told)
        self._keep_state()

    # Opening

    def _open(self, path: Path) -> str:
        """Open a file; returns the screen on which it is seen."""
        if path.suffix != ".toml":
            self._watch(path)
            return self.kept.screen
        try:
            kind, text = kind_of(path)
        except RigError as error:
            self._note(str(error), "error")
            return self.kept.screen
        if kind == "rig":
            self.kept.rig = str(path.absolute())
            self._panes.rig.show_opening(str(path))
            self._holding.take(path)
            return "rig"
        self._show_campaign_file(path, text)
        return "campaign"

    @work(exclusive=True, group="campaign-file")
    async def _show_campaign_file(self, path: Path, text: str) -> None:
        self.kept.campaign = str(path.absolute())
        await self._panes.campaign.show_file(path, text)
        self._tell_standing()

    def _beside(self, group: str, work: Coroutine[Any, Any, None]) -> None:
        self.run_worker(work, group=group, exclusive=group == "dry-run")

    def _watch(self, store: Path) -> None:
        self.kept.store = str(store.absolute())
        self._view = self._shown_view = None
        self._panes.results.clear()
        self._feed.watch(store)

    # Ten times a second

    def _draw(self) -> None:
        """Show what has changed on the screen that is looked at."""
        if not self.is_running:  # on the way out
            return
        self._keep_focus()
        current = self.kept.screen
        bench, view = self._holding.bench, self._view
        held = view is not None and view.alive
        if current == "rig" and bench is not None and not held:
            self._panes.rig.show_bench(bench.views(), bench.strips())
        if view is None:
            return
        if current == "campaign":
            self._analyses.follow(view)
        if view is self._shown_view:
            return
        self._shown_view = view
        if current == "rig" and (held or bench is None):
            self._panes.rig.show_store(view)
        self._panes.campaign.show_store(view)
        self._panes.log.show_store(view)
        self._tell_standing()

    def _tell_standing(self) -> None:
        view = self._view
        file = self._panes.campaign.file
        names = [str(path) for path in (self._holding.rig, view.path if view else file) if path]
        campaign = ""
        if view is not None:
            done, planned = view.status.get("runs_done"), view.status.get("runs_planned")
            campaign = f"{view.state.upper()} {done}/{planned}"
        self._base.query_one(TopBar).standing = Standing(
            " · ".join(names) or "nothing is open", campaign, self._alarms, self.kept.bell
        )

    # What threads tell

    @_while_running
    def on_store_seen(self, message: say.StoreSeen) -> None:
        """The store has changed."""
        before, self._view = self._view, message.view
        ended = before is not None and before.path == message.view.path and before.alive and not message.view.alive
        if before is None or before.path != message.view.path:
            self._analyses.ask(message.view.path, "model", quiet=True)
        if (before is None or ended) and message.view.runs and not message.view.alive:
            self._analyses.ask(message.view.path, "result", quiet=True)
        if ended:
            self._analyses.ask(message.view.path, "model", quiet=True)
            self._note(f"the campaign is {message.view.state}")
        question = message.view.question
        banner = self._base.query_one(Banner)
        if question is None:
            banner.say("")
            self._close_question()
        elif (message.view.path, question.number) != self._asked:
            self._asked = (message.view.path, question.number)
            self._close_question()
            banner.say(f"! OPERATOR: {question.text.partition(' Type ')[0]}  (F9 answers)")
            self.action_ring()
            self.action_answer()

    def _close_question(self) -> None:
        """Somebody else has answered, or the campaign is gone."""
        for screen in list(self.screen_stack):
            if isinstance(screen, QuestionDialog):
                screen.dismiss(None)

    @_while_running
    def on_campaign_ended(self, message: say.CampaignEnded) -> None:
        """A process of ours has ended."""
        if message.status not in {0, 130}:
            self._note(message.said or f"the campaign's process ended with status {message.status}", "error")
        if self._holding.bench is None:
            self._holding.take()

    @_while_running
    def on_bench_taken(self) -> None:
        """It is open, or was refused."""
        self._panes.rig.show_opening("")

    @_while_running
    def on_stopped(self, message: say.Stopped) -> None:
        """What came of a STOP."""
        unsafe = [rest for rest in message.rests if not rest.confirmed]
        told = [f"STOP: {len(unsafe)} NOT CONFIRMED"] if unsafe else ["STOP: all instruments confirmed"]
        told += [str(rest) for rest in sorted(message.rests, key=lambda rest: rest.confirmed)]
        self._note("\n".join(told), "error" if unsafe else "warning")

    @_while_running
    def on_noted(self, message: say.Noted) -> None:
        """Tell the operator."""
        self._note(message.text, message.severity)

    @_while_running
    def _note(self, text: str, severity: say.Severity = "information") -> None:
        self.notify(text, severity=severity, timeout=8, markup=False)
        self._panes.log.add(state.now(), "alarm" if severity == "error" else "note", text)
        if severity == "error":
            self._alarms += 1
            self.action_ring()
            self._tell_standing()

    def _act(self, action: str) -> None:
        """Record what the operator does: here, in the user's file, and in the store it is for."""
        self._panes.log.add(state.now(), "action", action)
        view = self._view
        self._record(action)
        if view is not None and view.alive:
            self._send("add_note", view.path, action, severity="warning")

    @work(thread=True, group="record")
    def _record(self, action: str) -> None:
        state.record_action(self.directory, action)

    # What the operator asks

    def action_stop(self) -> None:
        """STOP: from every screen and dialog, whatever else is going on."""
        view = self._view
        held = self._holding.stop()
        if view is not None and view.alive:
            self._campaigns.signal(view.path, signal.SIGTERM)
            self._send("request", view.path, "abort")
            self._holding.stop_from_outside(view)
        self._act("STOP")
        if not held and (view is None or not view.alive):
            self._note("STOP: no rig is held here, and no campaign runs", "warning")

    def on_stop_button_pressed(self) -> None:
        """By mouse."""
        self.action_stop()

    def on_tab_bar_chosen(self, message: TabBar.Chosen) -> None:
        """By mouse."""
        self.action_screen(message.screen)

    def on_banner_clicked(self) -> None:
        """By mouse."""
        self.action_answer()

    def action_screen(self, name: str) -> None:
        """Show one of the five."""
        if len(self.screen_stack) > 1:
            return
        self._base.query_one(ContentSwitcher).current = name
        self._base.query_one(TabBar).current = name
        self.kept.screen = name  # type: ignore[assignment]
        self._shown_view = None
        self._focus_pane()

    def _focus_pane(self) -> None:
        """Keys belong to the screen that is shown: something on it has to have the focus."""
        for widget in self._pane(self.kept.screen).query("Tabs, DataTable, RichLog").results(Widget):
            if widget.focusable:
                widget.focus()
                break

    def on_descendant_blur(self) -> None:
        """What had the focus may be hidden now."""
        self.call_after_refresh(self._keep_focus)

    def _pane(self, name: str) -> Widget:
        pane: Widget = getattr(self._panes, name)
        return pane

    def _keep_focus(self) -> None:
        if len(self.screen_stack) == 1 and self._base.focused is None:
            self._focus_pane()

    def action_pane(self, name: str, action: str, *arguments: str) -> None:
        """An action of a screen, from the palette."""
        self.action_screen(name)
        getattr(self._pane(name), f"action_{action}")(*arguments)

    def action_help(self) -> None:
        """Keys."""
        self.push_screen(HelpDialog(TEXT))

    def action_open(self) -> None:
        """Ask which file."""

        def go(path: Path | None) -> None:
            if path is not None:
                self._act(f"open {path}")
                self.action_screen(self._open(path))

        near = [
            p
            for pattern in ("*.rig.sqlite", "*.toml", "campaigns/*.toml", "out/*.rig.sqlite")
            for p in sorted(Path().glob(pattern))
        ]
        self.push_screen(OpenDialog("Open a rig file, a campaign file or a store", near), go)

    def action_answer(self) -> None:
        """What the campaign asks."""
        question = self._view.question if self._view else None
        if question is None or any(isinstance(screen, QuestionDialog) for screen in self.screen_stack):
            return
        store = self._view.path if self._view else Path()

        def go(text: str | None) -> None:
            if text is not None:
                self._act(f"answer '{text}' to: {question.text.partition(' Type ')[0]}")
                self._send("answer", store, text, question.number)

        self.push_screen(QuestionDialog(question.number, question.text, question.choices), go)

    def action_ring(self) -> None:
        """Ring, unless the bell is off."""
        if self.kept.bell:
            self.bell()

    def action_mute(self) -> None:
        """On or off."""
        self.kept.bell = not self.kept.bell
        self._tell_standing()

    def action_theme(self) -> None:
        """Light or dark."""
        self.theme = LIGHT.name if self.theme == DARK.name else DARK.name

    def action_bench(self) -> None:
        """Hold the rig."""
        self._holding.take()

    def action_release(self) -> None:
        """Give it free."""
        self._act("release the rig")
        self._holding.give()

    def action_leave(self) -> None:
        """Quit; a campaign goes on."""
        view = self._view
        if view is None or not view.alive:
            self.exit()
            return

        def go(agreed: bool | None) -> None:
            if agreed:
                self.exit()

        told = (
            f"A campaign runs ({view.path}). It goes on without the console; "
            f"`rigctl console {view.path}` attaches to it again."
        )
        self.push_screen(ConfirmDialog("Quit the console?", told), go)

    def on_move_asked(self, message: say.MoveAsked) -> None:
        """Move a stage of the rig that is held."""
        self._drive(
            f"move {message.name} to {message.value:g}", lambda bench: bench.move(message.name, message.value)
        )

    def on_jog_asked(self, message: say.JogAsked) -> None:
        """Move a stage of the rig that is held by a step."""
        self._drive(f"move {message.name} by {message.step:g}", lambda bench: bench.jog(message.name, message.step))

    def on_home_asked(self, message: say.HomeAsked) -> None:
        """Home a stage of the rig that is held."""
        self._drive(f"home {message.name}", lambda bench: bench.home(message.name))

    def _drive(self, action: str, go: Callable[[LiveBench], None]) -> None:
        bench = self._holding.bench
        if bench is None:
            self._note("no rig is held here; the campaign moves it", "warning")
            return
        self._act(action)
        go(bench)

    def on_reconnect_asked(self) -> None:
        """Try again."""
        if self._holding.bench is None:
            self._holding.take()
        else:
            self._holding.bench.reconnect()

    def on_start_asked(self, message: say.StartAsked) -> None:
        """Give the rig free, then start a campaign on it and watch its store."""
        launch = message.launch
        self._act(f"start {launch.campaign} into {launch.store}")

        def go() -> None:
            self._campaigns.start(launch)
            self._watch(launch.store)

        self._holding.give(go)

    def on_dry_run_asked(self, message: say.DryRunAsked) -> None:
        """Have it worked out."""
        self._analyses.dry_run(message.campaign)

    def on_request_asked(self, message: say.RequestAsked) -> None:
        """Pause, resume, abort."""
        view = self._view
        if view is None:
            self._note("no campaign is watched; o opens a store", "warning")
            return
        self._act(f"{message.kind} {view.path}")
        if message.kind == "resume" and not view.alive:
            self._holding.give(lambda: self._campaigns.resume(view.path))
            return
        self._send("request", view.path, message.kind)

    @work(thread=True, group="send")
    def _send(self, what: str, *arguments: Any, severity: say.Severity = "error") -> None:
        """A function of `rigctl.campaign.session.requests`; stores are imported after the first paint."""
        from rigctl.campaign.session import requests

        try:
            getattr(requests, what)(*arguments)
        except RigError as error:
            self.post_message(say.Noted(str(error), severity))

    def on_analysis_asked(self, message: say.AnalysisAsked) -> None:
        """Have something worked out from the store that is open."""
        if self._view is None:
            self._note("open a store first: o", "warning")
            return
        if message.what in {"add", "remove"}:
            self._act(f"model {message.what} {' '.join(message.arguments[0])}")
        self._analyses.ask(self._view.path, message.what, *message.arguments)

    def on_search_asked(self, message: say.SearchAsked) -> None:
        """Go through the whole store, unless all of it is on the screen."""
        view, log = self._view, self._panes.log
        if view is not None and log.first_event > 1:
            self._find(view.path, message.search, log.first_event)

    @work(thread=True, exclusive=True, group="search")
    def _find(self, store: Path, search: Search, before: int) -> None:
        from rigctl.console.store_watch import earlier  # stores are imported after the first paint

        try:
            found = earlier(store, search, before)
        except RigError as error:
            self.post_message(say.Noted(str(error), "error"))
        else:
            self.post_message(say.EarlierFound(search, found))

    @_while_running
    def on_earlier_found(self, message: say.EarlierFound) -> None:
        """Show it above what is kept."""
        self._panes.log.show_earlier(message.search, message.lines)

    def on_resize(self, event: Resize) -> None:
        """A terminal that is too small says so."""
        width, height = event.size
        small = width < SMALLEST[0] or height < SMALLEST[1]
        self._base.set_class(small, "too-small")
        told = (
            f"This terminal has {width} x {height}; the console needs {SMALLEST[0]} x {SMALLEST[1]}.\n"
            "F8 still stops everything."
        )
        self._base.query_one("#too-small", Static).update(told)

    def get_system_commands(self, screen: Screen[Any]) -> Any:
        """Ours are complete."""
        del screen
        empty: list[SystemCommand] = []
        return iter(empty)

    @property
    def _base(self) -> Screen[Any]:
        """The screens are below whatever dialog is open."""
        return self.screen_stack[0]
