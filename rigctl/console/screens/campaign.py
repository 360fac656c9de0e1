"""Screen 2: a campaign's file, its start, its steps, and the null search as it happens."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widget import Widget
from textual.widgets import Input, ProgressBar, Static, TabbedContent, TabPane, Tree

from rigctl.console import form
from rigctl.console.messages import DryRunAsked, Launch, Noted, RequestAsked, StartAsked
from rigctl.console.widgets.dialogs import ConfirmDialog, Fault, StartDialog, TextDialog
from rigctl.console.widgets.plot import MARKS, Line, Picture, Plot

if TYPE_CHECKING:
    from rigctl.console.feed import StoreView

STEPS_S = 1.0
"""The tree of steps is drawn anew at most so often."""

STATES = {"running": "▶", "paused": "‖", "done": "✓", "aborted": "■", "interrupted": "✗"}


class CampaignPane(Vertical):
    """Progress, file and dry run in tabs."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "begin", "Start"),
        Binding("p", "ask('pause')", "Pause"),
        Binding("r", "ask('resume')", "Resume"),
        Binding("a", "abort", "Abort"),
        Binding("e", "edit", "Edit"),
        Binding("d", "dry_run", "Dry run"),
        Binding("ctrl+s", "save", "Save", show=False),
    ]

    def __init__(self) -> None:
        super().__init__(id="campaign")
        self.file: Path | None = None
        self.rig_override: Path | None = None
        self._text = ""
        self._entries: dict[str, form.Entry] = {}
        self._view: StoreView | None = None
        self._sigmas: dict[str, dict[int, float]] = {}
        self._tree_of: tuple[object, ...] = ()
        self._steps_s = 0.0

    def compose(self) -> ComposeResult:
        """Three tabs."""
        with TabbedContent(id="campaign-tabs"):
            with TabPane("Progress", id="tab-progress"):
                yield Static(id="progress-line")
                yield ProgressBar(id="progress", show_eta=False)
                with Horizontal(id="progress-body"):
                    yield Tree("steps", id="steps")
                    with Vertical(id="nulls"):
                        yield Plot(Picture("null search: S against angle"), id="null-search")
                        yield Plot(Picture("σ(θ0)"), id="sigma")
            with TabPane("File", id="tab-file"):
                yield Static(id="file-line")
                yield VerticalScroll(id="form")
            with TabPane("Dry run", id="tab-dry"), VerticalScroll():
                yield Static("d tells what the campaign file would do, without moving anything.", id="plan")

    def on_mount(self) -> None:
        """No root line: the steps are the tree."""
        tree = self.query_one(Tree)
        tree.show_root = False
        tree.guide_depth = 2
        self._tell()

    # What is shown

    def show_store(self, view: StoreView) -> None:
        """The campaign as its store tells."""
        fresh = self._view is None or view.path != self._view.path
        if fresh:
            self._sigmas = {}
        self._view = view
        self._tell()
        if (self.display and time.monotonic() - self._steps_s > STEPS_S) or not view.alive:
            self._steps_s = time.monotonic()
            self._show_steps()

    def show_null_search(self, found: Mapping[str, Any]) -> None:
        """The response of the mounting that is measured, as last worked out."""
        import numpy as np

        if not found.get("rows"):
            return
        where = f"{found['axis']} {found['configuration']} {found['mounting']}"
        history = self._sigmas.setdefault(where, {})
        history.update(enumerate(found["sigmas"], 1))
        history[found["runs"]] = found["sigma_arcsec"]
        self.query_one("#null-search", Plot).show(response_picture(where, found["rows"], found["sigma_arcsec"]))
        counts = np.array(sorted(history), dtype=float)
        sigmas = np.log10([history[runs] for runs in sorted(history)])
        told = f"log σ(θ0) / arcsec: {found['sigma_arcsec']:.2f}″ after {found['runs']} runs"
        lines = (Line(counts, sigmas), Line(counts, sigmas, mark="o"))
        self.query_one("#sigma", Plot).show(Picture(told, lines, "runs"))

    def show_plan(self, text: str) -> None:
        """What a dry run told."""
        self.query_one("#plan", Static).update(Text(text))
        self.query_one("#campaign-tabs", TabbedContent).active = "tab-dry"

    async def show_file(self, path: Path, text: str) -> None:
        """A campaign file in the form."""
        self.file, self._text = path, text
        found = form.entries(text)
        self._entries = {entry.name: entry for entry in found if isinstance(entry, form.Entry)}
        box = self.query_one("#form", VerticalScroll)
        await box.remove_children()
        await box.mount_all(_fields(found))
        self._judge()
        self._tell()

    def _tell(self) -> None:
        line = Text(no_wrap=True, overflow="ellipsis")
        view = self._view
        bar = self.query_one(ProgressBar)
        if view is None:
            # The path last: it may be too long for the line.
            opened = f"s starts, d tries {self.file}" if self.file else "o opens a campaign file or a store"
            line.append(f"No campaign is watched. {opened}")
            bar.update(total=100, progress=0)
        else:
            status = view.status
            line.append(f"{STATES.get(view.state, '?')} {view.state} ", style="bold")
            done, planned = int(status["runs_done"]), int(status["runs_planned"])
            line.append(f" {done} of {planned} runs, {status['runs_invalid']} invalid, {_eta(status)}")
            line.append(f"  {status.get('step', '')}", style="dim")
            bar.update(total=max(planned, 1), progress=done)
        self.query_one("#progress-line", Static).update(line)

    def _show_steps(self) -> None:
        view = self._view
        if view is None:
            return
        shape = (view.path, len(view.runs), view.state, view.status.get("step"))
        if shape == self._tree_of:
            return
        self._tree_of = shape
        tree = self.query_one(Tree)
        tree.clear()
        nulls = any("mounting" in run.conditions for run in view.runs)
        self.query_one("#progress-body").set_class(bool(view.runs) and not nulls, "no-nulls")
        groups: dict[str, dict[str, list[Any]]] = {}
        for run in view.runs:
            given = run.conditions
            if "mounting" not in given:  # nothing to gather runs under
                tree.root.add_leaf(f"{'✓' if run.valid else '✗'} {run.run_id} {run.key}")
                continue
            outer = f"{given.get('axis', '?')} {given.get('configuration', '')}".strip()
            groups.setdefault(outer, {}).setdefault(f"mounting {given['mounting']}", []).append(run)
        running = view.state in {"running", "paused"}
        for place, (outer, mountings) in enumerate(groups.items()):
            last_group = place == len(groups) - 1
            count = sum(map(len, mountings.values()))
            mark = "▶" if running and last_group else "✓"
            node = tree.root.add(f"{mark} {outer}: {count} runs", expand=last_group)
            for index, (inner, runs) in enumerate(mountings.items()):
                now = running and last_group and index == len(mountings) - 1
                bad = sum(not run.valid for run in runs)
                told = f"{'▶' if now else '✓'} {inner}: {len(runs)}{f', {bad} invalid' if bad else ''}"
                leaf = node.add(told, expand=now)
                for run in runs if now or not running else ():  # a night has too many to draw them all each time
                    leaf.add_leaf(_run_told(run))
        if running:
            tree.root.add_leaf(f"▶ now: {view.status.get('step') or 'preparing'}")
        tree.scroll_end(animate=False)

    # What the operator does

    def action_begin(self) -> None:
        """Ask how, then start."""
        if self.file is None:
            self.post_message(Noted("open a campaign file first: o", "warning"))
            return
        if self._text != _read(self.file):
            self.post_message(Noted("the form has changes: Ctrl+S saves them, then start", "warning"))
            return
        launch = Launch(self.file, _free(Path(self.file.stem + ".rig.sqlite")), self.rig_override)

        def go(chosen: Launch | None) -> None:
            if chosen is not None:
                self.query_one("#campaign-tabs", TabbedContent).active = "tab-progress"
                self.post_message(StartAsked(chosen))

        self.app.push_screen(StartDialog(launch, launch_fault), go)

    def action_ask(self, kind: str) -> None:
        """Pause or resume."""
        self.post_message(RequestAsked("pause" if kind == "pause" else "resume"))

    def action_abort(self) -> None:
        """Abort, once it is confirmed; STOP needs no confirmation."""

        def go(agreed: bool | None) -> None:
            if agreed:
                self.post_message(RequestAsked("abort"))

        told = "The campaign ends now; what is recorded stays, and r resumes it."
        self.app.push_screen(ConfirmDialog("Abort the campaign?", told), go)

    def action_edit(self) -> None:
        """Show the form."""
        if self.file is None:
            self.post_message(Noted("open a campaign file first: o", "warning"))
            return
        self.query_one("#campaign-tabs", TabbedContent).active = "tab-file"
        self.query_one("#form").query(Input).first().focus()

    def action_dry_run(self) -> None:
        """Have it worked out."""
        if self.file is None:
            self.post_message(Noted("open a campaign file first: o", "warning"))
            return
        self.post_message(DryRunAsked(self.file, self.rig_override))

    def action_save(self) -> None:
        """Write the file, under its name or another."""
        if self.file is None:
            return

        def write(name: str | None) -> None:
            if name is None:
                return
            path = Path(name)
            try:
                path.write_text(self._text, encoding="utf-8")
            except OSError as error:
                self.post_message(Noted(f"{path}: cannot be written: {error.strerror}", "error"))
                return
            self.file = path
            self.post_message(Noted(f"saved {path}"))
            self._judge()

        self.app.push_screen(TextDialog("Save the campaign", "file", str(self.file), _no_toml_name), write)

    def on_input_changed(self, event: Input.Changed) -> None:
        """What is typed goes into the file's text, which is judged at once."""
        entry = self._entries.get(event.input.name or "")
        if entry is None or event.value == entry.text:
            return
        self._text = form.changed(self._text, entry, event.value)
        self._entries[entry.name] = form.Entry(**{**vars(entry), "text": event.value})
        self._judge()

    def _judge(self) -> None:
        assert self.file is not None
        why = form.fault(self._text, self.file)
        saved = "" if self._text == _read(self.file) else "  (not saved: Ctrl+S)"
        told = Text(f"✗ {why}" if why else f"✓ {self.file} is valid{saved}", style="bold" if why else "")
        self.query_one("#file-line", Static).update(told)
        for field in self.query_one("#form").query(Input):
            key = field.name or ""
            wrong = bool(why) and (why.startswith((f"{key}:", f"{key} ", f"{key}.")) or f" {key};" in why)
            field.set_class(wrong, "wrong")


