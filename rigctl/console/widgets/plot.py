"""A plot of lines and marks in a terminal, with axes that say their units."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from rigctl.console.widgets.braille import BLANK, dotted, joined, scaled, thinned
from rigctl.console.widgets.ticks import on_scale, ticks_of
from rigctl.core.arrays import FloatArray
from rigctl.report.picture import Line, Picture, Scale

ON_DARK = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#0072b2")
ON_LIGHT = ("#0072b2", "#b35900", "#00795a", "#a0527d", "#d55e00", "#2a7fb0")
"""Okabe and Ito's palette, darker on white: each series also has a mark or a name of its own."""

DARK, LIGHT = (tuple(Style(color=colour) for colour in colours) for colours in (ON_DARK, ON_LIGHT))
PLAIN, BOLD, DIM = Style(), Style(bold=True), Style(dim=True)

Row = tuple[tuple[str, Style], ...]
"""Pieces of text from left to right."""

Palette = tuple[Style, ...]

_Range = tuple[float, float]

_LABEL_WIDTH = 8
# Rows from one tick to the next, and columns, labels between them.
_ROWS_PER_TICK, _COLUMNS_PER_TICK = 3, 14
_FLAT = 1e-3
"""Half the height of an axis on which nothing changes."""


@dataclass(frozen=True)
class _Area:
    width: int
    height: int
    x: tuple[float, float]
    y: tuple[float, float]
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"

    @property
    def rows(self) -> dict[int, str]:
        """Labels of the upright axis by row; two rows that are one get one label."""
        found = ticks_of(self.y_scale, *self.y, max(2, self.height // _ROWS_PER_TICK))
        return {row: each.label for each in found if 0 <= (row := _row(each.at, self)) < self.height}

    @property
    def columns(self) -> dict[int, str]:
        """Labels of the level axis by column."""
        found = ticks_of(self.x_scale, *self.x, max(2, self.width // _COLUMNS_PER_TICK))
        places = scaled(np.array([each.at for each in found]), *self.x, self.width)
        return {round(place): each.label for place, each in zip(places.tolist(), found, strict=True)}


@dataclass
class _Sheet:
    """Characters and inks of the plot area; a cell without ink is blank."""

    area: _Area
    palette: Palette
    cells: list[list[str]] = field(default_factory=list)
    inks: list[list[Style | None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.cells = [[" "] * self.area.width for _ in range(self.area.height)]
        self.inks = [[None] * self.area.width for _ in range(self.area.height)]

    def put(self, row: int, column: int, text: str, ink: Style) -> None:
        for offset, character in enumerate(text):
            if 0 <= row < self.area.height and 0 <= column + offset < self.area.width:
                self.cells[row][column + offset] = character
                self.inks[row][column + offset] = ink

    def row(self, number: int) -> Row:
        """A row in as few pieces as its inks allow: fewer are drawn faster."""
        cells, inks = self.cells[number], self.inks[number]
        used = set(inks) - {None}
        if len(used) < 2:  # most rows, told without going through their cells
            return (("".join(cells), used.pop() or PLAIN if used else PLAIN),)
        pieces, start = [], 0
        ink: Style | None = None
        for end, each in enumerate(inks):
            if each is not None and each is not ink:
                if ink is not None:
                    pieces.append(("".join(cells[start:end]), ink))
                    start = end
                ink = each
        return (*pieces, ("".join(cells[start:]), ink or PLAIN))


class Plot(Widget):
    """Shows a `Picture`; given another one it draws the rows that differ."""

    DEFAULT_CSS = "Plot { height: 1fr; width: 1fr; min-height: 4; }"

    def __init__(self, picture: Picture, *, id: str | None = None) -> None:  # noqa: A002
        super().__init__(id=id)
        self.picture = picture
        self._rows: list[Row] = []
        self._strips: list[Strip] = []
        self._drawn_for: tuple[object, ...] = ()

    def show(self, picture: Picture) -> None:
        """Draw another picture."""
        self.picture = picture
        # Of another size or in other colours no row is as it was; what is hidden may come back at its old size.
        if self._drawn_for != self._looks:
            self._drawn_for = ()
            self.refresh()
            return
        before, self._rows = self._rows, drawn(picture, *self.size, self._palette)
        base = self.rich_style
        changed = [y for y, row in enumerate(self._rows) if row != before[y]]
        for y in changed:
            self._strips[y] = self._strip(self._rows[y], base)
        if changed:
            self.refresh(*(Region(0, y, self.size.width, 1) for y in changed))

    def render_line(self, y: int) -> Strip:
        """A line of the picture at the size the widget has."""
        if self._drawn_for != self._looks:
            self._drawn_for = self._looks
            self._rows = drawn(self.picture, *self.size, self._palette)
            base = self.rich_style
            self._strips = [self._strip(row, base) for row in self._rows]
        return self._strips[y] if y < len(self._strips) else Strip.blank(self.size.width, self.rich_style)

    @property
    def _looks(self) -> tuple[object, ...]:
        return self.size, self.app.theme

    @property
    def _palette(self) -> Palette:
        return DARK if self.app.current_theme.dark else LIGHT

    def _strip(self, row: Row, base: Style) -> Strip:
        return Strip([Segment(text, base + ink) for text, ink in row]).adjust_cell_length(self.size.width, base)


def drawn(picture: Picture, width: int, height: int, palette: Palette = DARK) -> list[Row]:
    """A picture as `height` rows, none wider than `width`."""
    if height < 1:
        return []
    picture = _on_its_scales(picture)
    lines = [line for line in picture.lines if (np.isfinite(line.x) & np.isfinite(line.y)).any()]
    # A long legend must leave room for the plot.
    heading = _heading(picture, lines, width, palette)[: 1 + height // 8]
    rows = height - len(heading) - (1 if picture.x_label or picture.x_range else 0)
    columns = width - _LABEL_WIDTH - 1
    if rows < 1 or columns < 4:
        return [((picture.title[:width], PLAIN),)] + [()] * (height - 1)
    if not lines:
        text = f"{'':{_LABEL_WIDTH}} {picture.empty}"[:width]
        return [*heading, ((text, DIM),), *[()] * (height - len(heading) - 1)]
    across = _range(picture.x_range, [line.x for line in lines], _x_margin(lines))
    upright = _range(picture.y_range, [line.y for line in lines], 0.05)
    area = _Area(columns, rows, across, upright, picture.x_scale, picture.y_scale)
    labels = area.rows
    # Digits that tell a quiet voltmeter's ticks apart need room: a label is never cut.
    margin = max(_LABEL_WIDTH, *map(len, labels.values()), 0)
    area = replace(area, width=width - margin - 1)
    if area.width < 1:
        return [((picture.title[:width], PLAIN),)] + [()] * (height - 1)
    sheet = _Sheet(area, palette)
    _draw_grid(sheet, labels)
    _draw_levels(sheet, picture.levels)
    # Lines first: a mark must not be drawn over.
    for line in lines:
        _draw_line(sheet, line)
    for line in lines:
        _draw_marks(sheet, line)
    _name_levels(sheet, picture.levels)
    plotted: list[Row] = [
        ((f"{labels.get(row, ''):>{margin}}{'┤' if row in labels else '│'}", DIM), *sheet.row(row))
        for row in range(rows)
    ]
    axis: list[Row] = [((_x_axis(picture, area, margin), DIM),)] if height - len(heading) > rows else []
    return [*heading, *plotted, *axis]


def _heading(picture: Picture, lines: Sequence[Line], width: int, palette: Palette) -> list[Row]:
    """Title and legend, in more than one row where they are long."""
    named = [line for line in lines if line.name]
    long = len(picture.title) + sum(len(line.name) + 4 for line in named) > width
    rows: list[Row] = [((picture.title[:width], BOLD),)]
    room = width - len(picture.title)
    for line in named:
        label = f"{' ' if long else '  '}{line.mark or '─'} {line.name}"
        if len(label) > room and room < width:
            rows.append(())
            room = width
        rows[-1] = (*rows[-1], (label[:room], _ink(line, palette)))
        room -= len(label)
    return rows


def _ink(line: Line, palette: Palette) -> Style:
    return palette[line.colour % len(palette)]


def _range(given: tuple[float, float] | None, values: Sequence[FloatArray], margin: float) -> tuple[float, float]:
    if given is not None:
        return given
    known = np.concatenate([each[np.isfinite(each)] for each in values])
    low, high = float(known.min()), float(known.max())
    # A constant has an axis too: a thousandth of its value to either side.
    spread = (high - low) or max(abs(high) * 1e-3, _FLAT)
    return (low, high) if high > low and not margin else (low - margin * spread, high + margin * spread or spread)


def _x_margin(lines: Sequence[Line]) -> float:
    """Marks stand clear of the axis; a strip of time needs all the room."""
    return 0.03 if any(line.mark for line in lines) else 0.0


def _on_its_scales(picture: Picture) -> Picture:
    """The same with all values as they stand on the axes."""

    def x(values: FloatArray) -> FloatArray:
        return on_scale(picture.x_scale, values)

    def y(values: FloatArray) -> FloatArray:
        return on_scale(picture.y_scale, values)

    levels = zip(y(np.array([level for level, _ in picture.levels])), picture.levels, strict=True)
    return replace(
        picture,
        lines=tuple(replace(line, x=x(line.x), y=y(line.y)) for line in picture.lines),
        x_range=_ends(x, picture.x_range),
        y_range=_ends(y, picture.y_range),
        levels=tuple((float(at), meaning) for at, (_, meaning) in levels if math.isfinite(at)),
    )


def _ends(
    on_axis: Callable[[FloatArray], FloatArray], given: tuple[float, float] | None
) -> tuple[float, float] | None:
    if given is None:
        return None
    low, high = on_axis(np.array(given)).tolist()
    return low, high


def _draw_grid(sheet: _Sheet, rows: Iterable[int]) -> None:
    """A dot where ticks of both axes cross."""
    for row in rows:
        for column in sheet.area.columns:
            sheet.put(row, column, "·", DIM)


def _draw_levels(sheet: _Sheet, levels: Sequence[tuple[float, str]]) -> None:
    area = sheet.area
    for level, _ in levels:
        row = _row(level, area)
        if 0 <= row < area.height:
            sheet.put(row, 0, "╌" * area.width, DIM)


def _name_levels(sheet: _Sheet, levels: Sequence[tuple[float, str]]) -> None:
    """Last, so that nothing is drawn across the words."""
    area = sheet.area
    for level, meaning in levels:
        row = _row(level, area)
        if 0 <= row < area.height:
            sheet.put(row, area.width - len(meaning), meaning, DIM)


def _row(value: float, area: _Area) -> int:
    # Rows count from the top.
    return area.height - 1 - round(float(scaled(np.array(value), *area.y, area.height)))


def _draw_line(sheet: _Sheet, line: Line) -> None:
    if line.mark:
        return
    area = sheet.area
    x, y = thinned(line.x, line.y, area.width)
    # A braille character has two by four dots.
    at = joined(scaled(x, *area.x, 2 * area.width), scaled(y, *area.y, 4 * area.height))
    points = dotted(*at, area.width, area.height)
    rows, columns = np.nonzero(points)
    ink = _ink(line, sheet.palette)
    for row, column, dots in zip(rows.tolist(), columns.tolist(), points[rows, columns].tolist(), strict=True):
        sheet.cells[row][column] = chr(BLANK + dots)
        sheet.inks[row][column] = ink


def _draw_marks(sheet: _Sheet, line: Line) -> None:
    if not line.mark:
        return
    area = sheet.area
    columns = scaled(line.x, *area.x, area.width)
    for column, value in zip(columns, line.y, strict=True):
        if math.isfinite(column) and math.isfinite(value):
            sheet.put(_row(float(value), area), round(float(column)), line.mark, _ink(line, sheet.palette))


def _x_axis(picture: Picture, area: _Area, margin: int) -> str:
    """Labels at their ticks, then what the axis is, as far as there is room."""
    name = f" {picture.x_label}"[: max(area.width - 2, 0)] if picture.x_label else ""
    axis = [" "] * (margin + 1 + area.width - len(name))
    taken = -1
    for column, label in area.columns.items():
        first = margin + 1 + column - len(label) // 2
        if first > taken and first + len(label) <= len(axis):
            axis[first : first + len(label)] = label
            taken = first + len(label)
    return "".join(axis) + name
