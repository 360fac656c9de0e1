"""The noise of a channel as tables and as a document."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from rigctl.analysis.stability.allan import Deviation
from rigctl.analysis.stability.coefficients import FLICKER_FLOOR, Coefficient
from rigctl.report.quantities import counted, number, p_value, quantity, share
from rigctl.report.tables.result_table import ResultTable
from rigctl.stability import NoiseStudy

NOISE = {2: "f^2", 1: "f", 0: "white", -1: "flicker", -2: "random walk", -3: "f^-3", -4: "f^-4"}
"""What noise of a density f^alpha is called in the table."""

KINDS = {
    "allan": "overlapping Allan deviation",
    "modified": "modified Allan deviation",
    "time": "time deviation",
    "hadamard": "overlapping Hadamard deviation",
}


def noise_tables(study: NoiseStudy) -> Iterator[ResultTable]:
    """Deviations, lines and coefficients of one channel."""
    yield _deviations(study)
    if study.density is not None:
        if study.density.lines:
            yield _lines(study)
        yield _coefficients(study)


def noise_document(study: NoiseStudy) -> dict[str, Any]:
    """Everything that was found of one channel, as docs/commands.md describes it."""
    series, found = study.series, study.density
    return {
        "run": series.run or None,
        "channel": series.channel,
        "unit": series.unit,
        "samples": series.samples.size,
        "rate_hz": series.rate_hz,
        "remarks": list(series.remarks),
        "confidence": study.confidence,
        **{kind: [_deviation(each) for each in getattr(study.family, kind)] for kind in KINDS},
        "lowest": {
            **_deviation(study.floor.at),
            "bias_instability": study.floor.bias_instability,
            "where": study.floor.where,
        },
        "density": None if found is None else _density(study),
        "coefficients": [asdict(each) for each in study.coefficients],
    }


def _deviation(each: Deviation) -> dict[str, Any]:
    return asdict(each) | {"noise": NOISE[each.alpha]}


def _density(study: NoiseStudy) -> dict[str, Any]:
    found = study.density
    assert found is not None
    cells = {"frequency_hz": found.cells.frequency_hz, "psd": found.cells.psd, "dof": found.cells.dof}
    return {
        **cells,
        "band_hz": [found.band_hz[0], min(found.band_hz[1], study.series.rate_hz / 2.0)],
        "lines": [asdict(line) for line in found.lines],
        "terms": [asdict(term) | {"resolved": term.resolved} for term in found.terms],
        "chi2": found.chi2,
        "dof_of_fit": found.dof,
        "p_value": found.p_value,
        "scale": found.scale,
    }


def _deviations(study: NoiseStudy) -> ResultTable:
    series, family, unit = study.series, study.family, study.series.unit or "1"
    rows = [
        [
            number(allan.tau_s, 4),
            number(allan.value),
            _interval(allan),
            f"{allan.edf:.3g}" if allan.edf < 1000.0 else f"{allan.edf:.0f}",
            NOISE[allan.alpha] + ("*" if allan.carried else ""),
            number(modified.value),
            number(hadamard.value),
        ]
        for allan, modified, hadamard in zip(family.allan, family.modified, family.hadamard, strict=True)
    ]
    where = f"run {series.run}, {series.channel}" if series.run else series.channel
    title = f"{where}: {counted(series.samples.size, 'sample')} at {series.rate_hz:.6g} Hz; deviations in {unit}"
    notes = [f"range: interval of {share(round(study.confidence, 4))}; all estimates overlap"]
    if any(each.carried for each in family.allan):
        notes.append("* too few averages to identify noise: as at the time above")
    at = study.floor.at
    told = {
        "first": "the shortest averaging time, no floor",
        "last": f"over 0.664: bias instability at most {number(at.high / FLICKER_FLOOR)} {unit}",
        "between": f"over 0.664: bias instability {number(study.floor.bias_instability)} {unit} "
        f"({number(at.low / FLICKER_FLOOR)} to {number(at.high / FLICKER_FLOOR)})",
    }[study.floor.where]
    notes.append(f"lowest at {number(at.tau_s)} s: {number(at.value)} {unit}; {told}")
    columns = ["#tau / s", "#Allan", "#range / %", "#edf", "noise", "#modified", "#Hadamard"]
    return ResultTable(title, columns, rows, notes=[*notes, *series.remarks])


def _interval(each: Deviation) -> str:
    """In per cent of the value: what a person compares."""
    if each.value == 0.0:
        return "-"
    return f"{100.0 * (each.low / each.value - 1.0):+.1f} {100.0 * (each.high / each.value - 1.0):+.1f}"


def _lines(study: NoiseStudy) -> ResultTable:
    assert study.density is not None
    rows = [[number(each.frequency_hz, 6), quantity(each.amplitude, each.sigma)] for each in study.density.lines]
    return ResultTable("Steady lines", ["#frequency / Hz", f"#amplitude / {study.series.unit or '1'}"], rows)


def _coefficients(study: NoiseStudy) -> ResultTable:
    assert study.density is not None
    rows = [[each.symbol, each.name, _size(each), each.unit] for each in study.coefficients]
    found = study.density
    low_hz, high_hz = found.band_hz[0], min(found.band_hz[1], study.series.rate_hz / 2.0)
    band = (
        f" from {number(low_hz)} to {number(high_hz)} Hz"
        if low_hz > 0.0 or high_hz < study.series.rate_hz / 2.0
        else ""
    )
    notes = [f"fit of the density{band}: chi2/dof {number(found.chi2 / found.dof)}, {p_value(found.p_value)}"]
    if found.scale > 1.0:
        notes.append(
            "white noise, flicker and random walk do not describe this density: uncertainties widened "
            f"{number(found.scale)} times; look at the figure (--figures DIR)"
        )
    return ResultTable("Coefficients from the spectral density", ["", "name", "#value", "unit"], rows, notes=notes)


def _size(each: Coefficient) -> str:
    return quantity(each.value, each.sigma) if each.resolved else f"< {number(each.upper, 2)} (95 %)"
