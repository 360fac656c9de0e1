"""Rows of characters in colours, and a plot that has nothing to show: all that is needed before there are numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.style import Style

from rigctl.report.picture import Picture

if TYPE_CHECKING:
    from rigctl.console.widgets.window import Point

ON_DARK = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#0072b2")
ON_LIGHT = ("#0072b2", "#b35900", "#00795a", "#a0527d", "#d55e00", "#2a7fb0")
"""Okabe and Ito's palette, darker on white: each series also has a mark or a name of its own."""

AT_NIGHT = ("#e07800", "#a05000", "#ff9838", "#804000", "#c86400", "#ffb870")

DARK, LIGHT, NIGHT = (tuple(Style(color=colour) for colour in colours) for colours in (ON_DARK, ON_LIGHT, AT_NIGHT))
PLAIN, BOLD, DIM, REVERSED = Style(), Style(bold=True), Style(dim=True), Style(reverse=True)

Row = tuple[tuple[str, Style], ...]
"""Pieces of text from left to right."""

Palette = tuple[Style, ...]

LABEL_WIDTH = 8
"""Columns left of a plot."""


def empty(picture: Picture, width: int, height: int) -> list[Row]:
    """Why there is nothing to see."""
    text = f"{'':{LABEL_WIDTH}} {picture.empty}"[:width]
    return [((picture.title[:width], BOLD),), ((text, DIM),), *[()] * (height - 2)][:height]


def has_point(picture: Picture, point: Point) -> bool:
    """Whether a point of another picture can be one of this."""
    return point.line < len(picture.lines) and point.place < len(picture.lines[point.line].x)


def label_of(picture: Picture, point: Point) -> str:
    """What a point is; "" where its line does not say."""
    labels = picture.lines[point.line].labels
    return labels[point.place] if labels else ""
