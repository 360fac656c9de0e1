"""The candidates of a diagnosis, by their significance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import BLUE, INK, SOFT, VERMILION, new_figure
from rigctl.report.verdicts import Findings, named

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
            named(rank["effect"], rank["choice"]),
            rank["effect"] in diagnosis["suggested"],
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
    figure = new_figure(0.7 + 0.2 * len(shown))
    axes = figure.subplots()
    colours = [VERMILION if row.suggested else BLUE for row in shown]
    faces = [VERMILION if row.suggested else "none" for row in shown]
    axes.barh(
        range(len(shown)),
        [row.significance_sigma for row in shown],
        height=0.6,
        color=faces,
        edgecolor=colours,
        linewidth=0.8,
    )
    axes.set_yticks(range(len(shown)), [row.effect for row in shown])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    largest = max((row.significance_sigma for row in shown), default=0.0)
    if largest > 30.0:
        axes.set_xscale("symlog", linthresh=10.0)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlim(0.0, 1.3 * max(largest, 5.0))
    axes.set_xlabel("significance, root of the fall of χ²")
    axes.grid(axis="x", color=SOFT, alpha=0.4, linewidth=0.4)
    axes.axvline(0.0, color=INK, linewidth=0.6)
    axes.tick_params(axis="y", length=0.0)
    return figure
