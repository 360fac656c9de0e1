"""A table of a result: the same on a page and in the console, and as a terminal of 80 columns shows it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text


@dataclass(frozen=True)
class ResultTable:
    """Rows of text under `columns`; the name of a column of numbers begins with #.

    `title` says what it shows, `notes` what is to be said besides; without rows there are only these. `marked` rows
    need attention. The console's results screen shows tables of the same `tab` together. What is not `printed` is
    too long for a terminal.
    """

    title: str
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    marked: Sequence[bool] = ()
    notes: Sequence[str] = ()
    tab: str = "Result"
    printed: bool = True

    @property
    def marks(self) -> Sequence[bool]:
        """Whether each row is marked."""
        return self.marked or [False] * len(self.rows)

    def filled(self) -> ResultTable:
        """Without the columns in which nothing stands."""
        kept = [i for i in range(len(self.columns)) if any(row[i] for row in self.rows)]
        rows = [[row[i] for i in kept] for row in self.rows]
        return replace(self, columns=[self.columns[i] for i in kept], rows=rows)


def print_tables(tables: Iterable[ResultTable]) -> None:
    """Tables one after the other: title, rows, notes."""
    console = Console()
    for each in tables:
        if each.title:
            console.print(each.title, highlight=False, markup=False)
        if each.rows:
            console.print(rich_table(each))
        for note in each.notes:
            console.print(note, highlight=False, markup=False)


def rich_table(table: ResultTable, **look: Any) -> Table:
    """The rows as rich draws them: numbers to the right, marked rows in bold; `look` is as of `rich.table.Table`."""
    filled = table.filled()
    drawn = Table(padding=(0, 1), **look)
    for name in filled.columns:
        # A table wider than the terminal loses no text.
        drawn.add_column(Text(name.lstrip("#")), justify="right" if name.startswith("#") else "left", overflow="fold")
    for row, marked in zip(filled.rows, filled.marks, strict=True):
        drawn.add_row(*map(Text, row), style="bold" if marked else None)
    return drawn
