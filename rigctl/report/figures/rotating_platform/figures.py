"""The figures of a rotating-platform recording beside what the paper prints: 5, 7, 8, 9 and table 4."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigctl.experiments.rotating_platform.model.response import expected_sine
from rigctl.experiments.rotating_platform.observe.bench_runs import NoiseRecord, Scan
from rigctl.experiments.rotating_platform.observe.noise import Q_FLEX_NOISE_V
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, named_pattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains
from rigctl.experiments.rotating_platform.result import published
from rigctl.experiments.rotating_platform.result.precision import continuous_precision, simplified_precision
from rigctl.experiments.rotating_platform.result.result import HOUR_S, PlatformResult, RunResult
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, SOFT, new_figure, panel_letter, series_style
from rigctl.report.quantities import number

_CURVE_S = np.geomspace(45.0, 3600.0, 40)


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


@dataclass(frozen=True)
class CourseRow:
    """A period of a run with a varying external signal: outputs in the z channel, and what was commanded."""

    run_id: str
    pattern: str
    modulation_period_s: float
    time_min: float
    commanded_m_s2: float
    accel_m_s2: float
    bias_m_s2: float
    accel_slope_m_s3: float
    bias_slope_m_s3: float
    expected_bias_m_s2: float | None


@dataclass(frozen=True)
class PrecisionRow:
    """Precision of the mean acceleration in an hour: of a run, of a curve of theory, or as the paper prints it."""

    kind: str
    run_id: str
    channel: str
    pattern: str
    modulation_period_s: float
    sample_rate_hz: float | None
    sigma_m_s2: float
    low_m_s2: float | None
    high_m_s2: float | None


@dataclass(frozen=True)
class NoiseRow:
    """A band of a noise record's two-sided spectrum, with the fit and eq. 1 there."""

    run_id: str
    channel: str
    frequency_hz: float
    density_v2_hz: float
    fitted_v2_hz: float
    printed_v2_hz: float


def plates_of(
    found: PlatformResult, chains: Chains, scans: Sequence[Scan], noises: Sequence[NoiseRecord]
) -> tuple[list[Plate[Any]], dict[str, str]]:
    """Every figure the recording allows, and why another is not there."""
    plates: list[Plate[Any]] = []
    left_out: dict[str, str] = {}
    steady = [run for run in found.runs if _external(run) == "constant"]
    if scans or steady:
        plates.append(alignment_plate(found, chains, scans, steady))
    else:
        left_out["fig5"] = "no scan and no run at constant tilt"
    for name, external in (("fig7", "triangle"), ("fig8", "sine")):
        runs = [run for run in found.runs if _external(run) == external]
        if runs:
            plates.append(course_plate(name, external, runs, found, chains))
        else:
            left_out[name] = f"no run with an external {external}"
    plates.append(precision_plate(found, chains))
    plates.append(table_plate(found))
    if noises:
        plates.append(noise_plate(noises))
    else:
        left_out["noise"] = "no noise record"
    return plates, left_out


def alignment_plate(
    found: PlatformResult, chains: Chains, scans: Sequence[Scan], steady: Sequence[RunResult]
) -> Plate[AlignmentRow]:
    """Readings against the angle (eq. 6) and accelerations against the commanded tilt (eq. 13)."""
    rows: list[AlignmentRow] = []
    for scan in scans:
        for channel in CHANNELS:
            fit = scan.fits[channel]
            for theta, value in zip(scan.theta_rad, scan.readings_m_s2[channel], strict=True):
                fitted = fit.value("offset") + fit.value("cos") * math.cos(theta) + fit.value("sin") * math.sin(theta)
                rows.append(
                    AlignmentRow(
                        "scan", scan.run_id, channel, math.degrees(theta), 0.0, float(value), 0.0, fitted, None
                    )
                )
    for run in steady:
        commanded = float(np.nanmean(run.commanded))
        value = run.values["z"]["accel"]
        fitted = found.tilt_gain.value * commanded + found.accel_m_s2["z"].value
        printed = published.TILT_GAIN * commanded + published.INTERCEPT_M_S2
        rows.append(
            AlignmentRow("tilt", run.run.run_id, "z", 0.0, commanded, value.value, value.sigma, fitted, printed)
        )
    del chains
    caption = (
        f"(a) Readings over the platform's angle and their fits (eq. 6). (b) Acceleration of each run against the "
        f"commanded tilt less the printed line (eq. 13, {published.SOURCE}): measured gain "
        f"{number(found.tilt_gain.value, 5)}, printed {published.TILT_GAIN:g}; measured intercept "
        f"{number(found.accel_m_s2['z'].value, 5)} m/s2, printed {published.INTERCEPT_M_S2:g}."
    )
    return Plate("fig5", caption, rows, draw_alignment)


