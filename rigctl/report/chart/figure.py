"""A figure: panels in rows and columns with room for their words, as one SVG element."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.report.chart.axes import GRID, INK, Axes
from rigctl.report.chart.marks import Box, Mark, Place, Words, words
from rigctl.report.chart.scale import Scale, Ticks
from rigctl.report.chart.text import FONT, width

WIDTH_PT = 511.2
"""Two columns of a journal, 180 mm."""

POINTS_PER_INCH = 72.0
LETTERS, SMALL = 8.0, 7.0
_LINE = 1.25
"""Of the letters' size, from line to line."""
_PAD, _TICK = 3.0, 3.0
_APART = 10.0
"""Between panels."""
_SWATCH, _ENTRY = 22.0, 10.0
"""In a legend: what a sample takes with the space behind it, and the space between two entries."""
_WIDEST_NAMES = 0.45
"""Of the figure's width that names at the left of a panel may take."""


@dataclass
class _Room:
    """What a panel needs on each side for its words, and its ticks as long as that is known."""

    left: float = 0.0
    right: float = 0.0
    above: float = 0.0
    below: float = 0.0
    x: Ticks = field(default_factory=lambda: Ticks((), ()))
    y: Ticks = field(default_factory=lambda: Ticks((), ()))
    upright: bool = False


class Figure:
    """A figure as wide as a page, so many inches high."""

    def __init__(self, height_in: float) -> None:
        self.height = POINTS_PER_INCH * height_in
        self.axes: list[Axes] = []
        self._rows: list[list[Axes]] = []
        self._widths: Sequence[float] = [1.0]
        self._heights: Sequence[float] = [1.0]
        self._legend: list[tuple[str, Mark]] = []
        self._side = ""

    def subplots(
        self,
        rows: int = 1,
        columns: int = 1,
        *,
        sharex: bool | str = False,
        sharey: bool | str = False,
        squeeze: bool = True,
        width_ratios: Sequence[float] | None = None,
        height_ratios: Sequence[float] | None = None,
    ) -> Any:
        """Panels in rows and columns: one, an array, or with `squeeze` False always an array of both.

        `sharex` is True for all or "col"; `sharey` is True for all or "row". Only outer panels have labels of what is
        shared.
        """
        self._rows = [[Axes() for _ in range(columns)] for _ in range(rows)]
        self._widths, self._heights = width_ratios or [1.0] * columns, height_ratios or [1.0] * rows
        self.axes = [each for row in self._rows for each in row]
        for i, row in enumerate(self._rows):
            for j, each in enumerate(row):
                column = [line[j] for line in self._rows]
                if sharex:
                    each.shared_x = column if sharex == "col" else self.axes
                    each.labelled_x = i == rows - 1
                if sharey:
                    each.shared_y = row if sharey == "row" else self.axes
                    each.labelled_y = j == 0
        panels = np.array(self._rows, dtype=object)
        if not squeeze:
            return panels
        return panels.item() if panels.size == 1 else panels.ravel() if 1 in panels.shape else panels

    def legend(self, entries: Sequence[tuple[str, Mark]]) -> None:
        """Below all panels, what their labels mean: of `Axes.labelled`."""
        self._legend = list(entries)

    def supylabel(self, text: str) -> None:
        """One label for the y of all panels."""
        self._side = text

    def svg(self, name: str, caption: str = "") -> str:
        """The figure; `name` sets its clip paths apart from other figures', `caption` says what it shows."""
        boxes, rooms = self._placed()
        body = [
            piece
            for number, (axes, box, room) in enumerate(zip(self.axes, boxes, rooms, strict=True))
            for piece in _panel(axes, box, room, f"{name}-{number}")
        ]
        if self._side:
            body.append(words(LETTERS + 1.0, 0.5 * self.height, self._side, LETTERS, "middle", turned=True))
        lines = _legend_lines(self._legend, WIDTH_PT - 20.0)
        top = self.height - _LINE * SMALL * len(lines) - 2.0
        for k, line in enumerate(lines):
            left = 0.5 * (WIDTH_PT - _line_width(line))
            body += _legend_line(line, left, top + _LINE * SMALL * (k + 0.5))
        label = f' role="img" aria-label="{escape(caption)}"' if caption else ""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH_PT:g} {self.height:.4g}" '
            f'width="{WIDTH_PT:g}pt" height="{self.height:.4g}pt" font-family="{FONT}"{label}>\n'
            + "\n".join(body)
            + "\n</svg>\n"
        )

    def _placed(self) -> tuple[list[Box], list[_Room]]:
        """Boxes of the panels with their ticks: ticks need room, and the room says how many there are."""
        count_x, count_y = len(self._widths), len(self._heights)
        inner = [(WIDTH_PT / count_x - 50.0, self.height / count_y - 30.0)] * len(self.axes)
        boxes: list[Box] = []
        rooms: list[_Room] = []
        for _ in range(2):
            rooms = [_room(axes, *size) for axes, size in zip(self.axes, inner, strict=True)]
            boxes = self._boxes(rooms)
            inner = [(box.width, box.height) for box in boxes]
        return [_equal(axes, box) for axes, box in zip(self.axes, boxes, strict=True)], rooms

    def _boxes(self, rooms: Sequence[_Room]) -> list[Box]:
        columns, rows = len(self._widths), len(self._heights)
        grid = [rooms[i * columns : (i + 1) * columns] for i in range(rows)]
        lefts = [max(row[j].left for row in grid) for j in range(columns)]
        rights = [max(row[j].right for row in grid) for j in range(columns)]
        above = [max(room.above for room in row) for row in grid]
        below = [max(room.below for room in row) for row in grid]
        side = LETTERS * _LINE + 2.0 if self._side else 0.0
        legend = _LINE * SMALL * len(_legend_lines(self._legend, WIDTH_PT - 20.0)) + (6.0 if self._legend else 0.0)
        wide = WIDTH_PT - side - sum(lefts) - sum(rights) - _APART * (columns - 1) - 2.0
        high = self.height - sum(above) - sum(below) - legend - 4.0 * (rows - 1) - 4.0
        # Words may need more than there is: a panel keeps some room, and the page grows.
        needed = 24.0 * rows
        if high < needed:
            self.height += needed - high
            high = needed
        widths = [max(wide, 40.0) * share / sum(self._widths) for share in self._widths]
        heights = [high * share / sum(self._heights) for share in self._heights]
        boxes = []
        top = 2.0
        for i in range(rows):
            top += above[i]
            left = side
            for j in range(columns):
                left += lefts[j]
                boxes.append(Box(left, top, widths[j], heights[i]))
                left += widths[j] + rights[j] + _APART
            top += heights[i] + below[i] + 4.0
        return boxes


