"""A picture as rows of characters: lines and marks, with axes that say their units."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from rich.style import Style

from rigctl.console.widgets.braille import BLANK, dotted, joined, scaled, thinned, within
from rigctl.console.widgets.ink import BOLD, DARK, DIM, LABEL_WIDTH, PLAIN, REVERSED, Palette, Row, empty, label_of
from rigctl.console.widgets.ticks import LONGEST, Tick, on_scale, ticks_of
from rigctl.console.widgets.window import Point, Range, Window
from rigctl.core.arrays import FloatArray
from rigctl.report.picture import Line, Picture, Scale

# Rows from one tick to the next, and columns, labels between them.
_ROWS_PER_TICK, _COLUMNS_PER_TICK = 3, 14
_FLAT = 1e-3
_BESIDE_HALF = 1e-5
"""Half the height of an axis on which nothing changes."""


@dataclass(frozen=True)
class Area:
    """Room for a plot in characters, and what its axes range over, as values stand on them."""

    width: int
    height: int
    x: Range
    y: Range
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
    counted: bool = False
    """Whether only whole numbers mean something on the level axis: runs, versions."""

    @property
    def seen(self) -> Window:
        """What the axes range over."""
        return Window(self.x, self.y)

    @property
    def rows(self) -> dict[int, str]:
        """Labels of the upright axis by row; two rows that are one get one label."""
        found = ticks_of(self.y_scale, *self.y, max(2, self.height // _ROWS_PER_TICK))
        return {row: each.label for each in found if 0 <= (row := _row(each.at, self)) < self.height}

    @property
    def columns(self) -> dict[int, str]:
        """Labels of the level axis by column."""
        found = ticks_of(self.x_scale, *self.x, max(2, self.width // _COLUMNS_PER_TICK))
        if self.counted:
            found = [
                Tick(each.at, f"{each.at:.0f}" if len(each.label) < LONGEST else each.label)
                for each in found
                if each.at == round(each.at)
            ]
        places = scaled(np.array([each.at for each in found]), *self.x, self.width)
        return {cell(place): each.label for place, each in zip(places.tolist(), found, strict=True)}


@dataclass
class _Sheet:
    """Characters and inks of the plot area; a cell without ink is blank."""

    area: Area
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

    def reverse(self, row: int, column: int, text: str) -> None:
        """Text that stands out; what is blank beside it does not."""
        if 0 <= row < self.area.height:
            self.inks[row] = [ink or PLAIN for ink in self.inks[row]]
            self.put(row, column, text, REVERSED)

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


@dataclass(frozen=True)
class Layout:
    """Where what is drawn: the heading above, the room for labels to the left, and the lines as they stand there."""

    heading: Sequence[Row]
    area: Area
    margin: int
    lines: Sequence[Line]
    picture: Picture
    labels: dict[int, str]
    has_axis: bool


def laid_out(
    picture: Picture, width: int, height: int, palette: Palette = DARK, window: Window | None = None
) -> Layout | None:
    """How a picture is laid out on `height` rows; None where it has no points, or no room for them."""
    picture = on_its_scales(picture)
    lines = _known(picture.lines)
    heading = _cut_heading(picture, lines, width, height, palette)
    has_axis = bool(picture.x_label or picture.x_range)
    rows, columns = height - len(heading) - has_axis, width - LABEL_WIDTH - 1
    if rows < 1 or columns < 4 or not lines:
        return None
    if window is None:
        across = _range(picture.x_range, [line.x for line in lines], _x_margin(lines))
        upright = _range(picture.y_range, [end for line in lines for end in (line.y, *(line.bars or ()))], 0.05)
    else:
        across, upright = window.x, window.y
    area = Area(columns, rows, across, upright, picture.x_scale, picture.y_scale, _counted(picture.x_scale, lines))
    labels = area.rows
    # Digits that tell a quiet voltmeter's ticks apart need room: a label is never cut.
    margin = max(LABEL_WIDTH, *map(len, labels.values()), 0)
    area = replace(area, width=width - margin - 1)
    return Layout(heading, area, margin, lines, picture, labels, has_axis) if area.width > 0 else None


def drawn(
    picture: Picture,
    width: int,
    height: int,
    palette: Palette = DARK,
    window: Window | None = None,
    cursor: Point | None = None,
) -> list[Row]:
    """A picture as `height` rows, none wider than `width`."""
    if height < 1:
        return []
    laid = laid_out(picture, width, height, palette, window)
    if laid is None:
        return _undrawn(picture, width, height)
    area, margin = laid.area, laid.margin
    sheet = _Sheet(area, palette)
    _draw_grid(sheet, laid.labels)
    _draw_levels(sheet, laid.picture.levels)
    # Lines first: a mark must not be drawn over.
    for line in laid.lines:
        _draw_line(sheet, line)
    for line in laid.lines:
        _draw_bars(sheet, line)
    for line in laid.lines:
        _draw_marks(sheet, line)
    _name_levels(sheet, laid.picture.levels)
    if cursor is not None:
        _draw_cursor(sheet, laid.picture, picture, cursor)
    plotted: list[Row] = [
        ((f"{laid.labels.get(row, ''):>{margin}}{'┤' if row in laid.labels else '│'}", DIM), *sheet.row(row))
        for row in range(area.height)
    ]
    axis: list[Row] = [((_x_axis(laid.picture, area, margin), DIM),)] if laid.has_axis else []
    return [*laid.heading, *plotted, *axis]


def _undrawn(picture: Picture, width: int, height: int) -> list[Row]:
    """What stands there instead: why there is nothing to see, or where there is no room the title."""
    lines = _known(on_its_scales(picture).lines)
    if lines:
        return [((picture.title[:width], PLAIN),), *[()] * (height - 1)]
    return empty(picture, width, height)


def _known(lines: Sequence[Line]) -> list[Line]:
    return [line for line in lines if (np.isfinite(line.x) & np.isfinite(line.y)).any()]


def _cut_heading(picture: Picture, lines: Sequence[Line], width: int, height: int, palette: Palette) -> list[Row]:
    # A long legend must leave room for the plot.
    return _heading(picture, lines, width, palette)[: 1 + height // 8]


def _counted(scale: Scale, lines: Sequence[Line]) -> bool:
    marked = [line.x for line in lines if line.mark]
    return scale == "linear" and bool(marked) and all(np.array_equal(x, np.round(x), equal_nan=True) for x in marked)


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


def _range(given: Range | None, values: Sequence[FloatArray], margin: float) -> Range:
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


def on_its_scales(picture: Picture) -> Picture:
    """The same with all values as they stand on the axes."""

    def x(values: FloatArray) -> FloatArray:
        return on_scale(picture.x_scale, values)

    def y(values: FloatArray) -> FloatArray:
        return on_scale(picture.y_scale, values)

    levels = zip(y(np.array([level for level, _ in picture.levels])), picture.levels, strict=True)
    return replace(
        picture,
        lines=tuple(
            replace(line, x=x(line.x), y=y(line.y), bars=line.bars and (y(line.bars[0]), y(line.bars[1])))
            for line in picture.lines
        ),
        x_range=_ends(x, picture.x_range),
        y_range=_ends(y, picture.y_range),
        levels=tuple((float(at), meaning) for at, (_, meaning) in levels if math.isfinite(at)),
    )


def _ends(on_axis: Callable[[FloatArray], FloatArray], given: Range | None) -> Range | None:
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


def cell(place: float) -> int:
    """The row or column of a place; half-way between two of them it is the last digit that would decide."""
    return round(place + _BESIDE_HALF)


def _row(value: float, area: Area) -> int:
    # Rows count from the top.
    return area.height - 1 - cell(float(scaled(np.array(value), *area.y, area.height)))


def _draw_line(sheet: _Sheet, line: Line) -> None:
    if line.mark:
        return
    area = sheet.area
    x, y = thinned(*within(line.x, line.y, *area.x), area.width)
    # A braille character has two by four dots.
    at = joined(scaled(x, *area.x, 2 * area.width), scaled(y, *area.y, 4 * area.height))
    points = dotted(*at, area.width, area.height)
    rows, columns = np.nonzero(points)
    ink = _ink(line, sheet.palette)
    for row, column, dots in zip(rows.tolist(), columns.tolist(), points[rows, columns].tolist(), strict=True):
        sheet.cells[row][column] = chr(BLANK + dots)
        sheet.inks[row][column] = ink


def _draw_bars(sheet: _Sheet, line: Line) -> None:
    """Error bars, from end to end; where an end is not on the axis, to the axis."""
    if line.bars is None:
        return
    area = sheet.area
    columns = scaled(line.x, *area.x, area.width)
    for column, value, low, high in zip(columns, line.y, *line.bars, strict=True):
        if not (math.isfinite(column) and math.isfinite(value)):
            continue
        lowest = _row(float(low), area) if math.isfinite(low) else area.height - 1
        highest = _row(float(high), area) if math.isfinite(high) else 0
        for row in range(max(highest, 0), min(lowest, area.height - 1) + 1):
            sheet.put(row, cell(float(column)), "│", _ink(line, sheet.palette))


def _draw_marks(sheet: _Sheet, line: Line) -> None:
    if not line.mark:
        return
    area = sheet.area
    columns = scaled(line.x, *area.x, area.width)
    for column, value in zip(columns, line.y, strict=True):
        if math.isfinite(column) and math.isfinite(value):
            sheet.put(_row(float(value), area), cell(float(column)), line.mark, _ink(line, sheet.palette))


def _draw_cursor(sheet: _Sheet, on_axes: Picture, picture: Picture, cursor: Point) -> None:
    """The point it is on, and its values in the row that is farther from it."""
    area, line = sheet.area, on_axes.lines[cursor.line]
    x, y = float(line.x[cursor.place]), float(line.y[cursor.place])
    row, column = _row(y, area), cell(float(scaled(np.array(x), *area.x, area.width)))
    if 0 <= row < area.height and 0 <= column < area.width:
        there = sheet.cells[row][column]
        sheet.reverse(row, column, "┼" if there in " ·╌" else there)
    text = f" {told(picture, cursor)} "[: area.width]
    # At the other end across, too: what is beside the point is what one looks at.
    beside = 0 if column > area.width // 2 else area.width - len(text)
    sheet.reverse(0 if row > area.height // 2 else area.height - 1, beside, text)


def told(picture: Picture, point: Point) -> str:
    """The values of a point, its error bar, and what it is."""
    line = picture.lines[point.line]
    x, y = float(line.x[point.place]), float(line.y[point.place])
    size = f"{x:.6g}, {y:.5g}"
    if line.bars is not None:
        size += f" ± {0.5 * float(line.bars[1][point.place] - line.bars[0][point.place]):.2g}"
    return "  ".join(filter(None, (size, line.name, label_of(picture, point))))


def _x_axis(picture: Picture, area: Area, margin: int) -> str:
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
