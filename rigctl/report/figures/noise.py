"""The noise of a channel, drawn: its Allan deviation with confidence, its spectral density with the fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rigctl.analysis.stability.coefficients import FLICKER_FLOOR, Coefficient
from rigctl.core.arrays import FloatArray
from rigctl.report.chart.axes import Axes
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate, file_name
from rigctl.report.figures.style import INK, SOFT, series_style
from rigctl.report.quantities import share
from rigctl.stability import NoiseStudy

_DRAWN = {"allan": "overlapping Allan", "modified": "modified Allan", "hadamard": "overlapping Hadamard"}


@dataclass(frozen=True)
class DeviationRow:
    """One deviation with its interval, or a coefficient's part of the Allan deviation (without interval)."""

    kind: str
    tau_s: float
    deviation: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class DensityRow:
    """A cell of the amplitude spectral density, of the fit or of one of its terms; or a line (without density)."""

    kind: str
    frequency_hz: float
    density_unit_rthz: float | None


def noise_plates(study: NoiseStudy) -> Iterator[Plate[DeviationRow] | Plate[DensityRow]]:
    """Two figures of a channel; without the density where the record gave none."""
    series, unit = study.series, study.series.unit or "1"
    name = file_name("_".join(filter(None, [series.run and f"run_{series.run}", series.channel])))
    about = f"of {series.channel}{f' in run {series.run}' if series.run else ''}"
    deviations = [row for row in _deviation_rows(study) if row.deviation > 0.0]
    if deviations:
        caption = f"Allan, modified and Hadamard deviation {about}, intervals of {share(round(study.confidence, 4))}."
        yield Plate(
            f"allan_{name}", caption, deviations, partial(_draw_deviations, unit=unit, channel=series.channel)
        )
    if study.density is not None:
        caption = f"Amplitude spectral density (one-sided) {about} with the fitted noise; dotted: lines taken out."
        rows = list(_density_rows(study))
        yield Plate(f"density_{name}", caption, rows, partial(_draw_density, unit=unit, channel=series.channel))


def _deviation_rows(study: NoiseStudy) -> Iterator[DeviationRow]:
    for kind, label in _DRAWN.items():
        for each in getattr(study.family, kind):
            yield DeviationRow(label, each.tau_s, each.value, each.low, each.high)
    taus = [each.tau_s for each in study.family.allan]
    for coefficient in study.coefficients:
        if coefficient.resolved:
            for tau in taus:
                yield DeviationRow(
                    f"{coefficient.symbol}: {coefficient.name}", tau, _allan(coefficient, tau), None, None
                )


def _allan(coefficient: Coefficient, tau_s: float) -> float:
    """The part of a term in the Allan deviation (IEEE Std 952, annex C)."""
    part = {"N": tau_s**-0.5, "B": FLICKER_FLOOR, "K": (tau_s / 3.0) ** 0.5}[coefficient.symbol]
    return float(coefficient.value * part)


def _density_rows(study: NoiseStudy) -> Iterator[DensityRow]:
    found = study.density
    assert found is not None
    frequency_hz = found.cells.frequency_hz
    for f, psd in zip(frequency_hz, found.cells.psd, strict=True):
        yield DensityRow("density", float(f), float(psd) ** 0.5)
    fitted = frequency_hz[(frequency_hz >= found.band_hz[0]) & (frequency_hz <= found.band_hz[1])]
    for f, psd in zip(fitted, found.model(fitted), strict=True):
        yield DensityRow("fit", float(f), float(psd) ** 0.5)
    for line in found.lines:
        yield DensityRow("line", line.frequency_hz, None)


def _draw_deviations(rows: Sequence[DeviationRow], *, unit: str, channel: str) -> Figure:
    figure = Figure(3.0)
    axes = figure.subplots()
    measured = list(_DRAWN.values())
    for index, kind in enumerate(dict.fromkeys(row.kind for row in rows)):
        of_kind = [row for row in rows if row.kind == kind]
        look = series_style(index)
        # Side by side, so that intervals of one averaging time can be told apart.
        tau = np.array([row.tau_s for row in of_kind]) * (
            1.0 + 0.04 * (measured.index(kind) if kind in measured else 0)
        )
        value = np.array([row.deviation for row in of_kind])
        if kind in measured:
            low = value - np.array([row.low for row in of_kind], float)
            high = np.array([row.high for row in of_kind], float) - value
            axes.errorbar(tau, value, [low, high], fmt=look.marker, color=look.color, markersize=3.0, label=kind)
        else:
            axes.plot(tau, value, color=SOFT, linestyle=look.line, linewidth=0.8, label=kind)
    axes.set_xscale("log")
    axes.set_yscale("log")
    _show(axes, np.array([row.deviation for row in rows if row.kind in measured]))
    axes.set_xlabel("averaging time τ / s")
    axes.set_ylabel(f"deviation of {channel} / {unit}")
    axes.legend()
    return figure


def _draw_density(rows: Sequence[DensityRow], *, unit: str, channel: str) -> Figure:
    figure = Figure(3.0)
    axes = figure.subplots()
    for index, kind in enumerate(("density", "fit")):
        of_kind = [row for row in rows if row.kind == kind]
        look = series_style(index)
        values = [row.density_unit_rthz for row in of_kind]
        axes.plot([row.frequency_hz for row in of_kind], values, color=look.color, linestyle=look.line, label=kind)
    for row in rows:
        if row.kind == "line":
            axes.axvline(row.frequency_hz, color=INK, linewidth=0.6, linestyle=":")
    _show(axes, np.array([row.density_unit_rthz for row in rows if row.kind == "density"], float))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("frequency / Hz")
    axes.set_ylabel(f"{channel} / ({unit}/√Hz)")
    axes.legend()
    return figure


def _show(axes: Axes, values: FloatArray) -> None:
    """What was measured fills the panel; a term that is far below does not widen it."""
    positive = values[values > 0.0]
    if positive.size:
        axes.set_ylim(positive.min() / 3.0, positive.max() * 3.0)
