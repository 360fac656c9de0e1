"""A few cycles of one run as they were recorded, with the drive's sine (figure 3 of Lucente et al. 2022)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, series_style

CYCLES = 3
_CHANNELS = {"stage_x_mm": "stage / mm", "accel_v": "accelerometer / V"}


@dataclass(frozen=True)
class SampleRow:
    """A sample of a run, and the sine of the drive's frequency that is fitted to the whole of it."""

    run_id: str
    channel: str
    time_s: float
    value: float
    fitted: float


def time_series_plate(source: RunSource, runs: Sequence[RunObservables]) -> Plate[SampleRow]:
    """Make the figure of the run of a mounting in which the sensor answers most."""
    run = max(runs, key=lambda each: abs(each.accel_v.value[1]))
    samples = source.samples(run.run_id)
    rows: list[SampleRow] = []
    for channel in _CHANNELS:
        fitted = _sine(samples["t_s"], samples[channel], run.frequency_hz)
        shown = np.flatnonzero(samples["t_s"] - samples["t_s"][0] <= CYCLES / run.frequency_hz)
        rows += [
            SampleRow(run.run_id, channel, *map(float, each))
            for each in zip(samples["t_s"][shown], samples[channel][shown], fitted[shown], strict=True)
        ]
    caption = (
        f"The first {CYCLES} cycles of run {run.run_id}, as recorded: axis {run.axis}, {run.configuration}, mounting "
        f"{run.mounting}, {math.degrees(run.theta_rad):.4f} deg, {run.frequency_hz:.3g} Hz. (a) Displacement by the "
        f"stage's encoder, (b) the accelerometer's output; lines: mean and sine of the drive's "
        f"frequency, fitted to the whole run."
    )
    return Plate("fig3", caption, rows, draw_time_series)


def _sine(time_s: FloatArray, values: FloatArray, frequency_hz: float) -> FloatArray:
    turn = 2.0 * math.pi * frequency_hz * (time_s - time_s[0])
    columns = np.stack([np.ones_like(turn), np.cos(turn), np.sin(turn)], axis=1)
    # Lost samples are nan.
    read = np.isfinite(values)
    return np.asarray(columns @ np.linalg.lstsq(columns[read], values[read], rcond=None)[0])


def draw_time_series(rows: Sequence[SampleRow]) -> Figure:
    """Two panels over time, a channel each."""
    figure = Figure(3.2)
    panels = figure.subplots(2, 1, sharex=True)
    for index, (panel, letter, (channel, label)) in enumerate(zip(panels, "ab", _CHANNELS.items(), strict=True)):
        shown = [row for row in rows if row.channel == channel]
        look = series_style(index)
        times = [row.time_s for row in shown]
        panel.plot(times, [row.value for row in shown], ".", color=look.color, markersize=2.0, label="samples")
        panel.plot(times, [row.fitted for row in shown], color=INK, linewidth=0.7, label="fitted sine")
        panel.set_ylabel(label)
        # Room for the legend above the crests.
        panel.margins(y=0.25)
        panel.legend(ncols=2)
        panel.letter = letter
    panels[1].set_xlabel("time / s")
    return figure
