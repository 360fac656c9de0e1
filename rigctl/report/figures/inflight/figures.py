"""Figures of an in-flight calibration: the two estimates beside each other, and the budget before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.inflight.equivalence import equivalence_plates
from rigctl.report.figures.style import INK, series_style
from rigctl.report.quantities import number

SYMBOLS = {
    "ac11_dx_m": "ac11 Δx",
    "ac11_dy_m": "ac11 Δy",
    "ac11_dz_m": "ac11 Δz",
    "ac12_rad": "ac12",
    "ac13_rad": "ac13",
    "ad11": "a′_d11",
    "ad12_rad": "ad12",
    "ad13_rad": "ad13",
    "k2d_s2_m": "K2d/K1c²",
    "k2c_s2_m": "K2c/K1c²",
}
"""The parameters as the paper writes them."""

TERMS = {
    "ac11_dx_m": "ac11 Txx Δx",
    "ac11_dy_m": "ac11 Txy Δy",
    "ac11_dz_m": "ac11 Txz Δz",
    "ac12_rad": "ac12 Tyy Δy",
    "ac13_rad": "ac13 Tzz Δz",
    "ad11": "2 ad11 Γres,x",
    "ad12_rad": "2 ad12 Γres,y",
    "ad13_rad": "2 ad13 Γres,z",
    "k2d_s2_m": "2 K2d (Γapp,dx² + Γres,x²)",
    "k2c_s2_m": "4 K2c Γapp,dx Γres,x",
    "total": "total",
}
"""What each of them leaves in the test (tables 1 and 3)."""

_UNITS = {"1": "", "s2/m": "s²/m"}


@dataclass(frozen=True)
class EstimateRow:
    """A parameter by both estimates; `apart_sigma` is published less joint, in sigmas of the published one."""

    parameter: str
    unit: str
    joint: float
    joint_sigma: float
    published: float
    published_sigma: float
    apart_sigma: float


def plates_of(result: Mapping[str, Any]) -> list[Plate[Any]]:
    """Those of a study of many calibrations, or of one."""
    if "table2" in result:
        return [errors_plate(result), contributions_plate(result)]
    return [estimates_plate(result), *(equivalence_plates(result["ep"]) if "ep" in result else [])]


def estimates_plate(result: Mapping[str, Any]) -> Plate[EstimateRow]:
    """Both estimates of one calibration, relative to what the published one claims to know."""
    rows = [
        EstimateRow(
            name,
            each["unit"],
            each["value"],
            each["sigma"],
            each["paper"]["value"],
            each["paper"]["sigma"],
            (each["paper"]["value"] - each["value"]) / each["paper"]["sigma"],
        )
        for name, each in result["parameters"].items()
        if each["paper"] is not None
    ]
    caption = (
        "Published estimate less joint estimate (circles, with the published one's uncertainty) and the joint one's "
        "own uncertainty (bar), in sigmas of the published estimate."
    )
    return Plate("estimates", caption, rows, draw_estimates)


def draw_estimates(rows: Sequence[EstimateRow]) -> Figure:
    """A row per parameter."""
    figure = Figure(0.8 + 0.24 * len(rows))
    panel = figure.subplots()
    places = np.arange(len(rows))
    joint, paper = series_style(0), series_style(1)
    panel.barh(
        places,
        # One sigma of the joint estimate to either side of zero, where the joint value stands in these differences.
        [2.0 * row.joint_sigma / row.published_sigma for row in rows],
        left=[-row.joint_sigma / row.published_sigma for row in rows],
        height=0.5,
        facecolor=joint.color,
        alpha=0.35,
        label="joint",
    )
    panel.errorbar(
        [row.apart_sigma for row in rows],
        places,
        # Its own sigma is the unit of this axis.
        xerr=1.0,
        fmt=paper.marker,
        color=paper.color,
        capsize=2.0,
        label="published",
    )
    panel.axvline(0.0, color=INK, linewidth=0.6)
    names = [f"{SYMBOLS[row.parameter]}  ±{number(row.published_sigma, 2)}{_unit(row.unit)}" for row in rows]
    return _labelled(figure, names, "difference / sigma of the published estimate")


@dataclass(frozen=True)
class ErrorRow:
    """A parameter of a study: errors against each truth beside the printed ones, in the parameter's unit.

    `over_objective` is the share of draws whose published estimate misses the paper's truth by more.
    """

    parameter: str
    unit: str
    objective: float
    over_objective: float
    printed_mean: float
    printed_worst: float
    published_mean: float
    published_worst: float
    joint_mean: float
    joint_worst: float


def errors_plate(result: Mapping[str, Any]) -> Plate[ErrorRow]:
    """Table 2: mean and worst error over the objective."""
    rows = [
        ErrorRow(
            name,
            each["unit"],
            each["objective"],
            each["over_objective"],
            each["reference"]["mean"],
            each["reference"]["worst"],
            # Each against the truth that it estimates: the paper's forms, of first order, differ from the exact ones.
            each["paper"]["paper_truth"]["mean"],
            each["paper"]["paper_truth"]["worst"],
            each["joint"]["exact_truth"]["mean"],
            each["joint"]["exact_truth"]["worst"],
        )
        for name, each in result["table2"].items()
    ]
    caption = (
        f"Errors of {result['draws']} simulated calibrations over the objective: mean (marker) to worst (line's "
        "end). Printed: table 2 of the paper; published: its estimate against its truth; joint: against exact truth."
    )
    return Plate("table2", caption, rows, draw_errors)


def draw_errors(rows: Sequence[ErrorRow]) -> Figure:
    """Three lines per parameter, on a logarithmic axis."""
    figure = Figure(0.9 + 0.3 * len(rows))
    panel = figure.subplots()
    for series, name in enumerate(("printed", "published", "joint")):
        look = series_style(series)
        for place, row in enumerate(rows):
            mean, worst = (getattr(row, f"{name}_{which}") / row.objective for which in ("mean", "worst"))
            # Above each other, or three lines of one parameter would hide each other.
            at = place + 0.24 * (series - 1)
            panel.plot([mean, worst], [at, at], color=look.color, linestyle="-")
            panel.plot(mean, at, look.marker, color=look.color, label=name if place == 0 else None)
    # 1 is the objective.
    panel.axvline(1.0, color=INK, linewidth=0.6)
    panel.set_xscale("log")
    names = [f"{SYMBOLS[row.parameter]} < {row.objective:g}{_unit(row.unit)}" for row in rows]
    return _labelled(figure, names, "error / objective")


@dataclass(frozen=True)
class ContributionRow:
    """A term of the budget, m/s2 at the frequency of the test; `parameter` is the one whose error makes it."""

    parameter: str
    term: str
    before_m_s2: float
    worst_m_s2: float
    mean_m_s2: float


def contributions_plate(result: Mapping[str, Any]) -> Plate[ContributionRow]:
    """Table 3: the budget before and after."""
    table = result["table3"]
    rows = [
        ContributionRow(name, each["term"], each["before_m_s2"], each["worst_m_s2"], each["mean_m_s2"])
        for name, each in table["rows"].items()
    ]
    totals = (table[key] for key in ("before_m_s2", "total_worst_m_s2", "total_mean_m_s2"))
    rows.append(ContributionRow("total", "total", *totals))
    caption = (
        "What each term leaves at the frequency of the equivalence principle's test, before calibration and after "
        f"(mean and worst of {result['draws']}); the limit is {table['limit_m_s2']:g} m/s2."
    )
    return Plate("table3", caption, rows, draw_contributions)


def draw_contributions(rows: Sequence[ContributionRow]) -> Figure:
    """Markers on a logarithmic axis, the total last."""
    figure = Figure(0.8 + 0.24 * len(rows))
    panel = figure.subplots()
    for series, name in enumerate(("before", "worst", "mean")):
        look = series_style(series)
        values = [getattr(row, f"{name}_m_s2") for row in rows]
        panel.plot(values, range(len(rows)), look.marker, color=look.color, label=name)
    panel.set_xscale("log")
    return _labelled(figure, [TERMS[row.parameter] for row in rows], "contribution / (m/s²)")


def _unit(unit: str) -> str:
    """With the space before it; ratios have none."""
    shown = _UNITS.get(unit, unit)
    return f" {shown}" if shown else ""


def _labelled(figure: Figure, names: Sequence[str], x_label: str) -> Figure:
    """With a name at each row of its panel, the first on top, and a legend below."""
    (panel,) = figure.axes
    panel.set_yticks(range(len(names)), names)
    # Places count from the bottom, tables from the top.
    panel.invert_yaxis()
    panel.set_xlabel(x_label)
    panel.grid("x")
    figure.legend(panel.labelled())
    return figure
