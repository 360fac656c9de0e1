"""Result tables on a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from rigctl.report.tables.result_table import ResultTable


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
        drawn.add_column(Text(name.lstrip("#")), justify="right" if name.startswith("#") else "left", overflow="fold")
    for row, marked in zip(filled.rows, filled.marks, strict=True):
        drawn.add_row(*map(Text, row), style="bold" if marked else None)
    return drawn
