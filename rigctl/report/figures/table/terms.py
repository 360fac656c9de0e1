"""Component-plus-residual plots: what each term of the model says, and the readings less all other terms.

A periodic term is drawn against its phase, so that a reader sees the wave; every other against its column.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.model.model import TableModel
from rigctl.experiments.table.model.pieces import ColumnPiece
from rigctl.experiments.table.model.scanned import Periodic
from rigctl.experiments.table.model.words import Slope
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate, file_name
from rigctl.report.figures.residuals import axis_label
from rigctl.report.figures.style import SOFT, series_style

_PHASE = "cycle"


@dataclass(frozen=True)
class TermRow:
    """One reading: `term` is what the term adds there, `reading` that and the residual, both in `unit`.

    `level` is the word that a slope by words goes by, else "".
    """

    effect: str
    axis: str
    value: float
    level: str
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
        # A term of two columns has no one axis.
        if not isinstance(piece, ColumnPiece) or len(piece.form.columns) != 1:
            continue
        added, column = piece.added(part, signal), piece.form.columns[0]
        places, axis = column.values, axis_label(column.name)
        if isinstance(piece.form, Periodic):
            period = float(part[0])
            # Phases count from the origin of the fit.
            places = (column.values - piece.choice["origin"]) / period % 1.0
            axis = f"phase of {period:.5g} {column.unit} / {_PHASE}".replace("  ", " ")
        words = piece.form.category.values if isinstance(piece.form, Slope) else np.full(places.size, "")
        cells = zip(places, words, added + residuals, added, model.readings.labels, strict=True)
        rows = [
            TermRow(
                piece.term.effect,
                axis,
                float(at),
                str(word),
                float(reading),
                float(term),
                label,
                *_named(response.name),
            )
            for at, word, reading, term, label in cells
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
    figure = Figure(2.2)
    axes = figure.subplots()
    axes.axhline(0.0, color=SOFT, linewidth=0.6)
    levels = sorted({row.level for row in rows})
    for number, level in enumerate(levels):
        along = sorted((row for row in rows if row.level == level), key=lambda row: row.value)
        places, look = [row.value for row in along], series_style(number)
        # A single series is one colour of points, and its line would vanish among them.
        line = look if level else series_style(1)
        axes.plot(places, [row.reading for row in along], look.marker, color=look.color, markersize=2.4, alpha=0.6)
        axes.plot(
            places, [row.term for row in along], color=line.color, linestyle=line.line if level else "-", label=level
        )
    if levels != [""]:
        axes.legend()
    axes.set_xlabel(rows[0].axis)
    axes.set_ylabel(" / ".join(filter(None, [rows[0].response, rows[0].unit])))
    axes.set_title(rows[0].effect)
    if rows[0].axis.endswith(_PHASE):
        axes.set_xlim(0.0, 1.0)
    return figure