def _room(axes: Axes, wide: float, high: float) -> _Room:
    """What a panel of about this size needs around it."""
    if axes.hidden:
        return _Room()
    most_y = max(2, min(9, int(high / (2.2 * SMALL))))
    room = _Room(y=axes.scale_y().ticks(*axes.limits_y(), most_y))
    room.x, room.upright = _ticks_of_x(axes, wide)
    names = max((width(label, SMALL) for label in room.y.labels), default=0.0) if axes.labelled_y else 0.0
    room.left = _PAD + min(names, _WIDEST_NAMES * WIDTH_PT) + _PAD
    room.left += _LINE * LETTERS * (axes.ylabel.count("\n") + 1) if axes.ylabel else 0.0
    at_the_side = [mark for mark in axes.marks if isinstance(mark, Words) and mark.share_x and mark.x > 1.0]
    room.right = max((width(mark.text, mark.size) + 4.0 for mark in at_the_side), default=0.0)
    room.below = _PAD
    if axes.labelled_x:
        widest = max((width(label, SMALL) for label in room.x.labels), default=0.0)
        room.below += widest + _PAD if room.upright else SMALL + _PAD
        if not room.upright and room.x.labels:
            room.right = max(room.right, 0.5 * width(room.x.labels[-1], SMALL))
    room.below += _LINE * LETTERS if axes.xlabel else 0.0
    room.above = _LINE * LETTERS if axes.title or axes.letter or (room.y.factor and axes.labelled_y) else 2.0
    if axes.legend_columns is not None:
        room.above += _LINE * SMALL * len(_legend_lines(axes.labelled(), wide, axes.legend_columns)) + 2.0
    return room