def draw_alignment(rows: Sequence[AlignmentRow]) -> Figure:
    """Two panels: the scan, the tilt regression less the printed line."""
    figure = new_figure(2.6)
    scan, tilt = figure.subplots(1, 2)
    for index, channel in enumerate(CHANNELS):
        own = sorted((r for r in rows if r.kind == "scan" and r.channel == channel), key=lambda r: r.theta_deg)
        look = series_style(index)
        if own:
            angles = [r.theta_deg for r in own]
            scan.plot(angles, [r.value_m_s2 for r in own], look.marker, color=look.color, label=f"m_{channel}")
            scan.plot(angles, [r.fitted_m_s2 for r in own], linestyle=look.line, color=look.color)
    if scan.lines:
        scan.legend(loc="best")
    else:
        scan.text(0.5, 0.5, "no scan in this recording", ha="center", transform=scan.transAxes, color=SOFT)
    scan.set_xlabel("platform angle θ / deg")
    scan.set_ylabel("reading / m/s²")
    own = [r for r in rows if r.kind == "tilt"]
    look = series_style(0)
    tilt.errorbar(
        [r.commanded_m_s2 for r in own],
        [r.value_m_s2 - (r.printed_m_s2 or 0.0) for r in own],
        yerr=[r.sigma_m_s2 for r in own],
        fmt=look.marker,
        color=look.color,
        label="measured",
    )
    own = sorted(own, key=lambda r: r.commanded_m_s2)
    difference = [r.fitted_m_s2 - (r.printed_m_s2 or 0.0) for r in own]
    tilt.plot([r.commanded_m_s2 for r in own], difference, color=look.color, label="fit")
    tilt.axhline(0.0, color=INK, linestyle="--", linewidth=0.7, label="printed")
    tilt.set_xlabel("commanded tilt / m/s²")
    tilt.set_ylabel("acceleration less printed / m/s²")
    tilt.legend(loc="best")
    _finish((scan, tilt))
    return figure


def course_plate(
    name: str, external: str, runs: Sequence[RunResult], found: PlatformResult, chains: Chains
) -> Plate[CourseRow]:
    """Outputs over time under an external triangle or sine."""
    rows: list[CourseRow] = []
    said: list[str] = []
    for run in runs:
        expected = _expected_bias(run, found.tilt_gain.value, chains) if external == "sine" else None
        z = CHANNELS.index("z")
        period_s = run.sampled.pattern.period_s
        for number_, commanded in enumerate(run.commanded):
            time_s = (number_ + 0.5) * period_s + run.sampled.centre_s
            rows.append(
                CourseRow(
                    run.run.run_id,
                    str(run.run.conditions["pattern"]),
                    period_s,
                    time_s / 60.0,
                    float(commanded),
                    float(run.series.accel_mean[number_, z]),
                    float(run.series.bias_mean[number_, z]),
                    float(run.series.accel_slope[number_, z]),
                    float(run.series.bias_slope[number_, z]),
                    None if expected is None else float(expected[number_]),
                )
            )
        if run.response is not None:
            response = run.response
            said.append(
                f"{run.run.run_id} (pattern {run.run.conditions['pattern']}, {period_s:g} s): bias "
                f"{number(response.bias_pp)} m/s2 peak to peak, {response.shift.end_min:.1f} min late stamped at the "
                f"end of the window, {response.shift.centre_min:.1f} at its centre"
            )
    printed = ""
    if external == "sine":
        printed = (
            f" Printed for pattern a, {published.SINE_TAU_S:g} s, {published.SINE_V:g} V: "
            f"{published.BIAS_PP_M_S2:g} expected, {published.BIAS_PP_MEASURED_M_S2:g} measured, "
            f"{published.SHIFT_MIN:g} min stamped at the end ({published.SOURCE}, figure 8)."
        )
    caption = (
        f"Acceleration and bias of the z channel under an external {external}, period by period: (a) acceleration, "
        f"(b) bias, (c) slope of the acceleration, (d) slope of the bias. {'; '.join(said)}.{printed}"
    )
    return Plate(name, caption, rows, draw_course)


