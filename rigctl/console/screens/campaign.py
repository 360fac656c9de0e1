"""Screen 2: a campaign's file, its start, its steps, and the null search as it happens."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widget import Widget
from textual.widgets import Input, Static, TabbedContent, TabPane

from rigctl.console.entries import Entry, Listing
from rigctl.console.messages import DryRunAsked, Launch, Noted, RequestAsked, StartAsked
from rigctl.console.screens.campaign_progress import ProgressTab
from rigctl.console.store_view import StoreView
from rigctl.console.widgets.dialogs import ConfirmDialog, StartDialog, TextDialog

if TYPE_CHECKING:
    from rigctl.console.form import CampaignForm


class FileTab(TabPane):
    """A line that says what is wrong, and the form."""

    def __init__(self) -> None:
        super().__init__("File", id="tab-file")
        self.form: CampaignForm | None = None

    def compose(self) -> ComposeResult:
        """From top to bottom."""
        yield Static(id="file-line")
        yield VerticalScroll(id="form")

    async def show(self, path: Path, text: str) -> None:
        """A campaign file in the form."""
        from rigctl.console.form import CampaignForm  # what checks the files is imported after the first paint

        self.form = CampaignForm(path, text)
        box = self.query_one("#form", VerticalScroll)
        # Awaited: the new fields have the same ids.
        await box.remove_children()
        await box.mount_all(_fields(self.form.parts))
        self.judge()

    def on_input_changed(self, event: Input.Changed) -> None:
        """What is typed goes into the file's text, which is judged at once."""
        if self.form is not None and self.form.type(event.input.name or "", event.value):
            self.judge()

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
        Binding("d", "dry_run", "Dry run"),
        Binding("ctrl+s", "save", "Save", show=False),
    ]

    def __init__(self) -> None:
        super().__init__(id="campaign")
        self._progress = ProgressTab()
        self._file = FileTab()

    @property
    def file(self) -> Path | None:
        """The campaign file that is open."""
        return self._file.form.path if self._file.form else None

    def compose(self) -> ComposeResult:
        """Three tabs."""
        with TabbedContent(id="campaign-tabs"):
            yield self._progress
            yield self._file
            with TabPane("Dry run", id="tab-dry"), VerticalScroll():
                yield Static("d tells what the campaign file would do, without moving anything.", id="plan")

    # What is shown

    def show_store(self, view: StoreView) -> None:
        """The campaign as its store tells."""
        self._progress.show_store(view, on_screen=self.display)

    def show_null_search(self, search: Mapping[str, Any]) -> None:
        """The response of the mounting that is measured, as last worked out."""
        self._progress.show_null_search(search)

    def show_plan(self, text: str) -> None:
        """What a dry run told."""
        self.query_one("#plan", Static).update(Text(text))
        self._go("tab-dry")

    async def show_file(self, path: Path, text: str) -> None:
        """A campaign file in the form."""
        await self._file.show(path, text)
        self._progress.show_file(path)

    def _go(self, tab: str) -> None:
        self.query_one("#campaign-tabs", TabbedContent).active = tab

    # What the operator does

    def _opened(self) -> CampaignForm | None:
        if self._file.form is None:
            self.post_message(Noted("open a campaign file first: o", "warning"))
        return self._file.form

    def action_begin(self) -> None:
        """Ask how, then start."""
        from rigctl.console.form import launch_fault  # what checks the files is imported after the first paint

        if (form := self._opened()) is None:
            return
        if not form.saved:
            self.post_message(Noted("the form has changes: Ctrl+S saves them, then start", "warning"))
            return
        launch = Launch(form.path, _free(Path(form.path.stem + ".rig.sqlite")))

        def go(chosen: Launch) -> None:
            self._go("tab-progress")
            self.post_message(StartAsked(chosen))

        StartDialog(launch, launch_fault).ask(self.app, go)

    def action_ask(self, kind: str) -> None:
        """Pause or resume."""
        self.post_message(RequestAsked("pause" if kind == "pause" else "resume"))

    def action_abort(self) -> None:
        """Abort, once it is confirmed; STOP needs no confirmation."""
        text = "The campaign ends now; what is recorded stays, and r resumes it."
        ConfirmDialog("Abort the campaign?", text).ask(self.app, lambda _: self.post_message(RequestAsked("abort")))

    def action_edit(self) -> None:
        """Show the form."""
        if self._opened() is not None:
            self._go("tab-file")
            self._file.query(Input).first().focus()

    def action_dry_run(self) -> None:
        """Have it worked out."""
        if (form := self._opened()) is not None:
            self.post_message(DryRunAsked(form.path))

    def action_save(self) -> None:
        """Write the file, under its name or another."""
        form = self._file.form
        if form is None:
            return

        def write(name: str) -> None:
            path = Path(name)
            try:
                form.save(path)
            except OSError as error:
                self.post_message(Noted(f"{path}: cannot be written: {error.strerror}", "error"))
                return
            self.post_message(Noted(f"saved {path}"))
            self._file.judge()

        TextDialog("Save the campaign", "file", str(form.path), _no_toml_name).ask(self.app, write)


def _free(path: Path) -> Path:
    """A name that nothing has yet."""
    number, free = 2, path
    while free.exists():
        free = path.with_name(re.sub(r"(\.rig\.sqlite)$", rf"-{number}\1", path.name))
        number += 1
    return free


def _no_toml_name(name: str) -> str:
    return "" if name.strip().endswith(".toml") else "a campaign file's name ends in .toml"