def _ticks_of_x(axes: Axes, wide: float) -> tuple[Ticks, bool]:
    """As many ticks as their labels leave room for; names that would touch stand upright."""
    scale, limits = axes.scale_x(), axes.limits_x()
    most = max(1, min(9, int(wide / (4.0 * SMALL))))
    ticks = scale.ticks(*limits, most)
    if scale.chosen is not None:
        upright = sum(width(label, SMALL) + 4.0 for label in ticks.labels) > wide
        fits = max(1, int(wide / (_LINE * SMALL)))
        apart = max(1, -(-len(ticks.places) // fits))
        return Ticks(ticks.places[::apart], ticks.labels[::apart]), upright
    while most > 1 and len(ticks.labels) * (max(width(label, SMALL) for label in ticks.labels) + 5.0) > wide:
        most -= 1
        ticks = scale.ticks(*limits, most)
    return ticks, False


def _equal(axes: Axes, box: Box) -> Box:
    """Where x and y are lengths of one kind, the largest box that shows them so."""
    if not axes.equal:
        return box
    (left, right), (bottom, top) = axes.limits_x(), axes.limits_y()
    scale = min(box.width / abs(right - left), box.height / abs(top - bottom))
    wide, high = scale * abs(right - left), scale * abs(top - bottom)
    return Box(box.left + 0.5 * (box.width - wide), box.top, wide, high)


def _place(scale: Scale, limits: tuple[float, float], start: float, end: float) -> Place:
    low, high = scale.values_of(np.array(limits))

    def place(values: FloatArray) -> FloatArray:
        return np.asarray(start + (scale.values_of(values) - low) / (high - low) * (end - start))

    return place


def _panel(axes: Axes, box: Box, room: _Room, name: str) -> Iterator[str]:
    if axes.hidden:
        return
    scale_x, scale_y, limits_x, limits_y = axes.scale_x(), axes.scale_y(), axes.limits_x(), axes.limits_y()
    at_x = _place(scale_x, limits_x, box.left, box.right)
    at_y = _place(scale_y, limits_y, box.bottom, box.top)
    frame = f'x="{box.left:.2f}" y="{box.top:.2f}" width="{box.width:.2f}" height="{box.height:.2f}"'
    axis_x = f"{scale_x.kind} {limits_x[0]!r} {limits_x[1]!r} {scale_x.linear_up_to!r}"
    axis_y = f"{scale_y.kind} {limits_y[0]!r} {limits_y[1]!r} {scale_y.linear_up_to!r}"
    clip = escape(f"clip-{name}")
    yield f'<clipPath id="{clip}"><rect {frame}/></clipPath>'
    # The script of a page reads where the panel is and what its axes show.
    yield f'<g class="panel" data-x="{axis_x}" data-y="{axis_y}">'
    yield f'<rect class="frame" {frame} fill="none" pointer-events="all"/>'
    yield from _grid(axes, box, room, at_x, at_y)
    outside = [mark for mark in axes.marks if isinstance(mark, Words)]
    yield f'<g clip-path="url(#{clip})">'
    for mark in sorted((each for each in axes.marks if not isinstance(each, Words)), key=lambda each: each.order):
        yield from mark.svg(at_x, at_y, box)
    yield "</g>"
    for text in outside:
        yield from text.svg(at_x, at_y, box)
    yield f'<rect {frame} fill="none" stroke="{INK}" stroke-width="0.6" pointer-events="none"/>'
    yield from _ticks(axes, box, room, at_x, at_y)
    yield from _words(axes, box, room)
    yield "</g>"


def _grid(axes: Axes, box: Box, room: _Room, at_x: Place, at_y: Place) -> Iterator[str]:
    d = ""
    if axes.grid_axis in ("x", "both"):
        d += "".join(f"M{x:.2f} {box.top:.2f}V{box.bottom:.2f}" for x in at_x(np.array(room.x.places)))
    if axes.grid_axis in ("y", "both"):
        d += "".join(f"M{box.left:.2f} {y:.2f}H{box.right:.2f}" for y in at_y(np.array(room.y.places)))
    if d:
        yield f'<path d="{d}" fill="none" stroke="{GRID}" stroke-width="0.4" opacity="0.4"/>'


def _ticks(axes: Axes, box: Box, room: _Room, at_x: Place, at_y: Place) -> Iterator[str]:
    d = ""
    for places, length in ((room.x.places, _TICK), (room.x.minor, 0.5 * _TICK)):
        d += "".join(f"M{x:.2f} {box.bottom:.2f}v{-length:g}" for x in at_x(np.array(places, dtype=np.float64)))
    # Names at the left need no ticks.
    if axes.scale_y().chosen is None or axes.scale_y().kind != "linear":
        for places, length in ((room.y.places, _TICK), (room.y.minor, 0.5 * _TICK)):
            d += "".join(f"M{box.left:.2f} {y:.2f}h{length:g}" for y in at_y(np.array(places, dtype=np.float64)))
    if d:
        yield f'<path d="{d}" fill="none" stroke="{INK}" stroke-width="0.5"/>'
    if axes.labelled_x:
        for x, label in zip(at_x(np.array(room.x.places)).tolist(), room.x.labels, strict=True):
            if room.upright:
                yield words(x + 0.35 * SMALL, box.bottom + _PAD, label, SMALL, "end", turned=True)
            else:
                yield words(x, box.bottom + _PAD + SMALL, label, SMALL, "middle")
    if axes.labelled_y:
        widest = _WIDEST_NAMES * WIDTH_PT
        for y, label in zip(at_y(np.array(room.y.places)).tolist(), room.y.labels, strict=True):
            yield words(box.left - _PAD, y + 0.35 * SMALL, _shortened(label, widest), SMALL, "end")


def _shortened(label: str, widest: float) -> str:
    while width(label, SMALL) > widest:
        label = label.rstrip("…")[:-1] + "…"
    return label


def _words(axes: Axes, box: Box, room: _Room) -> Iterator[str]:
    middle = 0.5 * (box.left + box.right)
    if axes.xlabel:
        text = f"{axes.xlabel}   {room.x.factor}".rstrip()
        yield words(middle, box.bottom + room.below - 0.25 * LETTERS, text, LETTERS, "middle")
    elif room.x.factor and axes.labelled_x:
        yield words(box.right, box.bottom + room.below, room.x.factor, SMALL, "end")
    if axes.ylabel:
        yield _side_label(axes.ylabel, box, room)
    above = box.top - 0.35 * LETTERS
    if axes.legend_columns is not None:
        lines = _legend_lines(axes.labelled(), box.width, axes.legend_columns)
        for k, line in enumerate(reversed(lines)):
            yield from _legend_line(line, box.left, box.top - _LINE * SMALL * (k + 0.5) - 1.0)
        above -= _LINE * SMALL * len(lines) + 1.0
    if axes.letter:
        yield words(box.left, above, f"({axes.letter})", LETTERS, bold=True)
    if axes.title:
        yield words(middle, above, axes.title, LETTERS, "middle")
    if room.y.factor and axes.labelled_y:
        yield words(box.left - _PAD, above, room.y.factor, SMALL, "end")


def _side_label(label: str, box: Box, room: _Room) -> str:
    """Lines side by side, each read from below."""
    lines = label.split("\n")
    size = LETTERS if len(lines) == 1 else SMALL
    first, middle = box.left - room.left + size, 0.5 * (box.top + box.bottom)
    return "".join(
        words(first + _LINE * size * k, middle, line, size, "middle", turned=True) for k, line in enumerate(lines)
    )


Entry = tuple[str, Mark]


def _legend_lines(entries: Sequence[Entry], wide: float, columns: int = 0) -> list[list[Entry]]:
    """Entries line by line, as many in each as there is room for, or as are wanted."""
    lines: list[list[Entry]] = []
    for entry in entries:
        line = lines[-1] if lines else None
        if line is None or _line_width([*line, entry]) > wide or (columns and len(line) == columns):
            lines.append([entry])
        else:
            line.append(entry)
    return lines


def _line_width(line: Sequence[Entry]) -> float:
    return sum(_SWATCH + width(label, SMALL) + _ENTRY for label, _ in line) - _ENTRY


def _legend_line(line: Sequence[Entry], left: float, middle: float) -> Iterator[str]:
    for label, mark in line:
        yield mark.swatch(left, middle)
        yield words(left + _SWATCH, middle + 0.35 * SMALL, label.replace("\n", ", "), SMALL)
        left += _SWATCH + width(label, SMALL) + _ENTRY
