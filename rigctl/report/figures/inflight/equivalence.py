"""Figures of the test of the equivalence principle: spectra about its frequency, and delta before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, series_style

_SESSIONS = {"ep_inertial": "inertial", "ep_spin": "turning"}
_SCALE = 1e15


def equivalence_plates(ep: Mapping[str, Any]) -> list[Plate[Any]]:
    """A spectrum of every session, and all their deltas."""
    sessions = {name: each for name, each in ep.items() if name != "combined"}
    return [*(_spectrum_plate(name, each) for name, each in sessions.items()), _delta_plate(sessions, ep["combined"])]


@dataclass(frozen=True)
class SpectrumRow:
    """Amplitudes at a frequency, before correction and after; `noise_m_s2` is the mean amplitude of noise alone."""

    frequency_hz: float
    is_test: bool
    before_m_s2: float
    after_m_s2: float
    noise_m_s2: float


def _spectrum_plate(name: str, each: Mapping[str, Any]) -> Plate[SpectrumRow]:
    spectrum = each["spectrum"]
    amplitudes = zip(*(spectrum[key] for key in ("f_hz", "before_m_s2", "after_m_s2")), strict=True)
    # Of an amplitude with two normal components.
    noise = _MEAN_AMPLITUDE * _GRAVITY_M_S2 * each["delta"]["sigma_noise"]
    rows = [SpectrumRow(f_hz, f_hz == each["f_ep_hz"], before, after, noise) for f_hz, before, after in amplitudes]
    caption = (
        f"Amplitudes in 2 m_dx of {name} ({_SESSIONS[each['session']]}, {each['orbits']:.3g} orbits) at the frequency"
        " of the test (filled) and beside it (open), before correction with the calibration and after; the line is "
        "the mean amplitude of noise."
    )
    return Plate(f"equivalence_spectrum_{name}", caption, rows, draw_spectrum)


_GRAVITY_M_S2 = 7.9
_MEAN_AMPLITUDE = 1.2533
"""sqrt(pi / 2): Rayleigh's mean over the sigma of a component."""


def draw_spectrum(rows: Sequence[SpectrumRow]) -> Figure:
    """Both on logarithmic amplitudes."""
    figure = Figure(2.4)
    panel = figure.subplots()
    f_mhz = [1e3 * row.frequency_hz for row in rows]
    for series, name in enumerate(("before", "after")):
        look = series_style(series)
        values = [getattr(row, f"{name}_m_s2") for row in rows]
        panel.plot(f_mhz, values, look.marker, color=look.color, markerfacecolor="none", label=name)
        at = [place for place, row in enumerate(rows) if row.is_test]
        panel.plot([f_mhz[k] for k in at], [values[k] for k in at], look.marker, color=look.color)
    panel.axhline(rows[0].noise_m_s2, color=INK, linewidth=0.6, label="noise")
    panel.set_yscale("log")
    panel.set_xlabel("frequency / mHz")
    panel.set_ylabel("amplitude / (m/s²)")
    panel.grid()
    figure.legend(panel.labelled())
    return figure


@dataclass(frozen=True)
class DeltaRow:
    """delta of a session before correction and after, or of all after it, with standard uncertainties."""

    name: str
    session: str
    before: float | None
    before_sigma: float | None
    after: float
    after_sigma: float


def _delta_plate(sessions: Mapping[str, Mapping[str, Any]], combined: Mapping[str, Any]) -> Plate[DeltaRow]:
    rows = [
        DeltaRow(
            name,
            each["session"],
            each["uncorrected"]["value"],
            each["uncorrected"]["sigma"],
            each["delta"]["value"],
            each["delta"]["sigma"],
        )
        for name, each in sessions.items()
    ]
    rows.append(DeltaRow("all", "", None, None, combined["delta"]["value"], combined["delta"]["sigma"]))
    caption = (
        "The parameter of the equivalence principle by session, before correction with the calibration and after, "
        "with standard uncertainties (noise and calibration), and of all sessions together."
    )
    return Plate("equivalence_delta", caption, rows, draw_delta)


def draw_delta(rows: Sequence[DeltaRow]) -> Figure:
    """A row per session, the first on top."""
    figure = Figure(0.9 + 0.3 * len(rows))
    panel = figure.subplots()
    for series, name in enumerate(("before", "after")):
        look = series_style(series)
        shown = [(place, row) for place, row in enumerate(rows) if getattr(row, name) is not None]
        panel.errorbar(
            [_SCALE * getattr(row, name) for _, row in shown],
            [place + 0.12 * (2 * series - 1) for place, _ in shown],
            xerr=[_SCALE * getattr(row, f"{name}_sigma") for _, row in shown],
            fmt=look.marker,
            color=look.color,
            capsize=2.0,
            label=name,
        )
    panel.axvline(0.0, color=INK, linewidth=0.6)
    names = [f"{row.name}, {_SESSIONS[row.session]}" if row.session else row.name for row in rows]
    panel.set_yticks(range(len(rows)), names)
    # The first on top, with room for the markers on either side of it.
    panel.set_ylim(len(rows) - 0.5, -0.5)
    panel.set_xlabel("δ / 1e-15")
    panel.grid("x")
    figure.legend(panel.labelled())
    return figure
