"""A panel: what is drawn in it, its scales, its words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rigctl.core.arrays import FloatArray
from rigctl.report.chart.marks import Bars, Level, Mark, Series, Words
from rigctl.report.chart.scale import Scale, Ticks

INK, PAPER, GRID = "#000000", "#ffffff", "#8a8a8a"


class Axes:
    """A panel of a figure, filled by calls that are named as matplotlib's are."""

    def __init__(self) -> None:
        self.marks: list[Mark] = []
        self.x, self.y = Scale(), Scale()
        self.shared_x: list[Axes] = []
        self.shared_y: list[Axes] = []
        self.labelled_x, self.labelled_y = True, True
        self.xlabel, self.ylabel, self.title, self.letter = "", "", "", ""
        self.legend_columns: int | None = None
        self.grid_axis = ""
        self.hidden = False
        self.equal = False
        self.ticks_upright = False

    def plot(
        self,
        x: ArrayLike,
        y: ArrayLike,
        fmt: str = "",
        *,
        color: str = INK,
        linestyle: Any = None,
        marker: str = "",
        markersize: float = 4.0,
        markerfacecolor: str = "",
        linewidth: float = 1.0,
        alpha: float = 1.0,
        label: str | None = None,
        titles: Sequence[str] = (),
        zorder: float = 2.0,
    ) -> None:
        """A line, or with a marker as `fmt` markers alone; `titles` are what they say when they are hovered."""
        xs, ys = _numbers(x), _numbers(y)
        dashes = fmt in ("-", "--", "-.", ":")
        marker = marker or ("" if dashes else fmt)
        line = linestyle if linestyle is not None else fmt if dashes else "" if fmt else "-"
        self._add_data(xs, ys)
        self.marks.append(
            Series(
                xs, ys, color, line, marker, markerfacecolor, markersize, linewidth, alpha, label or "",
                titles=titles, order=zorder,
            )
        )  # fmt: skip

    def errorbar(
        self,
        x: ArrayLike,
        y: ArrayLike,
        yerr: Any = None,
        xerr: Any = None,
        *,
        fmt: str,
        color: str = INK,
        markersize: float = 4.0,
        markerfacecolor: str = "",
        capsize: float = 0.0,
        label: str | None = None,
        titles: Sequence[str] = (),
        zorder: float = 2.0,
    ) -> None:
        """Markers with bars: of one length, of one length each, or of two lengths each, below and above."""
        xs, ys = _numbers(x), _numbers(y)
        x_bars, y_bars = _ends(xs, xerr), _ends(ys, yerr)
        self._add_data(xs, ys)
        for bars, scale in ((x_bars, self.x), (y_bars, self.y)):
            if bars is not None:
                scale.data.append(bars)
        self.marks.append(
            Series(
                xs,
                ys,
                color,
                marker=fmt,
                face=markerfacecolor,
                size=markersize,
                label=label or "",
                x_bars=x_bars,
                y_bars=y_bars,
                cap=capsize,
                titles=titles,
                order=zorder,
            )
        )

    def barh(
        self,
        y: ArrayLike,
        width: ArrayLike,
        *,
        left: ArrayLike = 0.0,
        height: float = 0.8,
        facecolor: str | Sequence[str],
        edgecolor: str | Sequence[str] = "",
        hatch: str = "",
        alpha: float = 1.0,
        label: str = "",
    ) -> None:
        """Bars along x."""
        ys, lengths = _numbers(y), _numbers(width)
        lefts = np.broadcast_to(_numbers(left), lengths.shape)
        self.x.data += [np.array(lefts), lefts + lengths]
        self.y.data += [ys - 0.5 * height, ys + 0.5 * height]
        if np.all(lefts == 0.0) and np.all(lengths >= 0.0):
            # Bars stand on the frame.
            self.x.low = 0.0
        self.marks.append(Bars(ys, lefts, lengths, height, _each(facecolor), _each(edgecolor), hatch, alpha, label))

    def axhline(self, at: float, *, color: str = INK, linewidth: float = 1.0, linestyle: Any = "-", label: str = "",
                zorder: float = 1.5) -> None:  # fmt: skip
        """A line at a value of y, from side to side."""
        self.y.data.append(np.array([at]))
        self.marks.append(Level(at, False, color, None, linestyle, linewidth, label=label or "", order=zorder))

    def axvline(self, at: float, *, color: str = INK, linewidth: float = 1.0, linestyle: Any = "-", label: str = "",
                zorder: float = 1.5) -> None:  # fmt: skip
        """A line at a value of x, from bottom to top."""
        self.x.data.append(np.array([at]))
        self.marks.append(Level(at, True, color, None, linestyle, linewidth, label=label or "", order=zorder))

    def axhspan(self, low: float, high: float, *, color: str, alpha: float) -> None:
        """A band between two values of y."""
        self.y.data.append(np.array([low, high]))
        self.marks.append(Level(low, False, color, high, alpha=alpha, order=0.0))

    def axvspan(self, low: float, high: float, *, color: str, alpha: float) -> None:
        """A band between two values of x."""
        self.x.data.append(np.array([low, high]))
        self.marks.append(Level(low, True, color, high, alpha=alpha, order=0.0))

    def text(self, x: float, y: float, text: str, *, share_x: bool = False, share_y: bool = False,
             anchor: str = "start", color: str = INK) -> None:  # fmt: skip
        """Words at a value, or at a share of the panel's width or height."""
        self.marks.append(Words(x, y, text, share_x, share_y, anchor=anchor, color=color))

    def set_xlabel(self, text: str) -> None:
        """What stands below."""
        self.xlabel = text

    def set_ylabel(self, text: str) -> None:
        """What stands at the left."""
        self.ylabel = text

    def set_title(self, text: str) -> None:
        """What stands above."""
        self.title = text

    def set_xlim(self, left: float | None = None, right: float | None = None) -> None:
        """What x shows; None leaves an end to the data."""
        self.x.low, self.x.high = left, right

    def set_ylim(self, bottom: float | None = None, top: float | None = None) -> None:
        """What y shows; None leaves an end to the data, and the larger value first turns the axis over."""
        if bottom is not None and top is not None and bottom > top:
            bottom, top, self.y.inverted = top, bottom, True
        self.y.low, self.y.high = bottom, top

    def set_xscale(self, kind: str, *, linthresh: float = 1.0, plain: bool = False) -> None:
        """ "linear", "log" or "symlog"; `plain` ticks are written in full."""
        self.x.kind, self.x.linear_up_to, self.x.plain = kind, linthresh, plain

    def set_yscale(self, kind: str, *, linthresh: float = 1.0) -> None:
        """ "linear", "log" or "symlog"."""
        self.y.kind, self.y.linear_up_to = kind, linthresh

    def set_xticks(self, places: Sequence[float], labels: Sequence[str] | None = None) -> None:
        """The ticks of x, their labels where they are not the numbers themselves."""
        self.x.chosen = _chosen(places, labels)

    def set_yticks(self, places: Sequence[float], labels: Sequence[str] | None = None) -> None:
        """The ticks of y, their labels where they are not the numbers themselves."""
        self.y.chosen = _chosen(places, labels)

    def invert_yaxis(self) -> None:
        """The first on top."""
        self.y.inverted = True

    def margins(self, *, y: float) -> None:
        """Room above and below the data, as a share of their height."""
        self.y.margin = y

    def grid(self, axis: str = "both") -> None:
        """Thin lines at the ticks of "x", "y" or "both"."""
        self.grid_axis = axis

    def legend(self, ncols: int = 0) -> None:
        """What the labels mean, above the panel, where nothing is drawn; as many in a line as there is room for."""
        self.legend_columns = ncols

    def set_axis_off(self) -> None:
        """Nothing but the room."""
        self.hidden = True

    def labelled(self) -> list[tuple[str, Mark]]:
        """Labels with what they are of, each once."""
        first: dict[str, Mark] = {}
        for mark in self.marks:
            if mark.label:
                first.setdefault(mark.label, mark)
        return list(first.items())

    def limits_x(self) -> tuple[float, float]:
        """What x shows."""
        return self.scale_x().limits([self.x, *(each.x for each in self.shared_x)])

    def limits_y(self) -> tuple[float, float]:
        """What y shows, bottom and top."""
        low, high = self.scale_y().limits([self.y, *(each.y for each in self.shared_y)])
        turned = self.y.inverted or any(each.y.inverted for each in self.shared_y)
        return (high, low) if turned else (low, high)

    def scale_x(self) -> Scale:
        """With what a panel that shares x was told."""
        return _told(self.x, [each.x for each in self.shared_x])

    def scale_y(self) -> Scale:
        """With what a panel that shares y was told."""
        return _told(self.y, [each.y for each in self.shared_y])

    def _add_data(self, x: FloatArray, y: FloatArray) -> None:
        self.x.data.append(x)
        self.y.data.append(y)


def _told(scale: Scale, others: Sequence[Scale]) -> Scale:
    """The first of those who share it that was told anything, if it was not itself."""
    for each in (scale, *others):
        if each.kind != "linear" or each.chosen is not None or each.integer:
            return each
    return scale


def _chosen(places: Sequence[float], labels: Sequence[str] | None) -> Ticks:
    shown = [f"{place:g}".replace("-", "−") for place in places] if labels is None else list(labels)
    return Ticks(list(map(float, places)), shown)


def _numbers(values: ArrayLike) -> FloatArray:
    """None is no number."""
    return np.atleast_1d(np.asarray(values, dtype=np.float64))


def _ends(values: FloatArray, length: Any) -> FloatArray | None:
    if length is None:
        return None
    lengths = np.asarray(length, dtype=np.float64)
    below, above = lengths if lengths.ndim == 2 else (lengths, lengths)
    return np.stack([values - below, values + above])


def _each(color: str | Sequence[str]) -> Sequence[str]:
    return [color] if isinstance(color, str) else color
