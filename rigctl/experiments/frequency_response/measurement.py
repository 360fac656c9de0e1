"""Sensitivities as one measurement result: what is common to all frequencies correlates them."""

from __future__ import annotations

from rigctl.analysis.measurement_result import MeasurementResult, Quantity, checked, common_sources
from rigctl.experiments.frequency_response.result import OUTPUTS, OWN, UNITS, ResponseResult

METHOD = "Sine approximation of accelerometer and laser heads, run by run (ISO 16063-11, method 3)"


def sensitivities_measured(result: ResponseResult) -> MeasurementResult:
    """Magnitude and phase at each frequency; `ProcedureError` where there is none."""
    names = {row.frequency_hz: f"{row.frequency_hz:g} Hz" for row in result.frequencies}
    quantities = tuple(
        Quantity(f"{name}, {output.removesuffix('_deg')}", float(value), unit, complex=name)
        for row in result.frequencies
        for name in [f"sensitivity at {names[row.frequency_hz]}"]
        for output, unit, value in zip(OUTPUTS, UNITS, row.budget.values, strict=True)
    )
    sources = common_sources(
        len(quantities),
        (
            (f"{each.name} at {names[row.frequency_hz]}" if each.name in OWN else each.name, each, place, column)
            for row, place in zip(result.frequencies, _places(len(names)), strict=True)
            for each, column in zip(row.budget.contributions, row.budget.components.T, strict=True)
        ),
    )
    scattered = tuple(
        f"Runs at {names[row.frequency_hz]} scatter beyond their noise: weighed by their scatter."
        for row in result.frequencies
        if row.scattered
    )
    remarks = (*scattered, *map(_sentence, result.remarks))
    return checked(MeasurementResult(quantities, tuple(sources), METHOD, remarks, of_model=False))


def _sentence(remark: str) -> str:
    return f"{remark[0].upper()}{remark[1:]}."


def _places(frequencies: int) -> list[slice]:
    return [slice(2 * number, 2 * number + 2) for number in range(frequencies)]
