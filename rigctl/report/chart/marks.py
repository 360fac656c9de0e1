"""What stands in a panel: lines with markers, bars, bands and words, each as SVG once it is known where."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.report.chart.text import signed

Place = Callable[[FloatArray], FloatArray]
"""Values along an axis as points of the page."""

MOST_TITLES = 400
"""Markers of one series that can be hovered one by one; more are one shape, with a dot for each place."""

DENSE = 4.0
"""Points of a line for each point of the page, from which on only what is seen of it is drawn."""

_DASHES = {"-": "", "--": "4 2", "-.": "6 2 1 2", ":": "1 2"}


@dataclass(frozen=True)
class Box:
    """Where a panel is on the page."""

    left: float
    top: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Its other side."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Its lower side."""
        return self.top + self.height


@dataclass(frozen=True)
class Series:
    """A line, markers, or both; `titles` are what markers say when they are hovered, else their values."""

    x: FloatArray
    y: FloatArray
    color: str
    line: Any = ""
    marker: str = ""
    face: str = ""
    size: float = 4.0
    width: float = 1.0
    alpha: float = 1.0
    label: str = ""
    x_bars: FloatArray | None = None
    y_bars: FloatArray | None = None
    cap: float = 0.0
    titles: Sequence[str] = ()
    order: float = 2.0

    def svg(self, at_x: Place, at_y: Place, box: Box) -> Iterator[str]:
        """All of it."""
        x, y = at_x(self.x), at_y(self.y)
        seen = np.isfinite(x) & np.isfinite(y)
        if self.line and self.line != "none" and seen.sum() > 1:
            yield self._line(x, y, seen, box)
        yield from self._bars(at_x, at_y, seen)
        if self.marker and seen.any():
            yield from self._markers(x, y, seen)

    def _line(self, x: FloatArray, y: FloatArray, seen: np.ndarray, box: Box) -> str:
        if x.size > DENSE * box.width:
            x, y, seen = _as_seen(x, y, seen)
        words, pen = [], "M"
        for a, b, there in zip(x.tolist(), y.tolist(), seen.tolist(), strict=True):
            if there:
                words.append(f"{pen}{_number(a)} {_number(b)}")
            pen = "L" if there else "M"
        dashes = dashes_of(self.line)
        return (
            f'<path d="{"".join(words)}" fill="none" stroke="{self.color}" stroke-width="{self.width:g}"'
            f"{dashes}{_opacity(self.alpha)}/>"
        )

    def _bars(self, at_x: Place, at_y: Place, seen: np.ndarray) -> Iterator[str]:
        d = []
        for bars, along, across, upright in (
            (self.x_bars, at_x, at_y(self.y), False),
            (self.y_bars, at_y, at_x(self.x), True),
        ):
            if bars is None:
                continue
            lows, highs = along(bars[0]), along(bars[1])
            there = seen & np.isfinite(highs)
            # A bar that reaches below a logarithmic axis reaches down to its end.
            for low, high, beside in zip(
                lows[there].tolist(), highs[there].tolist(), across[there].tolist(), strict=True
            ):
                low = low if np.isfinite(low) else high + (2000.0 if upright else -2000.0)
                d.append(_segment(low, high, beside, upright=upright))
                if self.cap:
                    d += [
                        _segment(beside - self.cap, beside + self.cap, end, upright=not upright)
                        for end in (low, high)
                    ]
        if d:
            yield f'<path d="{"".join(d)}" fill="none" stroke="{self.color}" stroke-width="0.7"/>'

    def _markers(self, x: FloatArray, y: FloatArray, seen: np.ndarray) -> Iterator[str]:
        shape, filled = marker_shape(self.marker, self.size)
        fill = (self.face or self.color) if filled else "none"
        look = f'fill="{fill}" stroke="{self.color}" stroke-width="{0.7 if filled else 1:g}"{_opacity(self.alpha)}'
        places = np.flatnonzero(seen)
        if places.size > MOST_TITLES:
            # Where two dots would be one dot, there is one; a line of no length with round ends is a dot.
            grid = max(0.5, 0.25 * self.size)
            dots = np.unique(np.round(np.stack([x[places], y[places]], axis=1) / grid), axis=0) * grid
            d = "".join(f"M{_number(a)} {_number(b)}h0" for a, b in dots.tolist())
            round_ends = f'stroke-width="{self.size:g}" stroke-linecap="round"'
            yield f'<path class="dots" d="{d}" fill="none" stroke="{self.color}" {round_ends}{_opacity(self.alpha)}/>'
            return
        drawn = []
        for k in places.tolist():
            title = escape(self._title(k), quote=False)
            drawn.append(f'<path d="M{_number(x[k])} {_number(y[k])}{shape}"><title>{title}</title></path>')
        yield f'<g class="m" {look}>{"".join(drawn)}</g>'

    def _title(self, k: int) -> str:
        values = signed(f"{self.x[k]:.6g}, {self.y[k]:.6g}")
        return ": ".join(filter(None, [self.titles[k] if len(self.titles) else self.label, values]))

    def swatch(self, x: float, y: float) -> str:
        """What stands in a legend, 18 points wide from x on."""
        shown = []
        if self.line and self.line != "none":
            shown.append(
                f'<path d="M{_number(x)} {_number(y)}h18" fill="none" stroke="{self.color}" '
                f'stroke-width="{self.width:g}"{dashes_of(self.line)}/>'
            )
        if self.marker:
            shape, filled = marker_shape(self.marker, max(self.size, 3.0))
            fill = (self.face or self.color) if filled else "none"
            shown.append(
                f'<path d="M{_number(x + 9.0)} {_number(y)}{shape}" fill="{fill}" stroke="{self.color}" '
                'stroke-width="0.7"/>'
            )
        return "".join(shown)


