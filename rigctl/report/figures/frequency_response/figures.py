"""Magnitude and phase against frequency, and linearity over the amplitude."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.frequency_response.model import ResponseModel
from rigctl.experiments.frequency_response.result import AtFrequency, Deviation, ResponseResult
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import BLUE, INK, PAPER, SERIES, VERMILION, series_style

CURVE_POINTS = 100


@dataclass(frozen=True)
class Response:
    """One frequency: what was measured with its expanded uncertainty, or, without that, what the model says there."""

    frequency_hz: float
    magnitude_v_s2_m: float
    phase_deg: float
    magnitude_expanded: float | None = None
    phase_expanded_deg: float | None = None


def response_plate(found: ResponseResult, model: ResponseModel, values: FloatArray) -> Plate[Response]:
    """Magnitude and phase with bars of expanded uncertainty, and the model of the current version as a line."""
    rows = [_measured(each) for each in found.frequencies]
    places = np.geomspace(rows[0].frequency_hz, rows[-1].frequency_hz, CURVE_POINTS)
    for frequency_hz, modelled in zip(places.tolist(), model.curve(places, values).tolist(), strict=True):
        rows.append(Response(frequency_hz, abs(modelled), math.degrees(cmath.phase(modelled))))
    caption = "Complex sensitivity: magnitude and phase, bars are expanded uncertainties (95 %); line: the model."
    return Plate("frequency_response", caption, rows, _drawn_response)


def _measured(each: AtFrequency) -> Response:
    (size, phase_deg), (size_u, phase_u) = each.budget.values.tolist(), each.budget.expanded.tolist()
    return Response(each.frequency_hz, size, phase_deg, size_u, phase_u)


def _drawn_response(rows: Sequence[Response]) -> Figure:
    figure = Figure(4.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    points = [row for row in rows if row.magnitude_expanded is not None]
    line = [row for row in rows if row.magnitude_expanded is None]
    names = ("magnitude_v_s2_m", "magnitude_expanded"), ("phase_deg", "phase_expanded_deg")
    for axes, (value, expanded) in zip((upper, lower), names, strict=True):
        x, y, bar = ([getattr(row, name) for row in points] for name in ("frequency_hz", value, expanded))
        axes.errorbar(x, y, bar, fmt="o", color=BLUE, markersize=3.0, capsize=2.0, label="measured")
        axes.plot(
            [row.frequency_hz for row in line], [getattr(row, value) for row in line], color=VERMILION, label="model"
        )
        axes.set_xscale("log", plain=True)
    upper.set_ylabel("|S| / (V/(m/s²))")
    lower.set_ylabel("phase / deg")
    lower.set_xlabel("frequency / Hz")
    upper.legend()
    return figure


def linearity_plate(deviations: Sequence[Deviation]) -> Plate[Deviation]:
    """How the magnitude of each run differs from that of its frequency at small amplitude."""
    caption = (
        "Linearity: magnitude of each run over that at small amplitude, less 1; bars are one sigma. "
        "Frequencies are drawn side by side."
    )
    return Plate("linearity", caption, sorted(deviations, key=lambda d: d.frequency_hz), _drawn_linearity)


def _drawn_linearity(rows: Sequence[Deviation]) -> Figure:
    figure = Figure(3.2)
    axes = figure.subplots()
    frequencies = list(dict.fromkeys(row.frequency_hz for row in rows))
    for place, frequency_hz in enumerate(frequencies):
        # Side by side: frequencies have amplitudes in common.
        look = series_style(place)
        aside = 1.03 ** (place - 0.5 * (len(frequencies) - 1))
        own = sorted((r for r in rows if r.frequency_hz == frequency_hz), key=lambda r: r.acceleration_m_s2)
        axes.errorbar(
            [aside * r.acceleration_m_s2 for r in own],
            [1e6 * r.deviation for r in own],
            [1e6 * r.sigma for r in own],
            fmt=look.marker,
            color=look.color,
            # Beyond the palette's end its colours come again, open.
            markerfacecolor=PAPER if place >= SERIES else "",
            markersize=3.0,
            capsize=2.0,
            label=f"{frequency_hz:g} Hz",
        )
    axes.axhline(0.0, color=INK, linewidth=0.5)
    axes.set_xscale("log", plain=True)
    axes.set_xlabel("amplitude of the acceleration / (m/s²)")
    axes.set_ylabel("deviation / 1e-6")
    axes.legend()
    return figure
