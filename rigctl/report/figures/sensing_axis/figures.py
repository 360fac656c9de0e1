"""The figures of a sensing-axis result: one SVG and one CSV each, and their captions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rigctl.core.errors import ProcedureError
from rigctl.experiments.sensing_axis.result.budget import Uncertainties, axis_budgets
from rigctl.experiments.sensing_axis.result.result import SensingAxisResult
from rigctl.report.figures.data import Plate, write_plates
from rigctl.report.figures.sensing_axis.budget import budget_plate
from rigctl.report.figures.sensing_axis.null_search import representative, response_plate
from rigctl.report.figures.sensing_axis.nulls import nulls_plate
from rigctl.report.figures.sensing_axis.plane import plane_plate

PLANE_FIGURES = {"X": "fig15", "Y": "fig16", "Z": "fig17"}
"""Figures of the paper by the cube axis an accelerometer measures along."""


def write_figures(
    result: SensingAxisResult, directory: Path, uncertainties: Uncertainties | None = None
) -> list[Path]:
    """Write NAME.svg and NAME.csv of every figure the result allows into `directory`; returns all paths written.

    The last path is `figures.md`: captions, and what was left out for which reason. `uncertainties` are the rig
    file's certificates, for the budget. Raises `DataError` when the directory cannot be written to.
    """
    plates, left_out = plates_of(result, uncertainties)
    return write_plates(plates, left_out, directory)


def plates_of(
    result: SensingAxisResult, uncertainties: Uncertainties | None = None
) -> tuple[list[Plate[Any]], dict[str, str]]:
    """Every figure the result allows, and why what is left out is."""
    plates = [*_response_plates(result), *_plane_plates(result), nulls_plate(result.fit.nulls())]
    left_out = {f"plane of axis {name}": reason for name, reason in result.missing.items()}
    try:
        plates += _budget_plates(result, uncertainties or {})
    except ProcedureError as error:
        left_out["budget"] = str(error)
    return plates, left_out


def _response_plates(result: SensingAxisResult) -> list[Plate[Any]]:
    fit = result.fit
    plates: list[Plate[Any]] = [response_plate("fig12", fit, representative(fit.model.runs))]
    for axis, configuration in dict.fromkeys((run.axis, run.configuration) for run in fit.model.runs):
        own = [run for run in fit.model.runs if (run.axis, run.configuration) == (axis, configuration)]
        plates.append(response_plate(f"fig12_{axis}_{configuration}", fit, representative(own)))
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


def _budget_plates(result: SensingAxisResult, uncertainties: Uncertainties) -> list[Plate[Any]]:
    if not result.axes:
        raise ProcedureError("no axis was found, so there is nothing to budget")
    return [budget_plate(axis_budgets(result, uncertainties))]
