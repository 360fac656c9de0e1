"""Figure 5: readings over the platform's angle, accelerations over the commanded tilt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.result import published
from rigctl.experiments.rotating_platform.result.bench_runs import Scan
from rigctl.experiments.rotating_platform.result.result import PlatformResult
from rigctl.experiments.rotating_platform.result.run_result import RunResult
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, SOFT, new_figure, panel_letter, series_style
from rigctl.report.quantities import number


@dataclass(frozen=True)
class AlignmentRow:
    """A reading at an angle of a scan, or the acceleration of a run at its commanded tilt, with what fits it.

    `printed_m_s2` is what the paper's eq. 13 gives there; empty for a scan.
    """

    kind: str
    run_id: str
    channel: str
    theta_deg: float
    commanded_m_s2: float
    value_m_s2: float
    sigma_m_s2: float
    fitted_m_s2: float
    printed_m_s2: float | None


def alignment_plate(
    result: PlatformResult, scans: Sequence[Scan], steady: Sequence[RunResult]
) -> Plate[AlignmentRow]:
    """Readings against the angle (eq. 6) and accelerations against the commanded tilt (eq. 13)."""
    rows: list[AlignmentRow] = []
    for scan in scans:
        for channel in CHANNELS:
            fit = scan.fits[channel]
            for theta, value in zip(scan.theta_rad, scan.readings_m_s2[channel], strict=True):
                # Eq. 6: what stays in a turn of the platform is bias, what turns with it acceleration.
                fitted = fit.value("offset") + fit.value("cos") * math.cos(theta) + fit.value("sin") * math.sin(theta)
                rows.append(
                    AlignmentRow(
                        "scan", scan.run_id, channel, math.degrees(theta), 0.0, float(value), 0.0, fitted, None
                    )
                )
    for run in steady:
        # Periods that do not count have no command.
        commanded = float(np.nanmean(run.commanded))
        value = run.values["z"]["accel"]
        fitted = result.tilt_gain.value * commanded + result.accel_m_s2["z"].value
        printed = published.TILT_GAIN * commanded + published.INTERCEPT_M_S2
        rows.append(
            AlignmentRow("tilt", run.run.run_id, "z", 0.0, commanded, value.value, value.sigma, fitted, printed)
        )
    caption = (
        f"(a) Readings over the platform's angle and their fits (eq. 6). (b) Acceleration of each run against the "
        f"commanded tilt less the printed line (eq. 13, {published.SOURCE}): measured gain "
        f"{number(result.tilt_gain.value, 5)}, printed {published.TILT_GAIN:g}; measured intercept "
        f"{number(result.accel_m_s2['z'].value, 5)} m/s2, printed {published.INTERCEPT_M_S2:g}."
    )
    return Plate("fig5", caption, rows, draw_alignment)


def draw_alignment(rows: Sequence[AlignmentRow]) -> Figure:
    """Two panels: the scan, the tilt regression less the printed line."""
    figure = new_figure(2.6)
    scan, tilt = figure.subplots(1, 2)
    for index, channel in enumerate(CHANNELS):
        points = sorted((r for r in rows if r.kind == "scan" and r.channel == channel), key=lambda r: r.theta_deg)
        look = series_style(index)
        if points:
            angles = [r.theta_deg for r in points]
            scan.plot(angles, [r.value_m_s2 for r in points], look.marker, color=look.color, label=f"m_{channel}")
            scan.plot(angles, [r.fitted_m_s2 for r in points], linestyle=look.line, color=look.color)
    if scan.lines:
        scan.legend(loc="best")
    else:
        scan.text(0.5, 0.5, "no scan in this recording", ha="center", transform=scan.transAxes, color=SOFT)
    scan.set_xlabel("platform angle θ / deg")
    scan.set_ylabel("reading / m/s²")
    points = [r for r in rows if r.kind == "tilt"]
    look = series_style(0)
    tilt.errorbar(
        [r.commanded_m_s2 for r in points],
        # Less the printed line: the slope is near 1, and differences would not be seen.
        [r.value_m_s2 - (r.printed_m_s2 or 0.0) for r in points],
        yerr=[r.sigma_m_s2 for r in points],
        fmt=look.marker,
        color=look.color,
        label="measured",
    )
    points = sorted(points, key=lambda r: r.commanded_m_s2)
    difference = [r.fitted_m_s2 - (r.printed_m_s2 or 0.0) for r in points]
    tilt.plot([r.commanded_m_s2 for r in points], difference, color=look.color, label="fit")
    tilt.axhline(0.0, color=INK, linestyle="--", linewidth=0.7, label="printed")
    tilt.set_xlabel("commanded tilt / m/s²")
    tilt.set_ylabel("acceleration less printed / m/s²")
    tilt.legend(loc="best")
    for panel, letter in ((scan, "a"), (tilt, "b")):
        panel.ticklabel_format(axis="y", scilimits=(-3, 4))
        panel_letter(panel, letter)
    return figure
