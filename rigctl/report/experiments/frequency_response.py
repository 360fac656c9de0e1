"""What is printed and drawn of a frequency response."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.experiments.frequency_response.analysis import analyse, result
from rigctl.experiments.frequency_response.model import ResponseModel
from rigctl.report.drawn import Drawn
from rigctl.report.quantities import quantity
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.tables.workbench import parameters_table
from rigctl.workbench.study_base import own_model
from rigctl.workbench.workbench import Workbench

if TYPE_CHECKING:
    from rigctl.report.figures.data import Plate


def tables(found: Mapping[str, Any], reference: Mapping[str, Any]) -> list[ResultTable]:
    """Sensitivities, their budget, linearity, and the parameters of the model."""
    del reference
    return [_sensitivities(found), _budget(found), _linearity(found), parameters_table(found)]


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """The response with its model, and linearity."""
    from rigctl.report.figures.frequency_response import figures  # drawing, which a printed result does without

    del lines_hz, found
    amounts, fit = analyse(workbench), workbench.fitted()
    model = own_model(workbench.study.model(workbench.current.terms), ResponseModel)
    values = np.array([fit.parameters[each.name].value for each in model.parameters])
    plates: list[Plate[Any]] = [figures.response_plate(amounts, model, values)]
    left_out = {}
    if amounts.linearity.deviations:
        plates.append(figures.linearity_plate(amounts.linearity.deviations))
    else:
        left_out["linearity"] = "no frequency was driven with two amplitudes"
    return Drawn(result(workbench), plates, left_out=left_out)


def _sensitivities(found: Mapping[str, Any]) -> ResultTable:
    rows = []
    for each in found["sensitivity"]:
        size, phase = each["magnitude"], each["phase_deg"]
        # Of two significant digits of the expanded uncertainty.
        shown = [
            f"{size['value']:.6g}",
            f"{1e2 * size['u'] / size['value']:.2g}",
            f"{1e2 * size['U'] / size['value']:.2g}",
        ]
        shown += [f"{phase['value']:.4f}", f"{phase['U']:.2g}", f"{size['k']:.2f}", str(each["runs"])]
        rows.append([f"{each['frequency_hz']:g}", *shown])
    columns = ["#f [Hz]", "#|S| [V/(m/s2)]", "#u [%]", "#U [%]", "#phase [deg]", "#U [deg]", "#k", "#runs"]
    scattered = [each["scatter_beyond_noise"] for each in found["sensitivity"]]
    bold = "bold: the runs of this frequency scatter more than their noise, as amplitudes or directions differ"
    notes = [*([bold] if any(scattered) else []), *found["remarks"]]
    words = "Complex sensitivity; U = k u is the expanded uncertainty for 95 %."
    return ResultTable(words, columns, rows, marked=scattered, notes=notes)


def _budget(found: Mapping[str, Any]) -> ResultTable:
    rows = []
    for each in found["sensitivity"]:
        size = each["magnitude"]["value"]
        for name, part in each["budget"].items():
            rows.append(
                [
                    f"{each['frequency_hz']:g}",
                    name,
                    f"{1e6 * part['magnitude'] / size:.3g}",
                    f"{part['phase_deg']:.2g}",
                ]
            )
    columns = ["#f [Hz]", "contribution", "#|S| [1e-6]", "#phase [deg]"]
    return ResultTable("Uncertainty budget: standard uncertainties.", columns, rows, tab="Budget", printed=False)


def _linearity(found: Mapping[str, Any]) -> ResultTable:
    kappa, rows = found["linearity"]["kappa"], []
    if kappa is not None:
        rows.append(["kappa", quantity(kappa["value"], kappa["sigma"], kappa["unit"])])
        largest = found["linearity"]["largest_deviation"]
        rows.append(
            [f"largest deviation (run {largest['run_id']})", quantity(largest["value"], largest["sigma"], "")]
        )
    if (both := found["direction_asymmetry"]) is not None:
        rows.append(["half the difference of the directions", quantity(both["value"], both["sigma"], "")])
    return ResultTable("Linearity, |S| = |S0| (1 + kappa A^2), and directions.", ["quantity", "#value"], rows)
