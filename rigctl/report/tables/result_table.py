"""A table of a result: the same on a page and in the console, and as a terminal of any width shows it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from textwrap import wrap
from typing import Any, TypeVar

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

T = TypeVar("T")

_WHOLE = 10_000
"""Columns of a file: more than any line has."""

_MOST, _FIRST, _LAST = 24, 12, 4
"""Of more rows, and lines of a cell, a terminal shows the first and the last."""

_READABLE = 16
"""A column of words is no narrower."""


@dataclass(frozen=True)
class ResultTable:
    """Rows of text under `columns`; the name of a column of numbers begins with #.

    `title` says what it shows, `notes` what is to be said besides; without rows there are only these. `marked` rows
    need attention. The console's results screen shows tables of the same `tab` together. What is not `printed` is
    too long for a terminal; of what is `shortened` it shows the ends where there are very many rows.
    """

    title: str
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    marked: Sequence[bool] = ()
    notes: Sequence[str] = ()
    tab: str = "Result"
    printed: bool = True
    shortened: bool = False

    @property
    def marks(self) -> Sequence[bool]:
        """Whether each row is marked."""
        return self.marked or [False] * len(self.rows)

    def in_short(self) -> ResultTable:
        """With the first and the last of very many rows, and of the lines of a cell."""
        rows = [["\n".join(_ends(cell.split("\n"), str)) for cell in row] for row in self.rows]
        empty = [""] * (len(self.columns) - 1)
        marks = _ends(list(self.marks), lambda _: False)
        return replace(self, rows=_ends(rows, lambda more: [more, *empty]), marked=marks)

    def filled(self) -> ResultTable:
        """Without the columns in which nothing stands."""
        kept = [i for i in range(len(self.columns)) if any(row[i] for row in self.rows)]
        rows = [[row[i] for i in kept] for row in self.rows]
        return replace(self, columns=[self.columns[i] for i in kept], rows=rows)


def _ends(items: Sequence[T], said: Callable[[str], T]) -> list[T]:
    """The first and the last of very many, and between them what is `said` of the others; else all."""
    left_out = len(items) - _FIRST - _LAST
    if len(items) <= _MOST:
        return list(items)
    return [*items[:_FIRST], said(f"... {left_out} more, --json has all"), *items[-_LAST:]]


def print_tables(tables: Iterable[ResultTable]) -> None:
    """Tables one after the other: title, rows, notes. A terminal's width is kept; a file has every line whole."""
    console = Console()
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console = Console(width=_WHOLE, soft_wrap=True)
    for table in tables:
        each = table.in_short() if table.shortened else table
        if each.title:
            console.print(each.title, highlight=False, markup=False)
        if each.rows:
            console.print(rich_table(each))
        for note in each.notes:
            console.print(note, highlight=False, markup=False)


def rich_table(table: ResultTable, **look: Any) -> FittedTable:
    """The rows as rich draws them: numbers to the right, marked rows in bold; `look` is as of `rich.table.Table`."""
    return FittedTable(table.filled(), look)


@dataclass(frozen=True)
class FittedTable:
    """A table in as many pieces, one below the other, as the width asks for: no number is cut or parted from its
    uncertainty, and each piece has the columns that say what its rows are."""

    table: ResultTable
    look: Mapping[str, Any]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The pieces that fit `options.max_width`; one with whole headings where there is room."""
        # Measured as if there were room: a measurement is never wider than its options.
        roomy = options.update(max_width=_WHOLE)

        def fits(columns: Sequence[int], *, spread: bool = False) -> bool:
            drawn = self._drawn(columns, spread=spread)
            return Measurement.get(console, roomy, drawn).minimum <= options.max_width

        everything = range(len(self.table.columns))
        if fits(everything, spread=True):
            yield self._drawn(everything, spread=True)
            return
        keys = list(everything[: self._keys()])
        while len(keys) > 1 and not fits([*keys, max(everything[len(keys) :], key=self._length)]):
            keys.pop()
        piece = list(keys)
        for column in everything[len(keys) :]:
            if len(piece) > len(keys) and not fits([*piece, column]):
                yield self._drawn(piece)
                piece = list(keys)
            piece.append(column)
        yield self._drawn(piece, folded=not fits(piece))

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """As of one piece."""
        return Measurement.get(console, options, self._drawn(range(len(self.table.columns)), folded=True))

    def _keys(self) -> int:
        """How many columns at the beginning tell the rows apart, without measured values; 1 if none do."""
        rows = self.table.rows
        for count in range(1, len(self.table.columns)):
            if any("." in row[count - 1] for row in rows):
                break
            if len({tuple(row[:count]) for row in rows}) == len(rows):
                return count
        return 1

    def _whole(self, column: int) -> bool:
        """Whether the cells of a column are numbers, which are not broken."""
        return self.table.columns[column].startswith("#") or any("±" in row[column] for row in self.table.rows)

    def _length(self, column: int) -> int:
        lines = (line for row in self.table.rows for line in row[column].split("\n"))
        return max(map(cell_len, lines), default=0)

    def _drawn(self, columns: Sequence[int], *, spread: bool = False, folded: bool = False) -> Table:
        drawn = Table(padding=(0, 1), **self.look)
        for column in columns:
            name, longest = self.table.columns[column], self._length(column)
            whole = self._whole(column)
            header = name.lstrip("#")
            if whole and not spread and not folded:
                # A heading of several words does not make a column of short numbers wide.
                header = "\n".join(wrap(header, max(longest, 1), break_long_words=False))
            of_header = max(map(cell_len, header.split("\n")))
            narrowest = max(longest, of_header) if whole else min(longest, _READABLE)
            drawn.add_column(
                Text(header),
                justify="right" if name.startswith("#") else "left",
                # What is wider than the terminal by itself is folded: no text is lost.
                overflow="fold",
                no_wrap=whole and not folded,
                min_width=None if folded else narrowest,
            )
        for row, marked in zip(self.table.rows, self.table.marks, strict=True):
            drawn.add_row(*(Text(row[column]) for column in columns), style="bold" if marked else None)
        return drawn
