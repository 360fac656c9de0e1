"""Magnitude and phase against frequency, and linearity over the amplitude."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from rigctl.core.arrays import FloatArray
from rigctl.experiments.frequency_response.model import ResponseModel
from rigctl.experiments.frequency_response.result import Deviation, ResponseResult
from rigctl.report.figures.data import Plate


@dataclass(frozen=True)
class Response:
    """One frequency: what was measured with its expanded uncertainty, and what the model says there."""

    frequency_hz: float
    magnitude_v_s2_m: float
    magnitude_expanded: float
    phase_deg: float
    phase_expanded_deg: float
    model_magnitude_v_s2_m: float
    model_phase_deg: float


def response_plate(found: ResponseResult, model: ResponseModel, values: FloatArray) -> Plate[Response]:
    """Magnitude and phase with bars of expanded uncertainty, and the model of the current version."""
    asked = np.array([run.number("frequency_hz") for run in model.data.runs])
    predicted = model.response(values)
    rows = []
    for each in found.frequencies:
        modelled = complex(predicted[asked == each.frequency_hz].mean())
        (size, phase_deg), (size_u, phase_u) = each.budget.values, each.budget.expanded
        model_deg = math.degrees(cmath.phase(modelled))
        rows.append(Response(each.frequency_hz, size, size_u, phase_deg, phase_u, abs(modelled), model_deg))
    caption = "Complex sensitivity: magnitude and phase, bars are expanded uncertainties (95 %); line: the model."
    return Plate("frequency_response", caption, rows, _drawn_response)


def _drawn_response(rows: Sequence[Response]) -> Figure:
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    f = [row.frequency_hz for row in rows]
    bars = {"fmt": "o", "markersize": 3, "capsize": 2, "label": "measured"}
    upper.errorbar(f, [r.magnitude_v_s2_m for r in rows], [r.magnitude_expanded for r in rows], **bars)
    upper.plot(f, [r.model_magnitude_v_s2_m for r in rows], linewidth=0.8, label="model")
    upper.set(ylabel="|S| [V/(m/s²)]", xscale="log")
    lower.errorbar(f, [r.phase_deg for r in rows], [r.phase_expanded_deg for r in rows], **bars)
    lower.plot(f, [r.model_phase_deg for r in rows], linewidth=0.8, label="model")
    lower.set(ylabel="phase [deg]", xlabel="frequency [Hz]")
    upper.legend()
    return figure


def linearity_plate(deviations: Sequence[Deviation]) -> Plate[Deviation]:
    """How the magnitude of each run differs from that of its frequency at small amplitude."""
    caption = "Linearity: magnitude of each run over that at small amplitude, less 1; bars are one sigma."
    return Plate("linearity", caption, sorted(deviations, key=lambda d: d.frequency_hz), _drawn_linearity)


def _drawn_linearity(rows: Sequence[Deviation]) -> Figure:
    figure = Figure(figsize=(6.0, 3.5), layout="constrained")
    axes = figure.subplots()
    for frequency_hz in dict.fromkeys(row.frequency_hz for row in rows):
        own = sorted((r for r in rows if r.frequency_hz == frequency_hz), key=lambda r: r.acceleration_m_s2)
        axes.errorbar(
            [r.acceleration_m_s2 for r in own],
            [1e6 * r.deviation for r in own],
            [1e6 * r.sigma for r in own],
            fmt="o",
            markersize=3,
            capsize=2,
            label=f"{frequency_hz:g} Hz",
        )
    axes.axhline(0.0, color="black", linewidth=0.5)
    axes.set(xlabel="amplitude of the acceleration [m/s²]", ylabel="deviation [1e-6]", xscale="log")
    axes.legend(fontsize="x-small", ncols=3)
    return figure
