"""Figure 5: readings over the platform's angle, accelerations over the commanded tilt."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.result import published
from rigctl.experiments.rotating_platform.result.bench_runs import Scan
from rigctl.experiments.rotating_platform.result.result import PlatformResult
from rigctl.experiments.rotating_platform.result.run_result import RunResult
from rigctl.report.chart.axes import Axes
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, SOFT, series_style
from rigctl.report.quantities import number, quantity

CURVE_STEP_DEG = 5.0


@dataclass(frozen=True)
class AlignmentRow:
    """A reading at an angle of a scan, or the acceleration of a run at its commanded tilt, with what fits it.

    Rows of kind "curve" are between a scan's angles and have no reading.
    `printed_m_s2` is what the paper's eq. 6 or 13 gives there; empty for a scan under another tilt than the paper's.
    """

    kind: str
    run_id: str
    channel: str
    theta_deg: float
    commanded_m_s2: float
    value_m_s2: float | None
    sigma_m_s2: float
    fitted_m_s2: float
    printed_m_s2: float | None


def alignment_plate(
    result: PlatformResult, scans: Sequence[Scan], steady: Sequence[RunResult], *, printed: bool
) -> Plate[AlignmentRow]:
    """Readings against the angle (eq. 6) and accelerations against the commanded tilt (eq. 13).

    With the `printed` ones where the paper has numbers for the sensors.
    """
    rows: list[AlignmentRow] = []
    for scan in scans:
        rows += _scan_rows(scan, printed=printed and published.scanned_alike(scan.commanded_m_s2))
    for run in steady:
        # Periods that do not count have no command.
        commanded = float(np.nanmean(run.commanded))
        value = run.values["z"]["accel"]
        fitted = result.tilt_gain.value * commanded + result.accel_m_s2["z"].value
        line = published.TILT_GAIN * commanded + published.INTERCEPT_M_S2 if printed else None
        rows.append(AlignmentRow("tilt", run.run.run_id, "z", 0.0, commanded, value.value, value.sigma, fitted, line))
    gain, intercept = number(result.tilt_gain.value, 5), number(result.accel_m_s2["z"].value, 5)
    beside = _axes_beside_printed(scans) if printed else ""
    tilts = (
        f"printed line (eq. 13, {published.SOURCE}): measured gain {gain}, printed {published.TILT_GAIN:g}; measured "
        f"intercept {intercept} m/s2, printed {published.INTERCEPT_M_S2:g}."
        if printed
        else f"fitted line (eq. 13): gain {gain}, intercept {intercept} m/s2."
    )
    caption = (
        f"(a) Readings over the platform's angle and their fits (eq. 6).{beside} "
        f"(b) Acceleration of each run against the commanded tilt less the {tilts}"
    )
    return Plate("fig5", caption, rows, draw_alignment)


def _scan_rows(scan: Scan, *, printed: bool) -> list[AlignmentRow]:
    between_deg = np.arange(0.0, 360.1, CURVE_STEP_DEG)
    rows = []
    for channel in CHANNELS:
        read = zip(np.degrees(scan.theta_rad), scan.readings_m_s2[channel], strict=True)
        rows += [
            _scan_row(scan, "scan", channel, float(angle), float(value), printed=printed) for angle, value in read
        ]
        rows += [_scan_row(scan, "curve", channel, float(angle), None, printed=printed) for angle in between_deg]
    return rows


def _scan_row(
    scan: Scan, kind: str, channel: str, theta_deg: float, value: float | None, *, printed: bool
) -> AlignmentRow:
    fit, command = scan.fits[channel], scan.commanded_m_s2
    measured = _equation_6({name: fit.value(name) for name in fit.names}, theta_deg)
    beside = _equation_6(published.SCAN_M_S2[channel], theta_deg) if printed else None
    return AlignmentRow(kind, scan.run_id, channel, theta_deg, command, value, 0.0, measured, beside)


def _equation_6(coefficients: Mapping[str, float], theta_deg: float) -> float:
    """What stays in a turn of the platform is bias, what turns with it acceleration."""
    theta_rad = math.radians(theta_deg)
    turning = coefficients["cos"] * math.cos(theta_rad) + coefficients["sin"] * math.sin(theta_rad)
    return coefficients["offset"] + turning


def _axes_beside_printed(scans: Sequence[Scan]) -> str:
    """How the two readings' amplitudes and directions compare, and how those that eq. 6 prints do."""
    compared = [scan for scan in scans if published.scanned_alike(scan.commanded_m_s2)]
    if not compared:
        return ""
    ratio, beyond = compared[-1].axes.amplitude_ratio, compared[-1].axes.nonorthogonality_rad
    y, z = (published.SCAN_M_S2[channel] for channel in ("y", "z"))
    printed_ratio = math.hypot(y["cos"], y["sin"]) / math.hypot(z["cos"], z["sin"])
    phase_rad = math.atan2(y["sin"], y["cos"]) - math.atan2(z["sin"], z["cos"])
    printed_deg = math.degrees(math.remainder(phase_rad - 0.5 * math.pi, 2.0 * math.pi))
    return (
        f" Dashed: as printed; its amplitudes' ratio y to z is {number(printed_ratio, 4)} and its axes stand "
        f"{number(printed_deg, 3)} deg beyond a right angle, where eq. 3 allows only 1 (but for "
        f"scale factors) and 0; measured {quantity(ratio.value, ratio.sigma)} and "
        f"{quantity(math.degrees(beyond.value), math.degrees(beyond.sigma), 'deg')}."
    )