def draw_course(rows: Sequence[CourseRow]) -> Figure:
    """Four panels over time, a series per run."""
    figure = new_figure(4.4)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    names = ("accel_m_s2", "bias_m_s2", "accel_slope_m_s3", "bias_slope_m_s3")
    labels = ("acceleration / m/s²", "bias / m/s²", "slope of the acceleration / m/s³", "slope of the bias / m/s³")
    runs = list(dict.fromkeys(row.run_id for row in rows))
    for panel, letter, name, label in zip(panels, "abcd", names, labels, strict=True):
        for index, run_id in enumerate(runs):
            own = [row for row in rows if row.run_id == run_id]
            look = series_style(index)
            times = [row.time_min for row in own]
            text = f"{run_id}: {own[0].pattern}, {own[0].modulation_period_s:g} s"
            panel.plot(times, [getattr(r, name) for r in own], color=look.color, linestyle=look.line, label=text)
            if name == "bias_m_s2" and own[0].expected_bias_m_s2 is not None:
                panel.plot(times, [r.expected_bias_m_s2 for r in own], ":", color=look.color, linewidth=0.8)
        panel.set_ylabel(label)
        panel_letter(panel, letter)
        panel.ticklabel_format(axis="y", scilimits=(-3, 4))
    for panel in panels[2:]:
        panel.set_xlabel("time / min")
    panels[0].legend(loc="best")
    return figure


def precision_plate(found: PlatformResult, chains: Chains) -> Plate[PrecisionRow]:
    """Precision in an hour against the modulation period: measured, theory by pattern, eq. 17, printed."""
    density = Q_FLEX_NOISE_V.in_units_of(chains.gain_v_per_m_s2["z"])
    rows = list(_measured(found.runs))
    for pattern in [name for name in ROTATIONS if name != "c_tm"]:
        for period_s in _CURVE_S.tolist():
            theory = continuous_precision(named_pattern(pattern, period_s), density, HOUR_S).single_period
            rows.append(PrecisionRow("theory", "", "z", pattern, period_s, None, theory, None, None))
    for period_s in _CURVE_S.tolist():
        simple = simplified_precision(density, period_s, HOUR_S)
        rows.append(PrecisionRow("eq. 17", "", "z", "", period_s, None, simple, None, None))
    rows += _printed()
    caption = (
        "Precision of the mean acceleration in an hour against the modulation period: from the scatter of each run's "
        "periods with 99 % intervals, z channel; theory from eq. 1 (two-sided) with the general formula; eq. 17, the "
        f"simplified formula; and what table 4 prints ({published.SOURCE})."
    )
    return Plate("fig9", caption, rows, draw_precision)


def _measured(runs: Iterable[RunResult]) -> Iterable[PrecisionRow]:
    for run in runs:
        for channel in CHANNELS:
            measured = run.precision[channel].measured
            if measured is not None:
                yield PrecisionRow(
                    "measured",
                    run.run.run_id,
                    channel,
                    str(run.run.conditions["pattern"]),
                    run.sampled.pattern.period_s,
                    run.sampled.sample_rate_hz,
                    measured.sigma,
                    *measured.interval,
                )


