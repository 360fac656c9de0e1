"""Which part of a plot is seen, and which of its points the cursor is on; all as values stand on the axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.report.picture import Line

Range = tuple[float, float]
Step = Literal["left", "right", "up", "down", "first", "last", "highest", "lowest"]

ENDS: frozenset[Step] = frozenset({"first", "last", "highest", "lowest"})

_SMALLEST = 1e-12
"""Of the ends of a range: narrower than that numbers have no digits left."""


@dataclass(frozen=True)
class Window:
    """What is seen of the two axes."""

    x: Range
    y: Range

    @property
    def middle(self) -> tuple[float, float]:
        """Of both."""
        return 0.5 * (self.x[0] + self.x[1]), 0.5 * (self.y[0] + self.y[1])

    def zoomed(self, by: float, about: tuple[float, float]) -> Window:
        """Ranges `by` times as wide, with what is `about` where it was."""
        return Window(_zoomed(self.x, by, about[0]), _zoomed(self.y, by, about[1]))

    def moved(self, across: float, up: float) -> Window:
        """Moved by shares of what is seen."""
        return Window(_moved(self.x, across), _moved(self.y, up))

    def showing(self, x: float, y: float) -> Window:
        """Moved so that a point is seen; in its middle where it was not."""
        return Window(_showing(self.x, x), _showing(self.y, y))


@dataclass(frozen=True)
class Point:
    """One point of a picture: of which of its lines, and the how manieth."""

    line: int
    place: int


class Points:
    """The points that a cursor visits: those that have marks, else those of the joined lines."""

    def __init__(self, lines: Sequence[Line]) -> None:
        self.lines = lines
        marked = [number for number, line in enumerate(lines) if line.mark]
        self._joined = not marked
        visited = marked or range(len(lines))
        known = [np.flatnonzero(np.isfinite(lines[number].x) & np.isfinite(lines[number].y)) for number in visited]
        self._line = np.repeat(np.array(visited, dtype=np.intp), [len(each) for each in known])
        self._place = np.concatenate([*known, np.zeros(0, dtype=np.intp)])
        none = np.zeros(0)
        self._x = np.concatenate([*(lines[n].x[each] for n, each in zip(visited, known, strict=True)), none])
        self._y = np.concatenate([*(lines[n].y[each] for n, each in zip(visited, known, strict=True)), none])

    def __len__(self) -> int:
        return len(self._x)

    def nearest(self, window: Window, x: float, y: float) -> Point | None:
        """The one that is nearest by the scale of the window; None where there is none."""
        if not len(self):
            return None
        across, up = (self._x - x) / _width(window.x), (self._y - y) / _width(window.y)
        return self._point(int(np.argmin(across**2 + up**2)))

    def stepped(self, window: Window, point: Point, step: Step, columns: int) -> Point:
        """The next one to a side, or the outermost; of joined lines the next that is in another column."""
        (at,) = np.flatnonzero((self._line == point.line) & (self._place == point.place))
        if step in {"first", "last", "left", "right"}:
            along, across = self._x, self._y
        else:
            along, across = self._y, self._x
        if step in {"first", "lowest"}:
            return self._point(int(np.argmin(along)))
        if step in {"last", "highest"}:
            return self._point(int(np.argmax(along)))
        sign = 1.0 if step in {"right", "up"} else -1.0
        if self._joined and along is self._x:
            same = self._line == point.line
            beyond = same & (sign * (along - along[at]) >= _width(window.x) / max(columns, 1))
            return self._first(beyond, sign * along, point)
        # By the other axis where two are level, else by their order: every one is visited once.
        order = np.lexsort((np.arange(len(along)), across, along))
        place = int(np.flatnonzero(order == at)[0]) + int(sign)
        return self._point(int(order[place])) if 0 <= place < len(order) else point

    def _first(self, among: BoolArray, along: FloatArray, otherwise: Point) -> Point:
        places = np.flatnonzero(among)
        return self._point(int(places[np.argmin(along[places])])) if len(places) else otherwise

    def _point(self, at: int) -> Point:
        return Point(int(self._line[at]), int(self._place[at]))


def _width(of: Range) -> float:
    return (of[1] - of[0]) or 1.0


def _zoomed(of: Range, by: float, about: float) -> Range:
    low, high = about + by * (of[0] - about), about + by * (of[1] - about)
    return (low, high) if high - low > _SMALLEST * max(abs(low), abs(high)) else of


def _moved(of: Range, by: float) -> Range:
    return of[0] + by * _width(of), of[1] + by * _width(of)


def _showing(of: Range, value: float) -> Range:
    if of[0] <= value <= of[1]:
        return of
    return value - 0.5 * _width(of), value + 0.5 * _width(of)
