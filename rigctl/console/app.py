"""The console: what the operator asks for, and what passes between screens and threads."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding, BindingType

from rigctl.console import messages as say
from rigctl.console import state
from rigctl.console.campaigns import log_of
from rigctl.console.place import kind_of, require_store
from rigctl.console.shell import Shell, while_running
from rigctl.console.titles import openable, title_of, with_opened
from rigctl.console.widgets.bars import SCREENS
from rigctl.console.writing import KINDS, look_at, proposed, refusal
from rigctl.core.clock import utc_now
from rigctl.core.errors import RigError
from rigctl.core.making_safe import STOP_SIGNAL, TERMINAL_LOST, Rest, ended_by_signals

DRAW_S = 0.1


class Console(Shell):
    """The operator's console; `directory` is where its state is kept.

    `leave_terminal` is called, in any thread, when the terminal is lost.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        # Before whatever has the focus: it stops also from a dialog or an entry.
        Binding("f8,ctrl+x", "stop", "STOP", priority=True, key_display="F8"),
        Binding("f1", "help", "Help", key_display="F1"),
        Binding("o", "open", "Open"),
        Binding("q", "leave", "Quit"),
        Binding("f9", "answer", "Answer", show=False),
        Binding("escape", "rest", "Leave", show=False),
        Binding("full_stop", "step_page(1)", "Page", show=False),
        Binding("comma", "step_page(-1)", "Page back", show=False),
        Binding("u", "undo", "Undo", show=False),
        Binding("k", "cancel", "Cancel", show=False),
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
        super().__init__(plugins, directory)
        self._leave_terminal = leave_terminal
        self._place = place
        self._stop_owed = False
        self._opening: Path | None = None
        self._signals = ExitStack()
        self.interrupted = ""
        self.unsafe: list[Rest] = []

    # Beginning and end

    def on_mount(self) -> None:
        """Draw first."""
        # Textual's own handlers are in place by now.
        self._signals.enter_context(ended_by_signals(self._signalled))
        self.screen.call_after_refresh(lambda: self._beside("screens", self._begin()))

    async def _begin(self) -> None:
        """The screens, then what is to be opened."""
        # Nothing of it is drawn before all of it is there.
        with self.batch_update():
            await self.furnish()
            self._feed.start()
            self.set_interval(DRAW_S, self._draw)
            self.action_screen(self.kept.screen)
            self.take_keys()
        self.call_later(self._open_first)

    def _open_first(self) -> None:
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
        # Threads first, which would post to a screen that is gone; signals last, as they stop instruments until then.
        self._feed.close()
        if not self.keys_wait:  # the screens are there
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
            # First: whatever is written to a lost terminal waits for ever.
            self._leave_terminal()
        # Before anything is told: this thread is the one that stops.
        self._holding.bring_to_rest()
        if lost:
            self._terminal_lost()
        self.post_message(say.Signalled("" if lost else reason))

    @while_running
    def on_signalled(self, message: say.Signalled) -> None:
        """Somebody ends this console from outside."""
        self.interrupted = message.reason
        self.exit()

    def _terminal_lost(self) -> None:
        """The terminal is gone: the campaign does what its file chose, a rig of ours comes to rest."""
        from rigctl.console.readings import toml_of  # with what instruments are, after the first paint

        notice = "The terminal was lost"
        if self._holding.bench is not None:
            notice += "; the rig was brought to rest"
        view = self._view
        # Only to a campaign of our own; another's terminal may be there still.
        if view is not None and view.alive and self._campaigns.signal(view.path, signal.SIGHUP):
            stops = toml_of(view.campaign_toml).get("on_terminal_lost") == "stop"
            notice += f"; the campaign {'was stopped' if stops else 'went on'}, as its file chose ({view.path})"
        elif view is not None and view.alive:
            notice += f"; the campaign went on, it was not this console's ({view.path})"
        self.kept.notice = f"{notice}, {utc_now()}"
        state.record_action(self.directory, notice)
        self._keep_state()

    # Opening

    def _open(self, path: Path) -> str:
        """Open a file; returns the screen on which it is seen."""
        if path.suffix not in {".py", ".toml"}:
            self._opening = path
            self._beside("open-store", self._watch_if_readable(path))
            return self.kept.screen
        self.kept.recent = with_opened(self.kept.recent, path, title_of(path))
        if path.suffix == ".py":
            self._analyses.load(path, self._view.path if self._view else None)
            return self.kept.screen
        try:
            kind, text = kind_of(path)
        except RigError as error:
            self._note(str(error), "error")
            return self.kept.screen
        if kind == "rig":
            self._panes.rig.show_opening(str(path))
            self._holding.take(path)
            return "rig"
        self._beside("campaign-file", self._show_campaign_file(path, text))
        return "campaign"

    async def _show_campaign_file(self, path: Path, text: str) -> None:
        self.kept.campaign = str(path.absolute())
        await self._panes.campaign.show_file(path, text)
        self._tell_standing()

    async def _watch_if_readable(self, store: Path) -> None:
        """Watch another store; one that cannot be read leaves what is watched as it is, and in reach of STOP."""
        try:
            await asyncio.to_thread(require_store, store)
        except (RigError, OSError) as error:
            self._note(str(error), "error")
            if self._opening == store:
                self._opening, self._stop_owed = None, False
        else:
            if self._opening == store:
                self._watch(store)

    def _watch(self, store: Path) -> None:
        self.kept.store = str(store.absolute())
        self._view = self._shown_view = None
        # One that was asked for while this store was looked into is of its campaign.
        self._stop_owed = self._stop_owed and self._opening == store
        self._opening = None
        self.call_later(self._panes.results.clear)
        self._feed.watch(store)

    # What threads tell

    @while_running
    def on_store_seen(self, message: say.StoreSeen) -> None:
        """The store has changed."""
        before, self._view = self._view, message.view
        ended = before is not None and before.path == message.view.path and before.alive and not message.view.alive
        if before is None or before.path != message.view.path:
            self.kept.recent = with_opened(self.kept.recent, message.view.path, message.view.title)
            self._analyses.ask(message.view.path, "model", quiet=True)
        # A result is worked out when a store is opened and when its campaign ends, not after every run.
        if (before is None or ended) and message.view.runs and not message.view.alive:
            self._analyses.ask(message.view.path, "result", quiet=True)
        if ended:
            self._analyses.ask(message.view.path, "model", quiet=True)
            self._note(f"the campaign is {message.view.state}")
        if self._stop_owed:
            self._stop_owed = False
            self.action_stop()
        # At once: a dialog over a question that is answered would take a word for the next one.
        self._asking.show(message.view)

    @while_running
    def on_campaign_ended(self, message: say.CampaignEnded) -> None:
        """A process of ours has ended."""
        if self._view is not None and self._view.path == message.store and message.status == 0:
            self._analyses.ask(message.store, "model", quiet=True)
        if message.status == -STOP_SIGNAL:
            self._notes.forget()
            self._note("the campaign was stopped before it had begun", "warning")
        elif message.status < 0:
            # What it said last was how far it was.
            killed = f"the campaign's process was killed ({signal.strsignal(-message.status)})"
            self._note(f"{killed}; what is recorded stays, r on screen 2 resumes it", "error")
        # 130 is an abort, which the operator has asked for.
        elif message.status not in {0, 130}:
            silent = (
                f"the campaign's process ended with status {message.status}, and could not write why into "
                f"{log_of(message.store)}; is the disk full?"
            )
            self._note(message.last_line or silent, "error")
        if self._holding.bench is None:
            # The rig was given free for the campaign; it is held again as before.
            self._holding.take()

    @while_running
    def on_bench_taken(self) -> None:
        """It is open, or was refused."""
        if self._holding.rig is not None:
            self.kept.rig = str(self._holding.rig.absolute())
        self._panes.rig.show_opening("")

    @while_running
    def on_stopped(self, message: say.Stopped) -> None:
        """What came of a STOP."""
        for rest in message.rests:
            # Until it has confirmed: what is not known to be at rest stays an alarm.
            if rest.confirmed:
                self._unsafe.pop(rest.instrument, None)
            else:
                self._unsafe[rest.instrument] = rest
        unsafe = [rest for rest in message.rests if not rest.confirmed]
        for rest in sorted(message.rests, key=lambda rest: rest.confirmed):
            self._panes.log.add(utc_now(), "note" if rest.confirmed else "alarm", f"STOP: {rest}")
        names = ", ".join(rest.instrument for rest in message.rests if rest.confirmed)
        # What came of it takes the place of whatever was told before, an error too: the log has that.
        self._notes.forget()
        told = f"STOP: {len(unsafe)} NOT CONFIRMED at rest" if unsafe else f"STOP: confirmed at rest: {names}"
        self._note(told, "error" if unsafe else "warning")

    # What the operator asks

    def action_stop(self) -> None:
        """STOP: from every screen and dialog, whatever else is going on."""
        view = self._view
        # What is held here first: it needs no other process.
        held = self._holding.stop()
        if view is not None:
            # Also where the store knows of no process yet: a campaign that is being resumed, an investigation between
            # its campaigns.
            held = self._campaigns.signal(view.path, STOP_SIGNAL) or held
            if view.alive:
                # Three ways, as any one may be the only one open: its signal, its store, its instruments.
                self._send("stop", view.path)
            if view.alive or view.killed:
                self._holding.stop_from_outside(view)
        self._act("STOP")
        if self._opening is not None or (view is None and self._feed.watches):
            # It may be of a campaign that runs; whoever asks for a STOP does not wait to see that.
            self._stop_owed = True
            self._note("STOP: of the campaign as soon as its store has been read", "warning")
        elif not held and (view is None or not (view.alive or view.killed)):
            self._note("STOP: no rig is held here, and no campaign runs", "warning")

    def action_cancel(self) -> None:
        """Give up what is being worked out."""
        if not self._analyses.cancel():
            self._note("nothing is being worked out", "warning")

    def action_undo(self) -> None:
        """Take back the last thing that can be taken back: on a form what was typed, else what the store keeps."""
        if self.kept.screen == "campaign" and self._panes.campaign.undo():
            return
        undone = self._analyses.undo(self._view.path) if self._view is not None else ""
        self._note(f"undo: {undone}" if undone else "nothing to undo here", "information" if undone else "warning")

    def action_open(self) -> None:
        """Ask which file."""
        from rigctl.console.widgets.dialogs import ConfirmDialog, OpenDialog  # after the first paint

        def go(path: str) -> None:
            self._act(f"open {path}")
            self.action_screen(self._open(Path(path)))

        def unless_lost(path: str) -> None:
            unsaved = self._panes.campaign.unsaved if path.endswith(".toml") else ""
            if unsaved:
                ConfirmDialog(f"Open {path}?", f"{unsaved}: another campaign file takes their place.").ask(
                    self, lambda _: go(path)
                )
            else:
                go(path)

        files = openable(self.kept.recent, Path())
        OpenDialog("Open a rig file, a campaign file, a store or a plug-in", files).ask(self, unless_lost)

    def action_bench(self) -> None:
        """Hold the rig."""
        self._holding.take()

    def action_release(self) -> None:
        """Give it free."""
        self._act("release the rig")
        self._holding.give()

    async def action_quit(self) -> None:
        """Ctrl+Q, which every application of this kind has, asks as `q` does."""
        self.action_leave()

    def action_leave(self) -> None:
        """Quit; a campaign goes on."""
        from rigctl.campaign.session.requests import is_running  # after the first paint
        from rigctl.console.widgets.dialogs import ConfirmDialog

        view, told = self._view, []
        # Asked of the store anew: what is on the screen may be of a moment ago.
        if view is not None and is_running(view.path):
            told.append(
                f"A campaign runs ({view.path}). It goes on without the console; "
                f"`rigctl console {view.path}` attaches to it again."
            )
        if unsaved := self._panes.campaign.unsaved:
            told.append(f"{unsaved}.")
        if told:
            ConfirmDialog("Quit the console?", "\n".join(told)).ask(self, lambda _: self.exit())
        else:
            self.exit()

    def on_motion_asked(self, message: say.MotionAsked) -> None:
        """Move, jog or home a stage of the rig that is held."""
        bench = self._holding.bench
        if bench is None:
            self._note("no rig is held here; the campaign moves it", "warning")
            return
        self._act(" ".join([message.motion, message.stage, *(f"{value:g}" for value in message.values)]))
        getattr(bench.stations[message.stage], message.motion)(*message.values)

    def on_reconnect_asked(self) -> None:
        """Try again."""
        if self._holding.bench is None:
            self._holding.take()
        else:
            self._holding.bench.reconnect()

    def on_start_asked(self, message: say.StartAsked) -> None:
        """Give the rig free, then start a campaign on it and watch its store."""
        launch = message.launch
        self._act(f"{'investigate' if launch.investigate else 'start'} {launch.campaign} into {launch.store}")

        def go() -> None:
            self._campaigns.start(launch, self._analyses.plugins)
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
        if message.kind == "abort" and not view.alive and self._campaigns.signal(view.path, signal.SIGTERM):
            return  # an investigation between its campaigns
        # A campaign whose process has ended is resumed by another, which needs the rig free.
        if message.kind == "resume" and self._campaigns.investigates(view.path) and not view.alive:
            self._note("the investigation goes on by itself", "warning")
            return
        if message.kind == "resume" and not view.alive:
            self._holding.give(lambda: self._campaigns.resume(view.path, self._analyses.plugins))
            return
        self._send("request", view.path, message.kind)

    def on_run_asked(self, message: say.RunAsked) -> None:
        """From any screen to its page."""
        if self._view is not None:
            self.action_screen("workbench")
            self.action_page("tab-run")
            self._analyses.ask(self._view.path, "run", message.run_id)

    def on_write_asked(self, message: say.WriteAsked) -> None:
        """Ask for a name, then have it written."""
        from rigctl.console.widgets.dialogs import TextDialog  # after the first paint

        view, kind = self._view, message.kind
        if view is None:
            self._note("open a store first: o", "warning")
            return

        def write(name: str) -> None:
            self._act(f"write the {kind} of {view.path} to {name.strip()}")
            self._analyses.ask(view.path, "write", kind, Path(name.strip()))

        TextDialog(f"Write the {kind}", "to", str(proposed(kind, view.path)), refusal).ask(self, write)

    @while_running
    def on_file_written(self, message: say.FileWritten) -> None:
        """Tell it, and go on with it as its kind does."""
        self._note(f"written: {message.path}")
        then = KINDS[message.kind].then
        if then == "look":
            look_at(message.path)
        elif then == "open":
            self.action_screen(self._open(message.path))

    def on_analysis_asked(self, message: say.AnalysisAsked) -> None:
        """Have something worked out from the store that is open."""
        if self._view is None:
            self._note("open a store first: o", "warning")
            return
        if message.what in {"add", "remove"}:
            self._act(f"model {message.what} {' '.join(message.arguments[0])}")
        if message.what == "mark":
            self._act(f"mark run {message.arguments[0]} {'valid' if message.arguments[1] else 'invalid'}")
        self._analyses.ask(self._view.path, message.what, *message.arguments)
