"""Component-plus-residual plots: what each term of the model says, and the readings less all other terms.

A periodic term is drawn against its phase, so that a reader sees the wave; every other against its column.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.model.model import TableModel
from rigctl.experiments.table.model.pieces import ColumnPiece
from rigctl.experiments.table.model.scanned import Periodic
from rigctl.report.figures.data import Plate, file_name
from rigctl.report.figures.residuals import axis_label
from rigctl.report.figures.style import SOFT, new_figure, series_style

_PHASE = "cycle"


@dataclass(frozen=True)
class TermRow:
    """One reading: `term` is what the term adds there, `reading` that and the residual, both in `unit`."""

    effect: str
    axis: str
    value: float
    reading: float
    term: float
    label: str
    response: str
    unit: str


def term_plates(model: TableModel, values: FloatArray) -> Iterator[Plate[TermRow]]:
    """A figure per term that goes by a single column, at the fitted parameters `values` (m,)."""
    given, response = model.observations, model.readings.response
    residuals = given.value - model.predict(values)
    signal = model.signal(values)
    for piece, part in model.with_values(values):
        if not isinstance(piece, ColumnPiece) or len(piece.form.columns) != 1:
            continue
        added, column = piece.added(part, signal), piece.form.columns[0]
        places, axis = column.values, axis_label(column.name)
        if isinstance(piece.form, Periodic):
            period = float(part[0])
            places = (column.values - piece.choice["origin"]) / period % 1.0
            axis = f"phase of {period:.5g} {column.unit} / {_PHASE}".replace("  ", " ")
        cells = zip(places, added + residuals, added, model.readings.labels, strict=True)
        rows = [
            TermRow(piece.term.effect, axis, float(place), float(reading), float(term), label, *_named(response.name))
            for place, reading, term, label in cells
        ]
        yield Plate(f"term_{file_name(piece.term.effect)}", _caption(piece.term.effect), rows, draw_term)


def _caption(effect: str) -> str:
    return (
        f"{effect}: the readings less everything else in the model (points), and what the term says (line). "
        "The scatter about the line is what the model leaves."
    )


def _named(response: str) -> tuple[str, str]:
    name, _, unit = axis_label(response).partition(" / ")
    return name, unit


def draw_term(rows: Sequence[TermRow]) -> Figure:
    """Readings as points, the term as a line along its axis."""
    figure = new_figure(2.2)
    axes = figure.subplots()
    look, line = series_style(0), series_style(1)
    along = sorted(rows, key=lambda row: row.value)
    axes.axhline(0.0, color=SOFT, linewidth=0.6)
    axes.plot([r.value for r in along], [r.reading for r in along], look.marker, color=look.color, ms=2.4, alpha=0.6)
    axes.plot([r.value for r in along], [r.term for r in along], color=line.color, linewidth=1.4)
    axes.set_xlabel(rows[0].axis)
    axes.set_ylabel(" / ".join(filter(None, [rows[0].response, rows[0].unit])))
    axes.set_title(rows[0].effect, loc="left")
    if rows[0].axis.endswith(_PHASE):
        axes.set_xlim(0.0, 1.0)
    return figure
