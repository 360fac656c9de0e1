"""How the figures look: a palette for all eyes, shapes beside colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rigctl.report.chart.axes import INK as INK
from rigctl.report.chart.axes import PAPER as PAPER

SOFT = "#8a8a8a"
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
"""Okabe and Ito's palette."""


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


SERIES = len(_SERIES)
"""Series that look different."""


def series_style(index: int) -> SeriesStyle:
    """The look of the series with this number."""
    return _SERIES[index % len(_SERIES)]
