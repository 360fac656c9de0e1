"""A plot for a terminal, before it is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from rigctl.core.arrays import FloatArray

Scale = Literal["linear", "log", "symlog"]

MARKS = ("o", "x", "+", "#", "*", "@")


@dataclass(frozen=True, eq=False)
class Line:
    """One series: joined points, or with `mark` single ones; `name` is written in the legend.

    `bars` are the lower and the upper ends of error bars; `labels` say what each point is, a run for example.
    """

    x: FloatArray
    y: FloatArray
    name: str = ""
    mark: str = ""
    colour: int = 0
    bars: tuple[FloatArray, FloatArray] | None = None
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Picture:
    """What a plot shows; ranges are found from the data where none are given.

    Behind a colon in the title stand values of the moment: with others it is the same plot.
    Values, ranges and levels are what they are on an axis of any scale; a logarithmic one leaves out what is not
    positive, "symlog" is linear within one and logarithmic to either side.
    """

    title: str
    lines: tuple[Line, ...] = ()
    x_label: str = ""
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    levels: tuple[tuple[float, str], ...] = ()
    """Horizontal dotted lines, each with what it means."""
    empty: str = "no data yet"
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