@dataclass(frozen=True)
class Bars:
    """Bars from `left` to `left + length`, their middles at `y`; hatched where there is a `hatch`."""

    y: FloatArray
    left: FloatArray
    length: FloatArray
    height: float
    face: Sequence[str]
    edge: Sequence[str]
    hatch: str = ""
    alpha: float = 1.0
    label: str = ""
    order: float = 1.0

    def svg(self, at_x: Place, at_y: Place, _box: Box) -> Iterator[str]:
        """A rectangle each, its length as its title."""
        starts, ends = at_x(self.left), at_x(self.left + self.length)
        tops, bottoms = at_y(self.y - 0.5 * self.height), at_y(self.y + 0.5 * self.height)
        for k in np.flatnonzero(np.isfinite(starts) & np.isfinite(ends)).tolist():
            x, y = sorted((starts[k], ends[k])), sorted((tops[k], bottoms[k]))
            title = ": ".join(filter(None, [self.label, signed(f"{self.length[k]:.4g}")]))
            yield self._rectangle(x[0], y[0], x[1] - x[0], y[1] - y[0], k, title)

    def _rectangle(self, x: float, y: float, wide: float, high: float, k: int, title: str) -> str:
        face, edge = self.face[k % len(self.face)], self.edge[k % len(self.edge)]
        stroke = f' stroke="{edge}" stroke-width="0.7"' if edge else ""
        inside = f"<title>{escape(title, quote=False)}</title>" if title else ""
        drawn = (
            f'<rect x="{_number(x)}" y="{_number(y)}" width="{_number(wide)}" height="{_number(high)}" '
            f'fill="{face}"{stroke}{_opacity(self.alpha)}>{inside}</rect>'
        )
        if self.hatch and wide > 0.0:
            # Strokes of 45 degrees, three points apart, within the bar.
            starts = np.arange(x - high, x + wide, 3.0)
            d = "".join(_hatch(at, x, y, wide, high) for at in starts.tolist())
            drawn += f'<path d="{d}" fill="none" stroke="{edge or face}" stroke-width="0.4"/>'
        return drawn

    def swatch(self, x: float, y: float) -> str:
        """What stands in a legend."""
        return self._rectangle(x, y - 3.0, 18.0, 6.0, 0, "")


def _hatch(at: float, x: float, y: float, wide: float, high: float) -> str:
    first, last = max(at, x), min(at + high, x + wide)
    return f"M{_number(first)} {_number(y + high - (first - at))}L{_number(last)} {_number(y + high - (last - at))}"


@dataclass(frozen=True)
class Level:
    """A line, or a band with `end`, across the panel: at a value of x where `upright`."""

    at: float
    upright: bool
    color: str
    end: float | None = None
    line: Any = "-"
    width: float = 1.0
    alpha: float = 1.0
    label: str = ""
    order: float = 1.5

    def svg(self, at_x: Place, at_y: Place, box: Box) -> Iterator[str]:
        """From one side of the panel to the other."""
        along = at_x if self.upright else at_y
        first = float(along(np.array([self.at]))[0])
        if self.end is None:
            span = (box.top, box.bottom) if self.upright else (box.left, box.right)
            d = _segment(*span, first, upright=self.upright)
            yield (
                f'<path d="{d}" fill="none" stroke="{self.color}" stroke-width="{self.width:g}"'
                f"{dashes_of(self.line)}{_opacity(self.alpha)}/>"
            )
            return
        low, high = sorted((first, float(along(np.array([self.end]))[0])))
        x, y = (low, box.top) if self.upright else (box.left, low)
        wide, tall = (high - low, box.height) if self.upright else (box.width, high - low)
        yield (
            f'<rect x="{_number(x)}" y="{_number(y)}" width="{_number(wide)}" height="{_number(tall)}" '
            f'fill="{self.color}"{_opacity(self.alpha)}/>'
        )

    def swatch(self, x: float, y: float) -> str:
        """What stands in a legend."""
        d = f"M{_number(x + 9.0)} {_number(y - 4.0)}v8" if self.upright else f"M{_number(x)} {_number(y)}h18"
        return (
            f'<path d="{d}" fill="none" stroke="{self.color}" stroke-width="{self.width:g}"{dashes_of(self.line)}/>'
        )


