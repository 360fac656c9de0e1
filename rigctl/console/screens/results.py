"""Screen 3: the result as tables and plots, as its experiment gives them, and the comparison with another store."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rich.console import Group
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widget import Widget
from textual.widgets import Static

from rigctl.console.messages import AnalysisAsked, WriteAsked
from rigctl.console.widgets.dialogs import OpenDialog, PickDialog
from rigctl.console.widgets.pages import Page, Pages
from rigctl.console.widgets.plot import Plot
from rigctl.console.writing import KINDS, OF_RESULTS
from rigctl.report.picture import Picture

if TYPE_CHECKING:  # what writes tables is imported with the first table
    from rigctl.report.tables.result_table import ResultTable

NONE_YET = "No result yet: f works it out from the store that is open."


class ResultsPane(Vertical):
    """Results of the store that is open."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "update", "Work out"),
        Binding("v", "compare", "Compare with"),
        Binding("w", "write", "Write"),
    ]

    def __init__(self) -> None:
        super().__init__(id="results")
        self._one_at_a_time = asyncio.Lock()

    def compose(self) -> ComposeResult:
        """A page for each kind of table that the experiment has, its plots, and the comparison."""
        compared = Static("v compares with the runs of another store.", id="compare")
        compare = Page("Compare", VerticalScroll(compared), id="tab-compare")
        yield Pages(Page("Result", Static(NONE_YET), id="tab-result"), compare, id="results-tabs")

    def rest(self) -> Widget:
        """Where the focus is while nothing else is asked for."""
        return self.query_one(Pages).rest()

    async def clear(self) -> None:
        """Another store is open."""
        await self._show({"Result": [Static(NONE_YET)]})

    async def show_result(self, tables: Sequence[ResultTable], pictures: Sequence[Picture]) -> None:
        """Tables, those of one kind in a tab, and plots."""
        tabs: dict[str, list[Widget]] = {}
        for table in tables:
            tabs.setdefault(table.tab, []).append(Static(_drawn(table)))
        if pictures:
            tabs["Plots"] = [Horizontal(*map(Plot, pictures))]
        await self._show(tabs)

    async def _show(self, tabs: Mapping[str, Sequence[Widget]]) -> None:
        pages = [
            # Plots fill their page; tables may be longer than it is.
            Page(name, *(widgets if name == "Plots" else [VerticalScroll(*widgets)]), id=f"tab-{name.lower()}")
            for name, widgets in tabs.items()
        ]
        # Removing and adding pages takes several turns of the loop, and two results may come at once.
        async with self._one_at_a_time:
            # Plots and tables may go while they have the focus.
            had = self.has_focus_within
            await self.query_one(Pages).replace(pages, kept=("tab-compare",))
            if had:
                self.screen.set_focus(self.rest())

    def show_comparison(self, transfer: Mapping[str, Any]) -> None:
        """The keys of `with` in `rigctl compare --json`."""
        from rigctl.report.tables.workbench import transfer_table
        from rigctl.report.verdicts import transfer_sentence

        parts = (
            Text(f"with {transfer['store']}", style="dim"),
            Text(transfer_sentence(transfer)),
            _drawn(transfer_table(transfer)),
        )
        self.query_one("#compare", Static).update(Group(*parts))

    def action_update(self) -> None:
        """Have the result worked out."""
        self.post_message(AnalysisAsked("result"))

    def action_write(self) -> None:
        """Ask what; under which name is asked then."""
        kinds = [(kind, KINDS[kind].explanation) for kind in OF_RESULTS]
        PickDialog("Write what?", kinds).ask(self.app, lambda kind: self.post_message(WriteAsked(kind)))

    def action_compare(self) -> None:
        """Ask with which store."""

        def go(path: str) -> None:
            self.query_one(Pages).show("tab-compare")
            self.post_message(AnalysisAsked("compare_with", (Path(path),)))

        stores = [(str(path), "") for path in sorted(Path().glob("*.rig.sqlite"))]
        OpenDialog("Compare with which store?", stores).ask(self.app, go)


def _drawn(table: ResultTable) -> Group:
    from rigctl.report.tables.result_table import rich_table

    notes = [Text(note, style="dim") for note in table.notes]
    return Group(Text(table.title, style="bold"), rich_table(table, box=None, pad_edge=False), *notes, Text())
