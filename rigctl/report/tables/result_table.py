"""A table of a result: the same at a terminal, on a page and in the console."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace


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
