"""The figures of a sensing-axis result: one SVG and one CSV each, and their captions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.experiments.sensing_axis.result.budget import AxisBudget
from rigctl.experiments.sensing_axis.result.result import SensingAxisResult
from rigctl.report.figures.data import Plate
from rigctl.report.figures.sensing_axis.null_search import representative, response_plate
from rigctl.report.figures.sensing_axis.plane import plane_plate
from rigctl.report.figures.sensing_axis.result import budget_plate, nulls_plate

PLANE_FIGURES = {"X": "fig15", "Y": "fig16", "Z": "fig17"}
"""Figures of the paper by the cube axis an accelerometer measures along."""


def plates_of(
    result: SensingAxisResult, budgets: Mapping[str, AxisBudget]
) -> tuple[list[Plate[Any]], dict[str, str]]:
    """Every figure the result allows, and why what is left out is."""
    plates = [*_response_plates(result), *_plane_plates(result), nulls_plate(result.fit.nulls())]
    left_out = {f"plane of axis {name}": reason for name, reason in result.missing.items()}
    if budgets:
        plates.append(budget_plate(budgets))
    else:
        left_out["budget"] = "no axis was found, so there is nothing to budget"
    return plates, left_out


def _response_plates(result: SensingAxisResult) -> list[Plate[Any]]:
    fit = result.fit
    plates: list[Plate[Any]] = [response_plate("fig12", fit, representative(fit.model.runs))]
    for axis, configuration in dict.fromkeys((run.axis, run.configuration) for run in fit.model.runs):
        runs = [run for run in fit.model.runs if (run.axis, run.configuration) == (axis, configuration)]
        plates.append(response_plate(f"fig12_{axis}_{configuration}", fit, representative(runs)))
    return plates


def _plane_plates(result: SensingAxisResult) -> list[Plate[Any]]:
    settings = result.fit.model.package.axes
    return [
        plane_plate(_plane_name(name, settings[name].cube_axis), axis, settings[name])
        for name, axis in result.axes.items()
    ]


def _plane_name(axis: str, cube_axis: str) -> str:
    """fig15 to fig17 for the paper's axes X, Y, Z; another package's sensors carry their own names."""
    return PLANE_FIGURES[axis] if axis == cube_axis else f"plane_{axis}"
