"""The noise of the chains, and the precision that it allows (figure 9 and table 4), beside what the paper prints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.experiments.rotating_platform.observe.covariance import Q_FLEX_NOISE_V
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, named_pattern
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains
from rigctl.experiments.rotating_platform.result import published
from rigctl.experiments.rotating_platform.result.chain_noise import NoiseRecord
from rigctl.experiments.rotating_platform.result.precision import HOUR_S, continuous_precision, simplified_precision
from rigctl.experiments.rotating_platform.result.result import PlatformResult
from rigctl.experiments.rotating_platform.result.run_result import RunResult
from rigctl.report.chart.axes import Axes
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, SOFT, SeriesStyle, series_style

_CURVE_S = np.geomspace(45.0, 3600.0, 100)
_PERIOD = "modulation_period_s"


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
    low_m_s2: float | None = None
    high_m_s2: float | None = None


def precision_plate(result: PlatformResult, chains: Chains, *, printed: bool) -> Plate[PrecisionRow]:
    """Precision in an hour against the modulation period: measured, theory by pattern, eq. 17.

    With the `printed` ones where the paper has numbers for the sensors.
    """
    chain = result.chain_noise["z"]
    density = chain.noise.in_units_of(chains.gain_v_per_m_s2["z"])
    rows = _measured(result.runs)
    for pattern in [name for name in ROTATIONS if name != "c_tm"]:
        for period_s in _CURVE_S.tolist():
            theory = continuous_precision(named_pattern(pattern, period_s), density, HOUR_S)
            rows.append(PrecisionRow("theory", "", "z", pattern, period_s, None, theory))
    for period_s in _CURVE_S.tolist():
        simple = simplified_precision(density, period_s, HOUR_S)
        rows.append(PrecisionRow("eq. 17", "", "z", "", period_s, None, simple))
    caption = (
        "Precision of the mean acceleration in an hour against the modulation period: from the scatter of each run's "
        "periods with 99 % intervals, z channel; theory from the chain's noise (two-sided, "
        f"{chain.source}) with the general formula; eq. 17, the simplified formula"
    )
    if not printed:
        return Plate("fig9", f"{caption}.", rows, draw_precision)
    caption += f"; and what table 4 prints ({published.SOURCE})."
    return Plate("fig9", caption, [*rows, *_printed()], draw_precision)


def _of_run(run: RunResult, kind: str, channel: str, *sigma_m_s2: float) -> PrecisionRow:
    pattern, period_s = str(run.run.conditions["pattern"]), run.sampled.pattern.period_s
    return PrecisionRow(kind, run.run.run_id, channel, pattern, period_s, run.sampled.sample_rate_hz, *sigma_m_s2)


def _measured(runs: Iterable[RunResult]) -> list[PrecisionRow]:
    return [
        _of_run(run, "measured", channel, measured.sigma, *measured.interval)
        for run in runs
        for channel in CHANNELS
        if (measured := run.precision[channel].measured) is not None
    ]


def _printed() -> list[PrecisionRow]:
    rows = [PrecisionRow("printed", "", "z", "c", 60.0, *each) for each in published.PRECISION_M_S2.items()]
    return [*rows, PrecisionRow("printed theory", "", "z", "c", 60.0, None, published.PRECISION_THEORY_M_S2)]


def _draw_intervals(
    axes: Axes, rows: Sequence[PrecisionRow], at: Sequence[float], look: SeriesStyle, **kw: Any
) -> None:
    sigma = np.array([row.sigma_m_s2 for row in rows])
    low, high = (np.array([getattr(row, name) or 0.0 for row in rows]) for name in ("low_m_s2", "high_m_s2"))
    axes.errorbar(at, sigma, yerr=[sigma - low, high - sigma], fmt=look.marker, color=look.color, capsize=2.0, **kw)


def _draw_curve(axes: Axes, rows: Sequence[PrecisionRow], name: str, *style: str, **kw: Any) -> None:
    """Sigmas over one of the columns."""
    axes.plot([getattr(row, name) or 1.0 for row in rows], [row.sigma_m_s2 for row in rows], *style, **kw)


def draw_precision(rows: Sequence[PrecisionRow]) -> Figure:
    """Curves of theory, points of runs."""
    figure = Figure(3.0)
    axes = figure.subplots()
    patterns = [name for name in ROTATIONS if any(r.pattern == name for r in rows)]
    for index, pattern in enumerate(patterns):
        look = series_style(index)
        curve = [r for r in rows if r.kind == "theory" and r.pattern == pattern]
        points = [r for r in rows if r.kind == "measured" and r.pattern == pattern and r.channel == "z"]
        _draw_curve(axes, curve, _PERIOD, color=look.color, linestyle=look.line, label=f"pattern {pattern}")
        _draw_intervals(axes, points, [r.modulation_period_s for r in points], look)
    _draw_curve(axes, [r for r in rows if r.kind == "eq. 17"], _PERIOD, color=SOFT, label="eq. 17")
    beside = [r for r in rows if r.kind == "printed"]
    if beside:
        _draw_curve(axes, beside, _PERIOD, "x", color=INK, label="printed")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("modulation period τ / s")
    axes.set_ylabel("σ in 1 h / m/s²")
    axes.legend()
    return figure


def table_plate(result: PlatformResult, *, printed: bool) -> Plate[PrecisionRow]:
    """Table 4: precision with pattern c of a minute by sampling rate; every run where there is none such.

    With the `printed` ones where the paper has numbers for the sensors.
    """
    # It compares sampling rates: with another pattern or period the precision is another anyway.
    runs = [
        run
        for run in result.runs
        if run.run.conditions["pattern"] == "c" and math.isclose(run.sampled.pattern.period_s, 60.0, rel_tol=1e-3)
    ] or result.runs
    theory = [_of_run(run, "theory", name, run.precision[name].theory) for run in runs for name in CHANNELS]
    caption = "Precision of the mean acceleration in an hour by sampling rate, with 99 % intervals, beside theory"
    if not printed:
        return Plate("table4", f"{caption}.", [*_measured(runs), *theory], draw_table)
    caption += (
        f" and what table 4 prints ({published.SOURCE}): its three values are not compatible with each other "
        "(p = 0.015)."
    )
    return Plate("table4", caption, [*_measured(runs), *theory, *_printed()], draw_table)


def draw_table(rows: Sequence[PrecisionRow]) -> Figure:
    """Sigma against the sampling rate."""
    figure = Figure(2.6)
    axes = figure.subplots()
    for index, channel in enumerate(CHANNELS):
        # Side by side, or the channels' intervals would cover each other.
        look, shift = series_style(index), 1.0 + 0.04 * (2 * index - 1)
        for kind in ("measured", "theory"):
            points = [r for r in rows if r.kind == kind and r.channel == channel]
            at, label = [shift * (r.sample_rate_hz or 1.0) for r in points], f"{kind}, {channel}"
            if kind == "measured":
                _draw_intervals(axes, points, at, look, label=label)
            else:
                sigma = [r.sigma_m_s2 for r in points]
                axes.plot(at, sigma, "_", color=look.color, markersize=14.0, label=label)
    beside = [r for r in rows if r.kind == "printed"]
    if beside:
        _draw_curve(axes, beside, "sample_rate_hz", "x", color=INK, label="printed")
    for row in rows:
        if row.kind == "printed theory":
            axes.axhline(row.sigma_m_s2, color=INK, linestyle="--", linewidth=0.7, label=row.kind)
    axes.set_xscale("log")
    axes.set_xlabel("sampling rate / Hz")
    axes.set_ylabel("σ in 1 h / m/s²")
    axes.legend(ncols=2)
    return figure


@dataclass(frozen=True)
class NoiseRow:
    """A band of a noise record's two-sided spectrum, with the fit and, for the paper's sensors, eq. 1 there."""

    run_id: str
    channel: str
    frequency_hz: float
    density_v2_hz: float
    fitted_v2_hz: float
    printed_v2_hz: float | None


def noise_plate(noises: Sequence[NoiseRecord], *, printed: bool) -> Plate[NoiseRow]:
    """Spectra of the noise records, beside eq. 1 where it is `printed` of the sensors."""
    rows = []
    for each in noises:
        frequency_hz = each.spectrum.frequency_hz
        beside = Q_FLEX_NOISE_V(frequency_hz).tolist() if printed else [None] * len(frequency_hz)
        columns = (frequency_hz.tolist(), each.spectrum.density.tolist(), each.fit(frequency_hz).tolist(), beside)
        rows += [NoiseRow(each.run_id, each.channel, *band) for band in zip(*columns, strict=True)]
    caption = "Noise of the chains at their outputs, two-sided, with the fitted form"
    return Plate(
        "noise", f"{caption} and eq. 1 ({published.SOURCE})." if printed else f"{caption}.", rows, draw_noise
    )


def draw_noise(rows: Sequence[NoiseRow]) -> Figure:
    """Density over frequency, both logarithmic."""
    figure = Figure(2.8)
    axes = figure.subplots()
    for index, key in enumerate(dict.fromkeys((row.run_id, row.channel) for row in rows)):
        bands = [row for row in rows if (row.run_id, row.channel) == key]
        look = series_style(index)
        frequency = [row.frequency_hz for row in bands]
        axes.plot(frequency, [row.density_v2_hz for row in bands], look.marker, color=look.color, label=" ".join(key))
        axes.plot(frequency, [row.fitted_v2_hz for row in bands], linestyle=look.line, color=look.color)
    printed = sorted((row.frequency_hz, row.printed_v2_hz) for row in rows if row.printed_v2_hz is not None)
    if printed:
        axes.plot(*zip(*printed, strict=True), "--", color=INK, label="eq. 1")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("frequency / Hz")
    axes.set_ylabel("density / V²/Hz")
    axes.legend()
    return figure
