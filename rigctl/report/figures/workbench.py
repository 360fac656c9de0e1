"""Figures of the workbench: what each version of the model brought, and the candidates of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigctl.report.chart.axes import Axes
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import BLUE, INK, VERMILION, series_style
from rigctl.report.verdicts import Findings, change_of, fitted_choice, named, only_rms, rms_unit


@dataclass(frozen=True)
class LadderRow:
    """One version; errors are rms of whitened residuals, 1.00 = noise, None where there is none.

    `rms` is that of the residuals in `unit`, None where there are several channels.
    """

    version: int
    change: str
    error_fit: float | None
    error_held_out: float | None
    rms: float | None
    unit: str


def ladder_plate(rungs: Sequence[Mapping[str, Any]]) -> Plate[LadderRow]:
    """Make the figure from `rigctl model history`."""
    unit = rms_unit(rungs)
    rows = [
        LadderRow(
            r["version"],
            change_of(r),
            r["error_fit"],
            r["error_held_out"],
            None if unit is None else only_rms(r),
            unit or "",
        )
        for r in rungs
    ]
    caption = (
        "Error of each model version: rms of the residuals in units of their noise, on the runs the version was "
        "fitted to and on runs that were held out of the fit. 1.00 is noise."
    )
    if unit is not None:
        caption += " On the right the rms of the residuals in the unit of the readings."
    return Plate("ladder", caption, rows, draw_ladder)


def draw_ladder(rows: Sequence[LadderRow]) -> Figure:
    """A row per version, the first on top; beside it the rms in the readings' unit, where they have one channel."""
    figure = Figure(0.75 + 0.28 * len(rows))
    beside = any(row.rms is not None for row in rows)
    panels = figure.subplots(1, 2 if beside else 1, sharey=True, squeeze=False)[0]
    _draw_errors(panels[0], rows)
    if beside:
        _draw_rms(panels[1], rows)
    return figure


def _draw_rms(axes: Axes, rows: Sequence[LadderRow]) -> None:
    look = series_style(2)
    points = [(row.rms, i) for i, row in enumerate(rows) if row.rms is not None]
    values, places = zip(*points, strict=True)
    axes.plot(values, places, look.marker, color=look.color, linestyle=look.line)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(f"rms of the residuals{f' / ({rows[0].unit})' if rows[0].unit else ''}")
    axes.grid("x")


def _draw_errors(axes: Axes, rows: Sequence[LadderRow]) -> None:
    for index, (name, label) in enumerate(
        (("error_fit", "runs of the fit"), ("error_held_out", "held-out runs")),
    ):
        look = series_style(index)
        points = [(value, i) for i, row in enumerate(rows) if (value := getattr(row, name)) is not None]
        if points:
            values, places = zip(*points, strict=True)
            axes.plot(values, places, look.marker, color=look.color, linestyle=look.line, label=label)
    axes.axvline(1.0, color=INK, linewidth=0.6)
    axes.set_yticks(range(len(rows)), [f"{row.version}  {row.change}" for row in rows])
    # The first on top.
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel("error / noise")
    errors = [e for row in rows for e in (row.error_fit, row.error_held_out) if e]
    # On a linear axis a baseline that is far off would press all later versions together.
    if errors and max(errors) > 5.0 * min(errors):
        axes.set_xscale("log", plain=True)
    axes.grid("x")
    axes.legend()


MAX_ROWS = 16


@dataclass(frozen=True)
class RankRow:
    """One candidate: `significance_sigma` is the root of the fall of chi-square it brings."""

    effect: str
    suggested: bool
    significance_sigma: float
    p_value_corrected: float | None
    held_out_error_ratio: float | None


def ranking_plate(diagnosis: Findings) -> Plate[RankRow]:
    """Make the figure of a diagnosis, from its JSON."""
    rows = [
        RankRow(
            named(rank["effect"], fitted_choice(rank)),
            rank["effect"] in diagnosis["suggested"],
            # For one parameter this is its size in sigmas. Rounding may leave a fall below zero where there is none.
            math.sqrt(max(rank["chi2_fall"] or 0.0, 0.0)),
            rank["p_value_corrected"],
            rank["held_out_error_ratio"],
        )
        for rank in diagnosis["ranking"]
    ]
    caption = (
        "Candidates by the root of the fall of chi-square that each brings beside the others: filled those that were "
        f"suggested. Up to {MAX_ROWS} candidates."
    )
    return Plate("ranking", caption, rows, draw_ranking)


def draw_ranking(rows: Sequence[RankRow]) -> Figure:
    """Horizontal bars, the first of the ranking on top."""
    shown = rows[:MAX_ROWS]
    figure = Figure(0.7 + 0.2 * len(shown))
    axes = figure.subplots()
    colours = [VERMILION if row.suggested else BLUE for row in shown]
    faces = [VERMILION if row.suggested else "none" for row in shown]
    axes.barh(
        range(len(shown)),
        [row.significance_sigma for row in shown],
        height=0.6,
        facecolor=faces,
        edgecolor=colours,
    )
    axes.set_yticks(range(len(shown)), [row.effect for row in shown])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    largest = max((row.significance_sigma for row in shown), default=0.0)
    # Bars begin at zero, which a logarithm does not have; one large bar would hide the others.
    if largest > 30.0:
        axes.set_xscale("symlog", linthresh=10.0)
    axes.set_xlim(0.0, 1.3 * max(largest, 5.0))
    axes.set_xlabel("significance, root of the fall of χ²")
    axes.grid("x")
    axes.axvline(0.0, color=INK, linewidth=0.6)
    return figure
