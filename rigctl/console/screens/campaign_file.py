"""The tab in which a campaign file is edited, each entry checked while it is typed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.widget import Widget
from textual.widgets import Input, Static, TabPane

from rigctl.console.entries import Entry, Listing

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
