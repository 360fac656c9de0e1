"""Screen 2: a campaign's file, its start, its steps, and what its runs tell as they come."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widget import Widget
from textual.widgets import Input, Static, Tree

from rigctl.console.entries import Entry, Listing
from rigctl.console.marking import ask_why
from rigctl.console.messages import DryRunAsked, Launch, Noted, RequestAsked, RunAsked, StartAsked
from rigctl.console.screens.campaign_progress import ProgressPage
from rigctl.console.store_view import StoreView
from rigctl.console.widgets.dialogs import ConfirmDialog, StartDialog, TextDialog
from rigctl.console.widgets.pages import Page, Pages
from rigctl.console.widgets.plot import Plot
from rigctl.report.picture import Picture

if TYPE_CHECKING:
    from rigctl.campaign.recording import RunRecord
    from rigctl.console.form import CampaignForm
    from rigctl.console.vitals import Vitals


class FilePage(Page):
    """A line that says what is wrong, and the form."""

    def __init__(self) -> None:
        super().__init__("File", id="tab-file")
        self._undone: list[tuple[str, str]] = []
        self._shown: dict[str, str] = {}
        self.form: CampaignForm | None = None

    def compose(self) -> ComposeResult:
        """From top to bottom."""
        yield Static(id="file-line")
        yield VerticalScroll(id="form")

    async def show(self, path: Path, text: str) -> None:
        """A campaign file in the form."""
        from rigctl.console.form import CampaignForm  # what checks the files is imported after the first paint

        self.form, self._undone = CampaignForm(path, text), []
        self._shown = {part.name: part.text for part in self.form.parts if isinstance(part, Entry)}
        box = self.query_one("#form", VerticalScroll)
        # Awaited: the new fields have the same ids.
        await box.remove_children()
        await box.mount_all(_fields(self.form.parts))
        self.judge()

    def on_input_changed(self, event: Input.Changed) -> None:
        """What is typed goes into the file's text, which is judged at once."""
        if self.form is None:
            return
        name, before = event.input.name or "", self._shown.get(event.input.name or "", "")
        if self.form.type(name, event.value):
            # Key by key would be tedious: an entry is taken back whole.
            if not self._undone or self._undone[-1][0] != name:
                self._undone.append((name, before))
            self.judge()
        self._shown[name] = event.value

    def undo(self) -> bool:
        """Give the entry that was changed last what stood there before; False when none was."""
        if not self._undone:
            return False
        name, before = self._undone.pop()
        field = next(each for each in self.query(Input) if each.name == name)
        with self.prevent(Input.Changed):
            field.value = before
        assert self.form is not None
        self.form.type(name, before)
        self._shown[name] = before
        self.judge()
        return True

    def judge(self) -> None:
        """Say what is wrong, and mark the entry."""
        assert self.form is not None
        why = self.form.fault()
        saved = "" if self.form.saved else "  (not saved: Ctrl+S)"
        line = Text(f"✗ {why}" if why else f"✓ {self.form.path} is valid{saved}", style="bold" if why else "")
        self.query_one("#file-line", Static).update(line)
        # Faults begin with the key, or name an unknown one before a semicolon.
        for field in self.query_one("#form").query(Input):
            key = field.name or ""
            wrong = bool(why) and (why.startswith((f"{key}:", f"{key} ", f"{key}.")) or f" {key};" in why)
            field.set_class(wrong, "wrong")


def _fields(parts: Sequence[Entry | Listing]) -> Iterator[Widget]:
    table = None
    for place, part in enumerate(parts):
        if part.table != table:
            table = part.table
            yield Static(f"[{table}]" if table else "campaign", classes="form-table", markup=False)
        if isinstance(part, Entry):
            field = Input(part.text, placeholder=part.hint, compact=True, id=f"entry-{place}", name=part.name)
            yield Horizontal(Static(part.key, classes="form-key"), field, classes="form-row")
            continue
        heading = f"[[{part.table}.{part.key}]]: {len(part.rows)}, kept as they are; change them in an editor"
        yield Static(Text(heading), classes="form-list")
        for number, row in enumerate(part.rows, 1):
            yield Static(Text(f"{number:>3}  {row}"), classes="form-list")