@dataclass(frozen=True)
class Words:
    """A text at a value, or at a share of the panel's width or height from its lower left."""

    x: float
    y: float
    text: str
    share_x: bool = False
    share_y: bool = False
    size: float = 7.0
    anchor: str = "start"
    color: str = "#000000"
    order: float = 3.0
    label: str = ""

    def svg(self, at_x: Place, at_y: Place, box: Box) -> Iterator[str]:
        """The text."""
        x = box.left + self.x * box.width if self.share_x else float(at_x(np.array([self.x]))[0])
        y = box.bottom - self.y * box.height if self.share_y else float(at_y(np.array([self.y]))[0])
        yield words(x, y + 0.35 * self.size, self.text, self.size, self.anchor, color=self.color)

    def swatch(self, _x: float, _y: float) -> str:
        """Words have none."""
        return ""


Mark = Series | Bars | Level | Words


def words(
    x: float,
    y: float,
    text: str,
    size: float,
    anchor: str = "start",
    *,
    color: str = "",
    bold: bool = False,
    turned: bool = False,
) -> str:
    """A text with its base line at a place; upright, read from below, where `turned`; a line each for \\n."""
    lines = text.split("\n")
    look = ' font-weight="bold"' if bold else ""
    look += f' fill="{color}"' if color and color != "#000000" else ""
    look += "" if anchor == "start" else f' text-anchor="{anchor}"'
    look += f' transform="rotate(-90 {_number(x)} {_number(y)})"' if turned else ""
    head = f'<text x="{_number(x)}" y="{_number(y)}" font-size="{size:g}"{look}>'
    if len(lines) == 1:
        return f"{head}{escape(text, quote=False)}</text>"
    spans = "".join(
        f'<tspan x="{_number(x)}" y="{_number(y + 1.15 * size * k)}">{escape(line, quote=False)}</tspan>'
        for k, line in enumerate(lines)
    )
    return f"{head}{spans}</text>"


def marker_shape(marker: str, size: float) -> tuple[str, bool]:
    """A marker as a path from its middle on, and whether it is filled."""
    r = 0.5 * size
    shapes = {
        "o": f"m{-r:g} 0a{r:g} {r:g} 0 1 0 {size:g} 0a{r:g} {r:g} 0 1 0 {-size:g} 0z",
        "s": f"m{-r:g} {-r:g}h{size:g}v{size:g}h{-size:g}z",
        "^": f"m0 {-r:g}l{r:g} {size:g}h{-size:g}z",
        "v": f"m0 {r:g}l{r:g} {-size:g}h{-size:g}z",
        "D": f"m0 {-1.2 * r:g}l{1.2 * r:g} {1.2 * r:g}l{-1.2 * r:g} {1.2 * r:g}l{-1.2 * r:g} {-1.2 * r:g}z",
        "P": f"m{-r:g} {-0.3 * r:g}h{0.7 * r:g}v{-0.7 * r:g}h{0.6 * r:g}v{0.7 * r:g}h{0.7 * r:g}v{0.6 * r:g}"
        f"h{-0.7 * r:g}v{0.7 * r:g}h{-0.6 * r:g}v{-0.7 * r:g}h{-0.7 * r:g}z",
        "x": f"m{-r:g} {-r:g}l{size:g} {size:g}m0 {-size:g}l{-size:g} {size:g}",
        "_": f"m{-r:g} 0h{size:g}",
    }
    dot = 0.5 * r
    return shapes.get(
        marker, f"m{-dot:g} 0a{dot:g} {dot:g} 0 1 0 {r:g} 0a{dot:g} {dot:g} 0 1 0 {-r:g} 0z"
    ), marker not in "x_"


def dashes_of(line: Any) -> str:
    """A style of line, by its sign or by lengths, as an attribute."""
    dashes = _DASHES.get(line, "") if isinstance(line, str) else " ".join(f"{each:g}" for each in line[1])
    return f' stroke-dasharray="{dashes}"' if dashes else ""


def _as_seen(x: FloatArray, y: FloatArray, seen: np.ndarray) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """First, lowest, highest and last of each half point of the page: a line through these covers the same."""
    x, y = x[seen], y[seen]
    cells = np.floor(2.0 * x)
    starts = np.flatnonzero(np.diff(cells, prepend=np.nan) != 0.0)
    kept = set()
    for first, end in zip(starts.tolist(), [*starts[1:].tolist(), x.size], strict=True):
        kept |= {first, first + int(np.argmin(y[first:end])), first + int(np.argmax(y[first:end])), end - 1}
    places = np.array(sorted(kept))
    return x[places], y[places], np.ones(places.size, dtype=bool)


def _segment(first: float, last: float, beside: float, *, upright: bool) -> str:
    if upright:
        return f"M{_number(beside)} {_number(first)}V{_number(last)}"
    return f"M{_number(first)} {_number(beside)}H{_number(last)}"


def _number(value: float) -> str:
    """A place on the page, to a hundredth of a point; what is far outside is not drawn as far."""
    return f"{min(max(float(value), -9999.0), 9999.0):.2f}".rstrip("0").rstrip(".")


def _opacity(alpha: float) -> str:
    return "" if alpha == 1.0 else f' opacity="{alpha:g}"'
