"""Sensing axes, for a page and a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rigctl.core.errors import DataError, ProcedureError
from rigctl.experiments.sensing_axis.analysis import analyse, uncertainties_of
from rigctl.report.drawn import Drawn
from rigctl.report.quantities import number, quantity
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.terminal import print_result
from rigctl.workbench.workbench import Workbench


def show(found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    """Print axes, angles and budget."""
    print_result(found, reference)


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """The axes with their figures, and the spectrum of what is left in the samples."""
    from rigctl.report.figures.sensing_axis.figures import plates_of
    from rigctl.report.figures.spectrum import spectrum_plates

    store = workbench.store
    spectra = list(spectrum_plates(store, lines_hz, found))
    try:
        axes = analyse(workbench)
        plates, left_out = plates_of(axes, uncertainties_of(store.header))
    except (ProcedureError, DataError) as error:
        return Drawn(spectra=spectra, left_out={"figures of the sensing axes": str(error)})
    numbers = axes.as_json()
    return Drawn(numbers, _tables(numbers), plates, spectra, left_out)


def null_vectors(workbench: Workbench) -> dict[str, list[dict[str, Any]]]:
    """The null vectors about their planes as figures 15 to 17 show them, by axis."""
    from rigctl.report.figures.sensing_axis.plane import plane_plate

    found = analyse(workbench)
    settings = found.fit.model.package.axes
    return {
        name: [asdict(row) for row in plane_plate(name, axis, settings[name]).rows]
        for name, axis in found.axes.items()
    }


def _tables(told: Mapping[str, Any]) -> list[ResultTable]:
    """Sensing axes and the angles between them, as far as there are any."""
    axes, angles = told["axes"], told["angles"]
    tables = []
    if axes:
        rows = [
            [
                name,
                *(f"{component:+.6f}" for component in axis["coc"]),
                f"{axis['std_hc_2sigma_arcsec']:.2f}",
                number(axis["requirement_arcsec"]),
                str(axis["vectors"]),
                "pass" if axis["pass"] else "fail",
            ]
            for name, axis in axes.items()
        ]
        columns = ["axis", "#x", "#y", "#z", "#half-cone / arcsec", "#required / arcsec", "#vectors", "verdict"]
        sentence = "Sensing axes in the cube's frame, with their half-cone deviation at 2 sigma."
        tables.append(ResultTable(sentence, columns, rows, [not axis["pass"] for axis in axes.values()]))
    if angles:
        rows = [[pair, quantity(angle["deg"], angle["sigma_deg"], "deg")] for pair, angle in angles.items()]
        tables.append(ResultTable("Angles between the axes.", ["axes", "#angle between them"], rows))
    return tables
