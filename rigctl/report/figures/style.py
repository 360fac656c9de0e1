"""How the figures look: a palette for all eyes, shapes beside colours, the same bytes for the same numbers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TextIO

import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

WIDTH_IN = 7.1
"""Two columns of a journal, 180 mm."""

INK, SOFT = "#000000", "#8a8a8a"
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
"""Okabe and Ito's palette."""

_RC: dict[str, Any] = {
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.titlesize": 8.0,
    "axes.titlelocation": "left",
    "axes.linewidth": 0.6,
    "axes.formatter.useoffset": False,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "lines.markersize": 4.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "hatch.linewidth": 0.5,
    # Text stays text: it can be searched, and takes the page's colour.
    "svg.fonttype": "none",
    # Else matplotlib draws the ids of clip paths at random, and equal figures differ as files.
    "svg.hashsalt": "rigctl",
}


@dataclass(frozen=True)
class SeriesStyle:
    """Colour, marker and line of one series: each tells it apart by itself."""

    color: str
    marker: str
    line: Any
    hatch: str


_SERIES = (
    SeriesStyle(BLUE, "o", "-", ""),
    SeriesStyle(VERMILION, "s", "--", "////"),
    SeriesStyle(GREEN, "^", "-.", "...."),
    SeriesStyle(PURPLE, "D", ":", "xxxx"),
    SeriesStyle(ORANGE, "v", (0, (5, 1, 1, 1, 1, 1)), "----"),
    SeriesStyle(SKY, "P", (0, (8, 2)), "oooo"),
)


def series_style(index: int) -> SeriesStyle:
    """The look of the series with this number."""
    return _SERIES[index % len(_SERIES)]


@contextmanager
def figure_style() -> Iterator[None]:
    """Draw and save within: matplotlib's defaults with ours, whatever the user's own settings say."""
    # A user's own matplotlibrc must not change figures.
    with matplotlib.style.context(["default", _RC]):
        yield


def new_figure(height_in: float) -> Figure:
    """An empty figure as wide as a page."""
    # Not pyplot, which keeps every figure and may want a display.
    return Figure(figsize=(WIDTH_IN, height_in), layout="constrained")


def panel_letter(axes: Axes, letter: str) -> None:
    """Name a panel at its upper left, above the frame, for the caption to refer to."""
    axes.set_title(f"({letter})", loc="left", fontweight="bold")


def save_svg(figure: Figure, file: TextIO, title: str) -> None:
    """Write a figure as SVG without date or version."""
    # Not `savefig`, which draws all of it once more beforehand to find out how large it is.
    canvas: Any = FigureCanvasSVG(figure)  # it has no types
    canvas.print_svg(file, metadata={"Date": None, "Creator": "rigctl", "Title": title})