def _fields(entries: Sequence[form.Entry | form.Listing]) -> Iterator[Widget]:
    table = None
    for place, entry in enumerate(entries):
        if entry.table != table:
            table = entry.table
            yield Static(f"[{table}]" if table else "campaign", classes="form-table", markup=False)
        if isinstance(entry, form.Entry):
            field = Input(entry.text, placeholder=entry.hint, compact=True, id=f"entry-{place}", name=entry.name)
            yield Horizontal(Static(entry.key, classes="form-key"), field, classes="form-row")
            continue
        told = f"[[{entry.table}.{entry.key}]]: {len(entry.rows)}, kept as they are; change them in an editor"
        yield Static(Text(told), classes="form-list")
        for number, row in enumerate(entry.rows, 1):
            yield Static(Text(f"{number:>3}  {row}"), classes="form-list")


def response_picture(where: str, rows: list[Mapping[str, Any]], sigma_arcsec: float) -> Picture:
    """Figure 12 for a terminal: one line and mark per frequency, the crossing at zero."""
    import numpy as np

    measured = [row for row in rows if row["kind"] == "measured"]
    frequencies = sorted({row["frequency_hz"] for row in measured})
    far = max(abs(row["theta_minus_theta0_arcsec"]) for row in measured)
    reach = max(1.2 * far, 20.0)
    lines = []
    for place, frequency in enumerate(frequencies):
        own = [row for row in rows if row["frequency_hz"] == frequency]
        model = [r for r in own if r["kind"] == "model" and abs(r["theta_minus_theta0_arcsec"]) <= reach]
        for kind, mark, name in (
            (model, "", ""),
            ([r for r in own if r["kind"] == "measured"], MARKS[place % 6], f"{frequency:.2g} Hz"),
        ):
            x = np.array([row["theta_minus_theta0_arcsec"] for row in kind])
            y = np.array([row["response_um_s2_per_mm"] for row in kind])
            if len(x):
                lines.append(Line(x, y, name, mark, place))
    title = f"{where}: S/(µm/s²/mm), ±{sigma_arcsec:.2f}″"
    return Picture(title, tuple(lines), "θ − θ0 / arcsec", x_range=(-reach, reach))


