"""The null angle of every mounting with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rigctl.analysis.plane import ARCSEC
from rigctl.experiments.sensing_axis.model.fit import NullPoint
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import new_figure, panel_letter, series_style


@dataclass(frozen=True)
class NullRow:
    """The null of one mounting."""

    axis: str
    configuration: str
    mounting: int
    theta0_deg: float
    theta0_sigma_arcsec: float


def nulls_plate(nulls: Sequence[NullPoint]) -> Plate[NullRow]:
    """Make the figure of all mountings."""
    rows = [
        NullRow(
            null.axis,
            null.configuration,
            null.mounting,
            math.degrees(null.theta0_rad),
            float(null.theta0_sigma_rad) / ARCSEC,
        )
        for null in nulls
    ]
    caption = "Stage angle of the null of every mounting (above) and its standard uncertainty (below)."
    return Plate("nulls", caption, rows, draw_nulls)


def draw_nulls(rows: Sequence[NullRow]) -> Figure:
    """A column per axis: theta0 above, its sigma below."""
    axes_names = list(dict.fromkeys(row.axis for row in rows))
    configurations = list(dict.fromkeys(row.configuration for row in rows))
    figure = new_figure(3.4)
    panels = figure.subplots(2, len(axes_names), sharex="col", sharey="row", squeeze=False, height_ratios=[1.5, 1.0])
    for column, name in enumerate(axes_names):
        above, below = panels[:, column]
        for index, configuration in enumerate(configurations):
            own = [row for row in rows if (row.axis, row.configuration) == (name, configuration)]
            look = series_style(index)
            mountings = [row.mounting for row in own]
            sigma = [row.theta0_sigma_arcsec for row in own]
            above.errorbar(
                mountings,
                [row.theta0_deg for row in own],
                yerr=[arcsec / 3600.0 for arcsec in sigma],
                fmt=look.marker,
                color=look.color,
                label=configuration,
            )
            below.plot(mountings, sigma, look.marker, color=look.color)
        above.set_title(f"axis {name}", loc="center")
        below.set_xlabel("mounting")
        mounted = [row.mounting for row in rows if row.axis == name]
        below.set_xlim(min(mounted) - 0.5, max(mounted) + 0.5)
        below.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    panels[1, 0].set_ylim(0.0, 1.1 * max(row.theta0_sigma_arcsec for row in rows))
    panels[0, 0].set_ylabel("null angle θ₀ / deg")
    panels[1, 0].set_ylabel("σ(θ₀) / arcsec")
    panel_letter(panels[0, 0], "a")
    panel_letter(panels[1, 0], "b")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(configurations))
    return figure
