"""The null angle of every mounting, and the uncertainty budget of each axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.plane import ARCSEC
from rigctl.experiments.sensing_axis.model.fit import NullPoint
from rigctl.experiments.sensing_axis.result.budget import AxisBudget
from rigctl.report.chart.axes import Axes
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, PAPER, series_style


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
    figure = Figure(3.4)
    panels = figure.subplots(2, len(axes_names), sharex="col", sharey="row", squeeze=False, height_ratios=[1.5, 1.0])
    for column, name in enumerate(axes_names):
        above, below = panels[:, column]
        for index, configuration in enumerate(configurations):
            nulls = [row for row in rows if (row.axis, row.configuration) == (name, configuration)]
            look = series_style(index)
            mountings = [row.mounting for row in nulls]
            sigma = [row.theta0_sigma_arcsec for row in nulls]
            above.errorbar(
                mountings,
                [row.theta0_deg for row in nulls],
                # Arcseconds vanish on an axis of degrees: sigma has a panel of its own below.
                yerr=[arcsec / 3600.0 for arcsec in sigma],
                fmt=look.marker,
                color=look.color,
                label=configuration,
            )
            below.plot(mountings, sigma, look.marker, color=look.color)
        above.set_title(f"axis {name}")
        below.set_xlabel("mounting")
        mounted = [row.mounting for row in rows if row.axis == name]
        below.set_xlim(min(mounted) - 0.5, max(mounted) + 0.5)
        below.x.integer = True
    panels[1, 0].set_ylim(0.0, 1.1 * max(row.theta0_sigma_arcsec for row in rows))
    panels[0, 0].set_ylabel("null angle θ₀ / deg")
    panels[1, 0].set_ylabel("σ(θ₀) / arcsec")
    panels[0, 0].letter = "a"
    panels[1, 0].letter = "b"
    figure.legend(panels[0, 0].labelled())
    return figure


COMBINED = "combined"


@dataclass(frozen=True)
class BudgetRow:
    """A contribution to the two components of an axis perpendicular to it, 1 sigma."""

    axis: str
    contribution: str
    component_1_arcsec: float
    component_2_arcsec: float


def budget_plate(budgets: Mapping[str, AxisBudget]) -> Plate[BudgetRow]:
    """Make the figure of all axes."""
    rows = [row for budget in budgets.values() for row in _rows(budget)]
    caption = (
        "Standard uncertainty of each sensing axis by its contributions. Component 1: along the motion at the "
        "pendulum nulls; component 2: perpendicular to it and to the axis."
    )
    return Plate("budget", caption, rows, draw_budget)


def _rows(axis: AxisBudget) -> list[BudgetRow]:
    first = axis.budget
    # The sign says which way a contribution turns the axis; bars show how far.
    sizes = np.abs(first.components) / ARCSEC
    combined = first.standard_uncertainty / ARCSEC
    rows = [
        BudgetRow(axis.axis, each.name, float(sizes[0, i]), float(sizes[1, i]))
        for i, each in enumerate(first.contributions)
    ]
    return [*rows, BudgetRow(axis.axis, COMBINED, float(combined[0]), float(combined[1]))]


def draw_budget(rows: Sequence[BudgetRow]) -> Figure:
    """A column per axis, contributions from the largest down, the combined uncertainty last."""
    names = _ranked(rows)
    axes_names = list(dict.fromkeys(row.axis for row in rows))
    figure = Figure(0.9 + 0.21 * len(names))
    panels = figure.subplots(1, len(axes_names), sharey=True, sharex=True, squeeze=False)[0]
    for panel, name in zip(panels, axes_names, strict=True):
        _draw_axis(panel, [row for row in rows if row.axis == name], names)
        panel.set_title(f"axis {name}")
        panel.set_xlabel("standard uncertainty / arcsec")
    panels[0].set_yticks(range(len(names)), names)
    # Downwards: the largest is on top.
    panels[0].set_ylim(len(names) - 0.4, -0.6)
    figure.legend(panels[0].labelled())
    return figure


def _ranked(rows: Sequence[BudgetRow]) -> list[str]:
    # One order for all axes, which share their labels: by the larger component, on whichever axis.
    largest: dict[str, float] = {}
    for row in rows:
        size = max(row.component_1_arcsec, row.component_2_arcsec)
        largest[row.contribution] = max(size, largest.get(row.contribution, 0.0))
    return sorted(largest, key=lambda name: (name == COMBINED, -largest[name]))


def _draw_axis(panel: Axes, rows: Sequence[BudgetRow], names: Sequence[str]) -> None:
    places = np.array([names.index(row.contribution) for row in rows])
    for component in (1, 2):
        look = series_style(component - 1)
        panel.barh(
            places + (0.2 if component == 2 else -0.2),
            [getattr(row, f"component_{component}_arcsec") for row in rows],
            height=0.36,
            facecolor=look.color if component == 1 else PAPER,
            edgecolor=look.color,
            hatch=look.hatch,
            label=f"component {component}",
        )
    # Sets off the combined uncertainty, which is last.
    panel.axhline(len(names) - 1.5, color=INK, linewidth=0.6)
    panel.grid("x")
