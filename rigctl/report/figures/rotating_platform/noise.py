"""The noise of the chains beside what the paper prints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from rigctl.experiments.rotating_platform.observe.noise import Q_FLEX_NOISE_V
from rigctl.experiments.rotating_platform.result import published
from rigctl.experiments.rotating_platform.result.bench_runs import NoiseRecord
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, new_figure, series_style


@dataclass(frozen=True)
class NoiseRow:
    """A band of a noise record's two-sided spectrum, with the fit and eq. 1 there."""

    run_id: str
    channel: str
    frequency_hz: float
    density_v2_hz: float
    fitted_v2_hz: float
    printed_v2_hz: float


def noise_plate(noises: Sequence[NoiseRecord]) -> Plate[NoiseRow]:
    """Spectra of the noise records beside eq. 1."""
    rows = [
        NoiseRow(each.run_id, each.channel, float(f), float(density), float(fitted), float(printed))
        for each in noises
        for f, density, fitted, printed in zip(
            each.spectrum.frequency_hz,
            each.spectrum.density,
            each.fit(each.spectrum.frequency_hz),
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
        bands = [row for row in rows if (row.run_id, row.channel) == key]
        look = series_style(index)
        frequency = [row.frequency_hz for row in bands]
        axes.plot(frequency, [row.density_v2_hz for row in bands], look.marker, color=look.color, label=" ".join(key))
        axes.plot(frequency, [row.fitted_v2_hz for row in bands], linestyle=look.line, color=look.color)
    bands = sorted(rows, key=lambda row: row.frequency_hz)
    axes.plot([r.frequency_hz for r in bands], [r.printed_v2_hz for r in bands], "--", color=INK, label="eq. 1")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("frequency / Hz")
    axes.set_ylabel("density / V²/Hz")
    axes.legend(loc="best")
    return figure