class CampaignPane(Vertical):
    """Progress, file and dry run in tabs."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "begin", "Start"),
        Binding("p", "ask('pause')", "Pause"),
        Binding("r", "ask('resume')", "Resume"),
        Binding("a", "abort", "Abort"),
        Binding("e", "edit", "Edit"),
        Binding("m", "mark", "Mark"),
        # Its page and the line above the steps tell of it.
        Binding("d", "dry_run", "Dry run", show=False),
        Binding("ctrl+s", "save", "Save", show=False),
    ]

    def __init__(self) -> None:
        super().__init__(id="campaign")
        self._progress = ProgressPage()
        self._file = FilePage()
        self._store: Path | None = None

    @property
    def file(self) -> Path | None:
        """The campaign file that is open."""
        return self._file.form.path if self._file.form else None

    @property
    def unsaved(self) -> str:
        """What would be lost if the file were closed; "" when nothing would."""
        form = self._file.form
        return "" if form is None or not form.edited else f"The changes in the form of {form.path} are not saved"

    def compose(self) -> ComposeResult:
        """Three pages."""
        plan = Static("d tells what the campaign file would do, without moving anything.", id="plan")
        dry = Page("Dry run", VerticalScroll(plan), id="tab-dry")
        yield Pages(self._progress, self._file, dry, id="campaign-tabs")

    def rest(self) -> Widget:
        """Where the focus is while nothing is written."""
        return self.query_one(Pages).rest()

    def undo(self) -> bool:
        """Take back what was last typed into the form, while it is shown; False when nothing was."""
        return self.query_one(Pages).active == "tab-file" and self._file.undo()

    # What is shown

    def show_store(self, view: StoreView) -> None:
        """The campaign as its store tells."""
        self._store = view.path
        self._progress.show_store(view, on_screen=self.display)

    def show_vitals(self, vitals: Vitals | None) -> None:
        """How long ago the campaign gave a sign of life, and recorded anything."""
        self._progress.show_vitals(vitals)

    def show_pictures(self, pictures: Sequence[Picture]) -> None:
        """What the runs tell, as last worked out."""
        self._progress.show_pictures(pictures)

    def show_plan(self, text: str) -> None:
        """What a dry run told."""
        self.query_one("#plan", Static).update(Text(text))

    async def show_file(self, path: Path, text: str) -> None:
        """A campaign file in the form."""
        await self._file.show(path, text)
        self._progress.show_file(path)

    def _go(self, tab: str) -> None:
        self.query_one(Pages).show(tab)

    # What the operator does

    def _opened(self) -> CampaignForm | None:
        if self._file.form is None:
            self.post_message(Noted("open a campaign file first: o", "warning"))
        return self._file.form

    def action_begin(self) -> None:
        """Ask how, then start."""
        from rigctl.console.form import (  # what checks the files is imported after the first paint
            first_launch,
            launch_fault,
        )

        if (form := self._opened()) is None:
            return
        if not form.saved:
            self.post_message(Noted("the form has changes: Ctrl+S saves them, then start", "warning"))
            return
        launch = first_launch(form, self._store)

        def go(chosen: Launch) -> None:
            self._go("tab-progress")
            self.post_message(StartAsked(chosen))

        StartDialog(launch, launch_fault).ask(self.app, go)

    def action_ask(self, kind: str) -> None:
        """Pause or resume."""
        self.post_message(RequestAsked("pause" if kind == "pause" else "resume"))

    def action_mark(self) -> None:
        """Leave the run under the cursor out, or use it again, with a reason."""
        run = self._progress.chosen
        if run is None:
            self.post_message(Noted("choose a run among the steps first: Enter opens a step", "warning"))
            return
        ask_why(self, run.run_id, valid=run.valid, reason=run.reason)

    def on_tree_node_selected(self, event: Tree.NodeSelected[RunRecord | None]) -> None:
        """A run among the steps."""
        if event.node.data is not None:
            self.post_message(RunAsked(event.node.data.run_id))

    def on_plot_chosen(self, event: Plot.Chosen) -> None:
        """A run among what runs tell."""
        self.post_message(RunAsked(event.label))

    def action_abort(self) -> None:
        """Abort, once it is confirmed; STOP needs no confirmation."""
        text = "The campaign ends now; what is recorded stays, and r resumes it."
        ConfirmDialog("Abort the campaign?", text).ask(self.app, lambda _: self.post_message(RequestAsked("abort")))

    def action_edit(self) -> None:
        """Show the form."""
        if self._opened() is not None:
            self._go("tab-file")
            if entries := self._file.query(Input):
                self.screen.set_focus(entries.first())

    def action_dry_run(self) -> None:
        """Have it worked out."""
        if (form := self._opened()) is not None:
            # Here and not when it is worked out: pages change by keys alone.
            self._go("tab-dry")
            self.post_message(DryRunAsked(form.path))

    def action_save(self) -> None:
        """Write the file, under its name or another."""
        form = self._file.form
        if form is None:
            return

        def write(name: str) -> None:
            path = Path(name.strip())
            try:
                form.save(path)
            except OSError as error:
                self.post_message(Noted(f"{path}: cannot be written: {error.strerror}", "error"))
                return
            self.post_message(Noted(f"saved {path}"))
            self._file.judge()

        TextDialog("Save the campaign", "file", str(form.path), partial(_no_name, form.path)).ask(self.app, write)


def _no_name(own: Path, name: str) -> str:
    """Why a campaign is not saved under a name: only its `own` file is written over."""
    path = Path(name.strip())
    if path.suffix != ".toml":
        return "a campaign file's name ends in .toml"
    return f"{path} exists; give another name" if path != own and path.exists() else ""
