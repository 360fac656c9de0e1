"""Result tables on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from rigctl.report.tables.result_table import ResultTable


def print_tables(tables: Sequence[ResultTable], remarks: Sequence[str] = ()) -> None:
    """Tables one after the other, marked rows in bold, then what is to be said besides."""
    console = Console()
    for each in tables:
        console.print(each.sentence, highlight=False)
        shown = Table(box=SIMPLE_HEAD, padding=(0, 1))
        for column in each.columns:
            shown.add_column(column.lstrip("#~"), justify="right" if column.startswith("#") else "left")
        for number, row in enumerate(each.rows):
            marked = number < len(each.marked) and each.marked[number]
            shown.add_row(*row, style="bold" if marked else None)
        console.print(shown)
    for remark in remarks:
        console.print(remark, highlight=False, soft_wrap=True)
