"""The signed response against the stage's angle, one line per drive frequency (figure 12 of Lucente et al. 2022)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rigctl.analysis.plane import ARCSEC
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.model.fit import NullPoint, RecordingFit
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.report.chart.axes import Axes
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, PAPER, SOFT, series_style

UM_PER_M, MM_PER_M = 1e6, 1e3
SAME_FREQUENCY = 0.01
"""Drive frequencies closer than this, relatively, are one series: clocks differ."""

ZOOM_ARCSEC = 90.0
"""Runs nearer to the null than this are shown in the close-up."""

_GRID = 81


@dataclass(frozen=True)
class ResponseRow:
    """One drawn number: a run, a point of the fitted line, the null, or the zero of one frequency's line.

    The response is the in-phase amplitude divided by gain and motion amplitude (eq. 5: rho1 g cos + w^2 sin).
    """

    axis: str
    configuration: str
    mounting: int
    kind: Literal["measured", "model", "null", "apparent null"]
    run_id: str
    frequency_hz: float | None
    theta_deg: float
    theta_minus_theta0_arcsec: float
    theta_sigma_arcsec: float | None
    response_um_s2_per_mm: float
    response_sigma_um_s2_per_mm: float | None


def response_plate(name: str, fit: RecordingFit, runs: Sequence[RunObservables]) -> Plate[ResponseRow]:
    """Make the figure of one mounting from its runs."""
    first = runs[0]
    null = fit.null(*first.place)
    caption = (
        f"Response in phase with the displacement, divided by gain and motion amplitude, against the stage's angle: "
        f"axis {first.axis}, {first.configuration}, mounting {first.mounting}. (a) All runs; (b) close to the null. "
        f"Points: runs with 1 sigma; lines: fitted model; diamond and band: the null theta0 = "
        f"{math.degrees(null.theta0_rad):.5f} deg ± {null.theta0_sigma_rad / ARCSEC:.2f} arcsec; open markers: "
        f"where each frequency alone would put it."
    )
    return Plate(name, caption, _rows(fit, null, runs), draw_response)


def representative(runs: Iterable[RunObservables]) -> list[RunObservables]:
    """The runs of the mounting with most drive frequencies, then most runs, then the first."""
    mountings: dict[tuple[str, str, int], list[RunObservables]] = {}
    for run in runs:
        mountings.setdefault(run.place, []).append(run)
    return max(mountings.values(), key=lambda members: (len(by_frequency(members)), len(members)))


def by_frequency(runs: Iterable[RunObservables]) -> list[list[RunObservables]]:
    """Runs grouped by drive frequency, lowest first."""
    groups: list[list[RunObservables]] = []
    # Sorted, so that one comparison with the group's lowest is enough.
    for run in sorted(runs, key=lambda run: run.frequency_hz):
        if groups and run.frequency_hz < groups[-1][0].frequency_hz * (1.0 + SAME_FREQUENCY):
            groups[-1].append(run)
        else:
            groups.append([run])
    return groups


def _rows(fit: RecordingFit, null: NullPoint, runs: Sequence[RunObservables]) -> list[ResponseRow]:
    rows: list[ResponseRow] = []
    gain = fit.result.value(f"gain[{null.axis},{null.configuration}]")
    theta = _grid(null, runs)
    at_null: list[float] = []
    for members in by_frequency(runs):
        frequency = float(np.mean([run.frequency_hz for run in members]))
        for run in sorted(members, key=lambda run: run.theta_rad):
            scale = _scale(gain, run)
            accel = run.accel_v
            value, sigma = scale * float(accel.value[1].real), scale * float(accel.sigma[1])
            rows.append(_row("measured", null, run.theta_rad, value, frequency, sigma, run.run_id))
        # A line holds for one set of conditions: those of the run closest to the null.
        template = min(members, key=lambda run: abs(run.theta_rad - null.theta0_rad))
        line = _scale(gain, template) * _predicted(fit, template, theta)
        rows += [_row("model", null, t, y, frequency) for t, y in zip(theta, line, strict=True)]
        zeros = sorted(_zeros(theta, line), key=lambda zero: abs(zero - null.theta0_rad))
        # A line may cross zero again far away; the crossing near the null is meant.
        rows += [_row("apparent null", null, zero, 0.0, frequency) for zero in zeros[:1]]
        at_null.append(float(np.interp(null.theta0_rad, theta, line)))
    # The lines of all frequencies cross there, not at zero but at what the guide's twist leaves (rho1 g, eq. 5).
    rows.append(_row("null", null, null.theta0_rad, float(np.mean(at_null))))
    return rows


def _row(
    kind: Literal["measured", "model", "null", "apparent null"],
    null: NullPoint,
    theta_rad: float,
    response: float,
    frequency_hz: float | None = None,
    sigma: float | None = None,
    run_id: str = "",
) -> ResponseRow:
    return ResponseRow(
        null.axis,
        null.configuration,
        null.mounting,
        kind,
        run_id,
        frequency_hz,
        math.degrees(theta_rad),
        float(theta_rad - null.theta0_rad) / ARCSEC,
        float(null.theta0_sigma_rad) / ARCSEC if kind == "null" else None,
        float(response),
        sigma,
    )


def _scale(gain_v_per_m_s2: float, run: RunObservables) -> float:
    # Volts over gain and amplitude: eq. 5 as an acceleration by millimetre of motion.
    return UM_PER_M / (gain_v_per_m_s2 * run.amplitude_m * MM_PER_M)


def _grid(null: NullPoint, runs: Sequence[RunObservables]) -> FloatArray:
    """Angles of the model's lines: all over the runs' range, and densely around the null."""
    # The close-up adds a margin to its runs: twice as far, lines reach its edges.
    near = 2.0 * ZOOM_ARCSEC * ARCSEC
    angles = [null.theta0_rad - near, null.theta0_rad + near, *(run.theta_rad for run in runs)]
    wide = np.linspace(min(angles), max(angles), _GRID)
    close = null.theta0_rad + np.linspace(-near, near, _GRID)
    return np.unique(np.concatenate([wide, close]))


def _predicted(fit: RecordingFit, template: RunObservables, theta_rad: FloatArray) -> FloatArray:
    """In-phase amplitude [V] the fitted model gives at other angles under a run's conditions."""
    model = fit.model.with_runs([replace(template, theta_rad=float(t), lasers_m={}) for t in theta_rad])
    values = np.array([fit.result.value(parameter.name) for parameter in model.parameters])
    return np.asarray(model.predict(values).accel_v[:, 1].real)


