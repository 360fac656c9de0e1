"""What a figure shows, as rows that are both drawn and written: a figure's CSV holds exactly its numbers."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, Generic, TypeVar

from rigctl.core.whole_file import writing
from rigctl.report.chart.figure import Figure
from rigctl.report.figures import from_matplotlib

Row = TypeVar("Row")

CAPTIONS = "figures.md"


@dataclass(frozen=True)
class Plate(Generic[Row]):
    """A figure to be written as NAME.svg and NAME.csv: `rows` are dataclasses or named tuples, `draw` sees nothing
    else.

    `draw` gives a figure of `rigctl.report.chart`, or one of matplotlib's.
    """

    name: str
    caption: str
    rows: Sequence[Row]
    draw: Callable[[Sequence[Row]], Any]

    def write(self, directory: Path) -> list[Path]:
        """Write both files; returns their paths."""
        # Both from the same rows: what is drawn is what is written.
        svg, table = directory / f"{self.name}.svg", directory / f"{self.name}.csv"
        svg.write_text(f'<?xml version="1.0" encoding="utf-8"?>\n{self.svg}', encoding="utf-8")
        _write_csv(table, self.rows)
        return [svg, table]

    def _repr_html_(self) -> str:
        # In a notebook's own ink on its own paper.
        svg = self.svg.replace("#000000", "currentColor").replace("#ffffff", "none")
        return f"<figure>{svg}<figcaption>{escape(self.caption)}</figcaption></figure>"

    @cached_property
    def svg(self) -> str:
        """The figure as one SVG element, drawn once for a page and for a file."""
        with from_matplotlib.figure_style():
            figure = self.draw(self.rows)
            if isinstance(figure, Figure):
                return figure.svg(self.name, self.caption)
            return from_matplotlib.svg(figure, self.name)


def file_name(text: str) -> str:
    """The name of a covariate or an effect as part of a file's."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in text).rstrip("_")


def _write_csv(path: Path, rows: Sequence[object]) -> None:
    """One column per field; floats to the last digit, empty where there is no value."""
    names = getattr(rows[0], "_fields", None) or [field.name for field in fields(rows[0])]  # type: ignore[arg-type]
    # The csv module writes its own line ends.
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        # Not `astuple`, which copies every field deeply.
        writer.writerows([getattr(row, name) for name in names] for row in rows)


def write_plates(plates: Sequence[Plate[Any]], left_out: Mapping[str, str], directory: Path) -> list[Path]:
    """Write figures and their captions; returns all paths, the captions last; `DataError` when it cannot be done."""
    with writing(directory, "cannot write the figures there"):
        directory.mkdir(parents=True, exist_ok=True)
        written = [path for plate in plates for path in plate.write(directory)]
        captions = directory / CAPTIONS
        captions.write_text(_captions(plates, left_out), encoding="utf-8")
    return [*written, captions]


def _captions(plates: Sequence[Plate[Any]], left_out: Mapping[str, str]) -> str:
    lines = ["# Figures", ""]
    lines += [f"- **{plate.name}**: {plate.caption}" for plate in plates]
    lines += [f"- *left out:* {what}: {reason}" for what, reason in left_out.items()]
    return "\n".join(lines) + "\n"
