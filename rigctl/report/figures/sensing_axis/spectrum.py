"""What is left in the samples once the drive, its harmonics and a model's lines are taken out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rigctl.analysis.noise import Spectrum
from rigctl.campaign.recording import RunSource
from rigctl.experiments.sensing_axis.observe.store_reduction import spectra_left
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, series_style


@dataclass(frozen=True)
class SpectrumRow:
    """A bin of the pooled amplitude spectral density, or a line that was found in the samples."""

    channel: str
    kind: Literal["without the drive", "without the model's lines", "line found"]
    frequency_hz: float
    density_unit_rthz: float | None
    unit: str


def spectrum_plates(
    source: RunSource, lines_hz: Sequence[float], new_lines: Sequence[Mapping[str, Any]]
) -> Iterator[Plate[SpectrumRow]]:
    """A figure per channel of a sensing-axis recording; `lines_hz` are in the model, `new_lines` are not."""
    before = spectra_left(source)
    after = spectra_left(source, lines_hz) if lines_hz else {}
    for channel, left in before.items():
        # Lengths are reduced to metres, whatever the name of their column says.
        unit = "V" if channel.endswith("_v") else "m"
        rows = _rows(channel, "without the drive", left, unit)
        if channel in after:
            rows += _rows(channel, "without the model's lines", after[channel], unit)
        rows += [
            SpectrumRow(channel, "line found", float(line["frequency_hz"]), None, unit)
            for line in new_lines
            if line["channel"] == channel
        ]
        caption = (
            f"Amplitude spectral density of what is left in the samples of {channel}, pooled over all valid runs, "
            "beside the drive and its harmonics."
        )
        yield Plate(f"spectrum_{channel}", caption, rows, draw_spectrum)


def _rows(channel: str, kind: Any, left: Spectrum, unit: str) -> list[SpectrumRow]:
    # A pooled spectrum of a night has more bins than a page has dots.
    thin = left.compact()
    density = np.sqrt(np.maximum(thin.psd, 0.0))
    return [
        SpectrumRow(channel, kind, float(f), float(d), unit)
        for f, d in zip(thin.frequency_hz, density, strict=True)
        # Both axes are logarithmic.
        if f > 0.0 and d > 0.0
    ]


def draw_spectrum(rows: Sequence[SpectrumRow]) -> Figure:
    """One panel, both axes logarithmic."""
    figure = Figure(2.4)
    axes = figure.subplots()
    kinds = list(dict.fromkeys(row.kind for row in rows if row.density_unit_rthz is not None))
    for index, kind in enumerate(kinds):
        bins = [row for row in rows if row.kind == kind]
        look = series_style(index)
        axes.plot(
            [row.frequency_hz for row in bins],
            [row.density_unit_rthz for row in bins],
            color=look.color,
            linewidth=0.7,
            label=kind,
        )
    for row in rows:
        if row.kind == "line found":
            axes.axvline(row.frequency_hz, color=INK, linewidth=0.6, linestyle=":")
            label = f"{row.frequency_hz:.4g} Hz"
            # At the top of the panel, whatever the spectrum's height.
            axes.text(row.frequency_hz, 0.94, label, share_y=True)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("frequency / Hz")
    axes.set_ylabel(f"{rows[0].channel} / ({rows[0].unit}/√Hz)")
    if len(kinds) > 1:
        axes.legend()
    return figure
