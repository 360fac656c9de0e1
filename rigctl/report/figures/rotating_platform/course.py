"""Figures 7 and 8: acceleration and bias, period by period, under an external triangle or sine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.experiments.rotating_platform.model.response import expected_sine
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains
from rigctl.experiments.rotating_platform.result import published
from rigctl.experiments.rotating_platform.result.result import PlatformResult
from rigctl.experiments.rotating_platform.result.run_result import RunResult
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, series_style
from rigctl.report.quantities import number

_KNOWN = {"accel_m_s2": "known_m_s2", "accel_slope_m_s3": "known_slope_m_s3"}


@dataclass(frozen=True)
class CourseRow:
    """A period of a run with a varying external signal: outputs in the z channel, and what was commanded.

    `known_m_s2` and `known_slope_m_s3` are what the command amounts to with the tilt gain and the level of the fit.
    """

    run_id: str
    pattern: str
    modulation_period_s: float
    time_min: float
    commanded_m_s2: float
    accel_m_s2: float
    bias_m_s2: float
    accel_slope_m_s3: float
    bias_slope_m_s3: float
    known_m_s2: float
    known_slope_m_s3: float
    expected_bias_m_s2: float | None


def course_plate(
    name: str, external: str, runs: Sequence[RunResult], result: PlatformResult, chains: Chains, *, printed: bool
) -> Plate[CourseRow]:
    """Outputs over time under an external triangle or sine; `printed` where the paper has numbers for the sensors."""
    rows: list[CourseRow] = []
    responses: list[str] = []
    for run in runs:
        # Eq. 16 is of a sine.
        expected = _expected_bias(run, result.tilt_gain.value, chains) if external == "sine" else None
        z = CHANNELS.index("z")
        period_s = run.sampled.pattern.period_s
        known = result.tilt_gain.value * run.commanded + result.accel_m_s2["z"].value
        known_slope = np.gradient(known, period_s) if len(known) > 1 else np.full(len(known), np.nan)
        for number_, commanded in enumerate(run.commanded):
            # The middle of the samples that count, not of the period.
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
                    float(known[number_]),
                    float(known_slope[number_]),
                    None if expected is None else float(expected[number_]),
                )
            )
        if external == "sine" and run.response is not None:
            response = run.response
            responses.append(
                f"{run.run.run_id} (pattern {run.run.conditions['pattern']}, {period_s:g} s): bias "
                f"{number(response.bias_pp)} m/s2 peak to peak, {response.shift.end_min:.1f} min late stamped at the "
                f"end of the window, {response.shift.centre_min:.1f} at its centre"
            )
    said = ""
    if external == "sine":
        said = f" {'; '.join(responses)}."
    if external == "sine" and printed:
        said += (
            f" Printed for pattern a, {published.SINE_TAU_S:g} s, {published.SINE_V:g} V: "
            f"{published.BIAS_PP_M_S2:g} expected, {published.BIAS_PP_MEASURED_M_S2:g} measured, "
            f"{published.SHIFT_MIN:g} min stamped at the end ({published.SOURCE}, figure 8)."
        )
    caption = (
        f"Acceleration and bias of the z channel under an external {external}, period by period: (a) acceleration, "
        f"(b) bias, (c) slope of the acceleration, (d) slope of the bias. Black dots: the signal "
        f"that was commanded, with the tilt gain and the level of the fit.{said}"
    )
    return Plate(name, caption, rows, draw_course)


def draw_course(rows: Sequence[CourseRow]) -> Figure:
    """Four panels over time, a series per run."""
    figure = Figure(4.4)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    names = ("accel_m_s2", "bias_m_s2", "accel_slope_m_s3", "bias_slope_m_s3")
    labels = ("acceleration / m/s²", "bias / m/s²", "slope of the acceleration / m/s³", "slope of the bias / m/s³")
    runs = list(dict.fromkeys(row.run_id for row in rows))
    for panel, letter, name, label in zip(panels, "abcd", names, labels, strict=True):
        for index, run_id in enumerate(runs):
            periods = [row for row in rows if row.run_id == run_id]
            look = series_style(index)
            times = [row.time_min for row in periods]
            text = f"{run_id}: {periods[0].pattern}, {periods[0].modulation_period_s:g} s"
            panel.plot(times, [getattr(r, name) for r in periods], color=look.color, linestyle=look.line, label=text)
            known = _KNOWN.get(name)
            if known is not None:
                values = [getattr(r, known) for r in periods]
                label_once = None if index else "commanded"
                panel.plot(times, values, color=INK, linestyle=":", linewidth=1.2, label=label_once, zorder=3)
            if name == "bias_m_s2" and periods[0].expected_bias_m_s2 is not None:
                expected, words = [r.expected_bias_m_s2 for r in periods], None if index else "expected (eq. 16)"
                panel.plot(times, expected, ":", color=INK, linewidth=1.2, zorder=3, label=words)
        panel.set_ylabel(label)
        panel.letter = letter
    for panel in panels[2:]:
        panel.set_xlabel("time / min")
    # Outside, as courses fill their panels; what is expected of a bias has a line where there is a sine.
    of_bias = [(text, mark) for text, mark in panels[1].labelled() if text.startswith("expected")]
    figure.legend([*panels[0].labelled(), *of_bias])
    return figure


def _expected_bias(run: RunResult, gain: float, chains: Chains) -> Any:
    """The bias of every period that the pattern makes of the sine, about its mean (eq. 16 on the masked samples)."""
    period_s = float(run.run.conditions["external_period_s"])
    # Volts of the command over V/(m/s2) is what was asked for; the gain of eq. 13 makes of it what the sensor felt.
    amplitude = abs(float(run.run.conditions["v_z_v"])) / chains.command_v_per_m_s2["z"] * gain
    expected = expected_sine(run.sampled, amplitude, period_s, run.estimator)
    times_s = (np.arange(len(run.series)) + 0.5) * run.sampled.pattern.period_s + run.sampled.centre_s
    # The bias lags the command by this much, stamped at the centre of the window.
    lag_s = 60.0 * expected.shift.centre_min
    mean = float(np.nanmean(run.series.bias_mean[:, CHANNELS.index("z")]))
    return mean + 0.5 * expected.bias_pp * np.sin(2.0 * np.pi * (times_s - lag_s) / period_s)