def launch_fault(launch: Launch) -> Fault | None:
    """What speaks against a launch, as far as the files say at a glance; the rest the campaign's process tells."""
    from rigctl.core.errors import ConfigError
    from rigctl.files.campaign_file import read_campaign
    from rigctl.files.rig_file import read_rig

    try:
        file = read_campaign(launch.campaign)
    except ConfigError as error:
        return Fault("campaign", str(error))
    if not launch.store.name:
        return Fault("store", "name the store")
    if launch.store.exists() and file.procedure.get("mounting") not in {"same", "kept"}:
        return Fault("store", f"{launch.store} exists already; choose another name")
    if not launch.store.absolute().parent.is_dir():
        return Fault("store", f"{launch.store.parent}: no such directory")
    if launch.rig is None and not file.rig:
        return Fault("rig", "the campaign file names no rig; name one here")
    try:
        read_rig(launch.rig or file.rig_path)
    except ConfigError as error:
        return Fault("rig", str(error))
    return None


def _free(path: Path) -> Path:
    """A name that nothing has yet."""
    number, free = 2, path
    while free.exists():
        free = path.with_name(re.sub(r"(\.rig\.sqlite)$", rf"-{number}\1", path.name))
        number += 1
    return free


def _no_toml_name(name: str) -> str:
    return "" if name.strip().endswith(".toml") else "a campaign file's name ends in .toml"


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def _run_told(run: Any) -> str:
    given = run.conditions
    angle, frequency = given.get("theta_deg"), given.get("frequency_hz")
    told = f"{'✓' if run.valid else '✗'} {run.run_id}"
    if isinstance(angle, int | float):
        told += f" {angle:+.4f} deg"
    if isinstance(frequency, int | float):
        told += f" {frequency:.2g} Hz"
    return told


def _eta(status: Mapping[str, Any]) -> str:
    seconds = status.get("eta_s")
    if status.get("state") not in {"running", "paused"}:
        return "ended"
    if seconds is None:
        return "time left unknown"
    if seconds < 120:
        return f"{seconds:.0f} s left"
    return f"{seconds / 60:.0f} min left" if seconds < 7200 else f"{seconds / 3600:.1f} h left"