def _printed() -> list[PrecisionRow]:
    rows = [
        PrecisionRow("printed", "", "z", "c", 60.0, rate_hz, sigma, None, None)
        for rate_hz, sigma in published.PRECISION_M_S2.items()
    ]
    return [
        *rows,
        PrecisionRow("printed theory", "", "z", "c", 60.0, None, published.PRECISION_THEORY_M_S2, None, None),
    ]


def draw_precision(rows: Sequence[PrecisionRow]) -> Figure:
    """Curves of theory, points of runs."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    patterns = [name for name in ROTATIONS if any(r.pattern == name for r in rows)]
    for index, pattern in enumerate(patterns):
        look = series_style(index)
        curve = [r for r in rows if r.kind == "theory" and r.pattern == pattern]
        points = [r for r in rows if r.kind == "measured" and r.pattern == pattern and r.channel == "z"]
        axes.plot(
            [r.modulation_period_s for r in curve],
            [r.sigma_m_s2 for r in curve],
            color=look.color,
            linestyle=look.line,
            label=f"pattern {pattern}",
        )
        axes.errorbar(
            [r.modulation_period_s for r in points],
            [r.sigma_m_s2 for r in points],
            yerr=[
                [r.sigma_m_s2 - (r.low_m_s2 or 0.0) for r in points],
                [(r.high_m_s2 or 0.0) - r.sigma_m_s2 for r in points],
            ],
            fmt=look.marker,
            color=look.color,
            capsize=2.0,
        )
    simple = [r for r in rows if r.kind == "eq. 17"]
    axes.plot([r.modulation_period_s for r in simple], [r.sigma_m_s2 for r in simple], color=SOFT, label="eq. 17")
    printed = [r for r in rows if r.kind == "printed"]
    axes.plot(
        [r.modulation_period_s for r in printed], [r.sigma_m_s2 for r in printed], "x", color=INK, label="printed"
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("modulation period τ / s")
    axes.set_ylabel("σ in 1 h / m/s²")
    axes.legend(loc="best")
    return figure


def table_plate(found: PlatformResult) -> Plate[PrecisionRow]:
    """Table 4: precision with pattern c of a minute by sampling rate; every run where there is none such."""
    runs = [
        run
        for run in found.runs
        if run.run.conditions["pattern"] == "c" and math.isclose(run.sampled.pattern.period_s, 60.0, rel_tol=1e-3)
    ]
    rows = list(_measured(runs or found.runs))
    for run in runs or found.runs:
        for channel in CHANNELS:
            rows.append(
                PrecisionRow(
                    "theory",
                    run.run.run_id,
                    channel,
                    str(run.run.conditions["pattern"]),
                    run.sampled.pattern.period_s,
                    run.sampled.sample_rate_hz,
                    run.precision[channel].theory,
                    None,
                    None,
                )
            )
    caption = (
        "Precision of the mean acceleration in an hour by sampling rate, with 99 % intervals, beside theory and what "
        f"table 4 prints ({published.SOURCE}): its three values are not compatible with each other (p = 0.015)."
    )
    return Plate("table4", caption, [*rows, *_printed()], draw_table)


def draw_table(rows: Sequence[PrecisionRow]) -> Figure:
    """Sigma against the sampling rate."""
    figure = new_figure(2.6)
    axes = figure.subplots()
    for index, channel in enumerate(CHANNELS):
        look = series_style(index)
        own = [r for r in rows if r.kind == "measured" and r.channel == channel]
        shift = 1.0 + 0.04 * (2 * index - 1)
        axes.errorbar(
            [shift * (r.sample_rate_hz or 1.0) for r in own],
            [r.sigma_m_s2 for r in own],
            yerr=[
                [r.sigma_m_s2 - (r.low_m_s2 or 0.0) for r in own],
                [(r.high_m_s2 or 0.0) - r.sigma_m_s2 for r in own],
            ],
            fmt=look.marker,
            color=look.color,
            capsize=2.0,
            label=f"measured, {channel}",
        )
        theory = [r for r in rows if r.kind == "theory" and r.channel == channel]
        axes.plot(
            [shift * (r.sample_rate_hz or 1.0) for r in theory],
            [r.sigma_m_s2 for r in theory],
            "_",
            color=look.color,
            markersize=14.0,
            label=f"theory, {channel}",
        )
    printed = [r for r in rows if r.kind == "printed"]
    axes.plot(
        [r.sample_rate_hz or 1.0 for r in printed], [r.sigma_m_s2 for r in printed], "x", color=INK, label="printed"
    )
    axes.axhline(published.PRECISION_THEORY_M_S2, color=INK, linestyle="--", linewidth=0.7, label="printed theory")
    axes.set_xscale("log")
    axes.set_xlabel("sampling rate / Hz")
    axes.set_ylabel("σ in 1 h / m/s²")
    axes.legend(loc="best", ncols=2)
    return figure


def noise_plate(noises: Sequence[NoiseRecord]) -> Plate[NoiseRow]:
    """Spectra of the noise records beside eq. 1."""
    rows = [
        NoiseRow(each.run_id, each.channel, float(f), float(density), float(fitted), float(printed))
        for each in noises
        for f, density, fitted, printed in zip(
            each.spectrum.frequency_hz,
            each.spectrum.density,
            each.fit.noise(each.spectrum.frequency_hz),
            Q_FLEX_NOISE_V(each.spectrum.frequency_hz),
            strict=True,
        )
    ]
    caption = f"Noise of the chains at their outputs, two-sided, with the fitted form and eq. 1 ({published.SOURCE})."
    return Plate("noise", caption, rows, draw_noise)


def draw_noise(rows: Sequence[NoiseRow]) -> Figure:
    """Density over frequency, both logarithmic."""
    figure = new_figure(2.8)
    axes = figure.subplots()
    for index, key in enumerate(dict.fromkeys((row.run_id, row.channel) for row in rows)):
        own = [row for row in rows if (row.run_id, row.channel) == key]
        look = series_style(index)
        frequency = [row.frequency_hz for row in own]
        axes.plot(frequency, [row.density_v2_hz for row in own], look.marker, color=look.color, label=" ".join(key))
        axes.plot(frequency, [row.fitted_v2_hz for row in own], linestyle=look.line, color=look.color)
    own = sorted(rows, key=lambda row: row.frequency_hz)
    axes.plot([r.frequency_hz for r in own], [r.printed_v2_hz for r in own], "--", color=INK, label="eq. 1")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("frequency / Hz")
    axes.set_ylabel("density / V²/Hz")
    axes.legend(loc="best")
    return figure


def _expected_bias(run: RunResult, gain: float, chains: Chains) -> Any:
    """The bias of every period that the pattern makes of the sine, about its mean (eq. 16 on the masked samples)."""
    period_s = float(run.run.conditions["external_period_s"])
    amplitude = abs(float(run.run.conditions["v_z_v"])) / chains.command_v_per_m_s2["z"] * gain
    expected = expected_sine(run.sampled, amplitude, period_s, run.estimator)
    times_s = (np.arange(len(run.series)) + 0.5) * run.sampled.pattern.period_s + run.sampled.centre_s
    lag_s = 60.0 * expected.shift.centre_min
    mean = float(np.nanmean(run.series.bias_mean[:, CHANNELS.index("z")]))
    return mean + 0.5 * expected.bias_pp * np.sin(2.0 * np.pi * (times_s - lag_s) / period_s)


def _external(run: RunResult) -> str:
    return str(run.run.conditions.get("external") or "constant")


def _finish(panels: Iterable[Axes]) -> None:
    for panel, letter in zip(panels, "abcdef", strict=False):
        panel.ticklabel_format(axis="y", scilimits=(-3, 4))
        panel_letter(panel, letter)