def draw_alignment(rows: Sequence[AlignmentRow]) -> Figure:
    """Two panels: the scan, the tilt regression less the printed line, or the fitted one where none is printed."""
    figure = Figure(2.6)
    scan, tilt = figure.subplots(1, 2)
    for run_id in dict.fromkeys(row.run_id for row in rows if row.kind == "scan"):
        _draw_scan(scan, [row for row in rows if row.run_id == run_id])
    if scan.marks:
        scan.legend()
    else:
        scan.text(0.5, 0.5, "no scan in this recording", share_x=True, share_y=True, anchor="middle", color=SOFT)
    scan.set_xlabel("platform angle θ / deg")
    scan.set_ylabel("reading / m/s²")
    points = [r for r in rows if r.kind == "tilt"]
    look = series_style(0)
    tilt.errorbar(
        [r.commanded_m_s2 for r in points],
        # Less a line: the slope is near 1, and differences would not be seen.
        [(r.value_m_s2 or 0.0) - _line(r) for r in points],
        yerr=[r.sigma_m_s2 for r in points],
        fmt=look.marker,
        color=look.color,
        label="measured",
    )
    points = sorted(points, key=lambda r: r.commanded_m_s2)
    difference = [r.fitted_m_s2 - _line(r) for r in points]
    tilt.plot([r.commanded_m_s2 for r in points], difference, color=look.color, label="fit")
    printed = any(r.printed_m_s2 is not None for r in points)
    if printed:
        tilt.axhline(0.0, color=INK, linestyle="--", linewidth=0.7, label="printed")
    tilt.set_xlabel("commanded tilt / m/s²")
    tilt.set_ylabel(f"acceleration less {'printed' if printed else 'fit'} / m/s²")
    tilt.legend()
    for panel, letter in ((scan, "a"), (tilt, "b")):
        panel.letter = letter
    # A turn has quarters; a tilt is small in every unit that is not.
    scan.set_xticks(range(0, 361, 90))
    return figure


def _line(row: AlignmentRow) -> float:
    return row.fitted_m_s2 if row.printed_m_s2 is None else row.printed_m_s2


def _draw_scan(panel: Axes, rows: Sequence[AlignmentRow]) -> None:
    for index, channel in enumerate(CHANNELS):
        look = series_style(index)
        points = [row for row in rows if (row.kind, row.channel) == ("scan", channel)]
        curve = [row for row in rows if (row.kind, row.channel) == ("curve", channel)]
        angles_deg = [row.theta_deg for row in curve]
        # A table has no number where there is none, a line has nan.
        values = np.array([row.value_m_s2 for row in points], dtype=np.float64)
        panel.plot([row.theta_deg for row in points], values, look.marker, color=look.color, label=f"m_{channel}")
        panel.plot(angles_deg, [row.fitted_m_s2 for row in curve], color=look.color)
        printed = np.array([row.printed_m_s2 for row in curve], dtype=np.float64)
        if np.isfinite(printed).any():
            panel.plot(angles_deg, printed, color=INK, linestyle="--", linewidth=0.7, label="printed")