def _zeros(theta: FloatArray, line: FloatArray) -> list[float]:
    """Angles where a line crosses zero."""
    # The line is known at points only; between two of different sign it is as good as straight.
    before = np.flatnonzero(np.signbit(line[:-1]) != np.signbit(line[1:]))
    share = line[before] / (line[before] - line[before + 1])
    return [float(t) for t in theta[before] + share * (theta[before + 1] - theta[before])]


def draw_response(rows: Sequence[ResponseRow]) -> Figure:
    """Two panels: all runs over the stage's angle, and the neighbourhood of the null."""
    figure = Figure(3.0)
    overview, close = figure.subplots(1, 2)
    frequencies = list(dict.fromkeys(row.frequency_hz for row in rows if row.frequency_hz is not None))
    for index, frequency in enumerate(frequencies):
        points = [row for row in rows if row.frequency_hz == frequency]
        zeros = [row.theta_minus_theta0_arcsec for row in points if row.kind == "apparent null"]
        label = f"{frequency:.3g} Hz"
        _draw_series(overview, points, [row.theta_deg for row in points], index, label)
        if zeros:
            label += f", zero at {zeros[0]:+.1f}″".replace("-", "−")
        _draw_series(close, points, [row.theta_minus_theta0_arcsec for row in points], index, label)
        look = series_style(index)
        close.plot(zeros, [0.0] * len(zeros), look.marker, color=look.color, markerfacecolor=PAPER, zorder=3)
    null = next(row for row in rows if row.kind == "null")
    _draw_null(overview, close, null)
    overview.set_title(f"axis {null.axis}, {null.configuration}, mounting {null.mounting}")
    for axes, letter in ((overview, "a"), (close, "b")):
        axes.axhline(0.0, color=SOFT, linewidth=0.5, zorder=0)
        axes.set_ylabel("in-phase response S/(kA) / (µm s⁻² mm⁻¹)")
        axes.letter = letter
    overview.set_xlabel("stage angle θ / deg")
    close.set_xlabel("θ − θ₀ / arcsec")
    _limit_close_up(close, rows)
    overview.legend()
    close.legend()
    return figure


def _draw_series(axes: Axes, rows: Sequence[ResponseRow], x: Sequence[float], index: int, label: str) -> None:
    look = series_style(index)
    line = [(a, row.response_um_s2_per_mm) for a, row in zip(x, rows, strict=True) if row.kind == "model"]
    axes.plot(*np.transpose(line), linestyle=look.line, color=look.color, zorder=2)
    runs = [(a, row) for a, row in zip(x, rows, strict=True) if row.kind == "measured"]
    axes.errorbar(
        [a for a, _ in runs],
        [row.response_um_s2_per_mm for _, row in runs],
        yerr=[row.response_sigma_um_s2_per_mm or 0.0 for _, row in runs],
        fmt=look.marker,
        color=look.color,
        markersize=3.2,
        capsize=2.0,
        label=label,
        zorder=4,
    )


def _draw_null(overview: Axes, close: Axes, null: ResponseRow) -> None:
    sigma = null.theta_sigma_arcsec or 0.0
    overview.axvline(null.theta_deg, color=SOFT, linewidth=0.8, zorder=0, label="θ₀")
    close.axvspan(-sigma, sigma, color=SOFT, alpha=0.35)
    label = f"θ₀ = {null.theta_deg:.5f}° ± {sigma:.2f}″".replace("= -", "= −")
    at = [null.response_um_s2_per_mm]
    close.errorbar([0.0], at, xerr=[sigma], fmt="D", color=INK, markersize=5.0, capsize=2.0, label=label, zorder=5)


def _limit_close_up(axes: Axes, rows: Sequence[ResponseRow]) -> None:
    """Show the null, every frequency's zero, and the runs around them."""
    shown = [0.0] + [row.theta_minus_theta0_arcsec for row in rows if row.kind == "apparent null"]
    shown += [
        row.theta_minus_theta0_arcsec
        for row in rows
        if row.kind == "measured" and abs(row.theta_minus_theta0_arcsec) < ZOOM_ARCSEC
    ]
    # Five arcsec more, so that a single run at the null has some width around it.
    margin = 0.15 * (max(shown) - min(shown)) + 5.0
    low, high = min(shown) - margin, max(shown) + margin
    heights = [0.0] + [
        row.response_um_s2_per_mm + sign * (row.response_sigma_um_s2_per_mm or 0.0)
        for row in rows
        for sign in (-1.0, 1.0)
        if row.kind in {"measured", "null"} and low <= row.theta_minus_theta0_arcsec <= high
    ]
    span = max(heights) - min(heights) or 1.0
    axes.set_xlim(low, high)
    # Room for the legend above, for the lines' slopes below.
    axes.set_ylim(min(heights) - 0.5 * span, max(heights) + 0.8 * span)
