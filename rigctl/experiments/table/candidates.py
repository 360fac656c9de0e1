"""An effect as a candidate: its derivatives without what the model spans already, and without loss of digits."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rigctl.analysis.column_sums import LARGE
from rigctl.analysis.summed_columns import SummedScan
from rigctl.analysis.unit_columns import Scan
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.table.model.form import Choice, Form, Spans
from rigctl.experiments.table.model.forms import Turning
from rigctl.experiments.table.model.pieces import PluginPiece
from rigctl.experiments.table.model.scan_sums import sums_of
from rigctl.experiments.table.model.scanned import Scanned
from rigctl.experiments.table.model.start import span_of
from rigctl.experiments.table.model.words import Group, Level, Slope
from rigctl.workbench.study import Candidate, NotTestable, Term

Whitener = Callable[[FloatArray], FloatArray]
"""Of columns (n, k), or of one (n,)."""

# Of what the turning point explains: above, its second parameter buys next to nothing.
_ALL_BUT_LITTLE = 0.95
_SPANNED = 1e-7
"""A function is spanned by the model when less than this share of its norm lies outside."""


def candidate_of(form: Form, term: Term, response_unit: str, spanned: FloatArray, residual: FloatArray) -> Candidate:
    """A form as a candidate beside a model that spans `spanned` (n, rank) and has the residuals `residual` (n,).

    A square of years from 1950 to 2020 is all but a multiple of the years: its derivative is given without the
    constant, the line and so on *where the model spans these*, which changes neither what the effect explains nor its
    estimate, and keeps its size honest.
    """
    derivative = _without_trivial(form, form.parts(term.choice), spanned)
    return Candidate(
        term,
        tuple(f"{term.effect}{name}" for name in form.names(term.choice)),
        form.units(response_unit, term.choice),
        derivative,
        # The size that would make all of the residual: of a table's effects nobody knows another.
        _rms(residual) / np.maximum(_rms(derivative), np.finfo(np.float64).tiny),
        whole=isinstance(form, Level | Slope),
    )


class Scans:
    """The scans of a table's effects, each made once: they depend on the data, and on which trivial functions the
    model spans, not on its fit. A grid has so many `points`."""

    def __init__(self, points: int) -> None:
        self._points = points
        self._choices: dict[str, list[Choice]] = {}
        self._made: dict[tuple[str, tuple[bool, ...]], Scan | SummedScan] = {}

    def choices(self, form: Scanned) -> list[Choice]:
        """What a form is tried with."""
        if form.id not in self._choices:
            self._choices[form.id] = [form.full_choice(float(value)) for value in form.grid(self._points)]
        return self._choices[form.id]

    def scan(self, form: Scanned, spanned: FloatArray) -> Scan | SummedScan:
        """A form with each of its choices, without the trivial functions that the model spans."""
        trivial = form.trivial()
        held = tuple(_is_spanned(each[:, None], spanned) for each in trivial)
        if (form.id, held) not in self._made:
            space = _span([each for each, is_held in zip(trivial, held, strict=True) if is_held], len(spanned))
            made = _scan_of if len(spanned) <= LARGE else _summed_scan_of
            self._made[form.id, held] = made(form, self.choices(form), space)
        return self._made[form.id, held]


def _scan_of(form: Scanned, choices: Sequence[Choice], space: FloatArray) -> Scan:
    stack = form.scan(choices)
    columns = stack.reshape(len(stack), -1)
    # Twice: once leaves the rounding of a column that lies almost entirely in the span.
    for _ in range(2 if space.shape[1] else 0):
        columns = columns - space @ (space.T @ columns)
    return Scan(columns.reshape(stack.shape))


def _summed_scan_of(form: Scanned, choices: Sequence[Choice], space: FloatArray) -> SummedScan:
    return SummedScan(sums_of(form, choices), space)


def scan_candidates(
    form: Scanned, effect: str, scans: Scans, response_unit: str, spanned: FloatArray, residual: FloatArray
) -> list[Candidate]:
    """A scanned form with each of its choices: what `candidate_of` does for one."""
    scan = scans.scan(form, spanned)
    names, units = tuple(f"{effect}{name}" for name in form.names()), form.units(response_unit)
    typical = _rms(residual) / np.maximum(scan.rms, np.finfo(np.float64).tiny)
    return [
        Candidate(Term(effect, choice), names, units, scan, typical[place], place, scanned=1)
        for place, choice in enumerate(scans.choices(form))
    ]


def group_candidate(group: Group, slopes: FloatArray, residual: FloatArray) -> Candidate:
    """A parameter by words beside a model with these derivatives by the baseline's parameters, (n, m)."""
    derivative = group.derivative(slopes)
    return Candidate(
        Term(group.id),
        tuple(f"{group.id}{name}" for name in group.names()),
        group.units(""),
        derivative,
        _rms(residual) / np.maximum(_rms(derivative), np.finfo(np.float64).tiny),
        whole=True,
    )


def has_another_name(form: Form, spanned: FloatArray) -> str:
    """Why a form is another one beside a model that spans `spanned`; "" when it is itself."""
    if not isinstance(form, Turning):
        return ""
    column = form.column.name
    slope, curvature = form.basis(_only_choice(form)).T
    if _is_spanned((slope - slope.mean())[:, None], spanned):
        return f"the model has a slope in {column} already, beside which it is power2[{column}]"
    line = span_of(np.stack([np.ones(slope.size), slope], axis=1))
    bend = curvature - line @ (line.T @ curvature)
    return f"the model has a curvature in {column} already" if _is_spanned(bend[:, None], spanned) else ""


def is_a_square(form: Form, white_jacobian: FloatArray, white_residual: FloatArray, white: Whitener) -> bool:
    """Whether a turning point is all but the square of the column, p C**2, which is said more simply."""
    if not isinstance(form, Turning):
        return False
    spanned, column = span_of(white_jacobian), form.column.values
    whole = _explained(white(form.basis(_only_choice(form))), spanned, white_residual)
    return _explained(white(column[:, None] ** 2), spanned, white_residual) >= _ALL_BUT_LITTLE * whole


def spans_of(spanned: FloatArray) -> Spans:
    """What a model spans whose derivatives have this basis, (n, rank)."""
    return lambda function: _is_spanned(function[:, None], spanned)


def plugin_candidate(piece: PluginPiece, signal: FloatArray) -> Candidate | NotTestable:
    """A plug-in as a candidate where the baseline predicts `signal`."""
    none = np.zeros(len(piece.units))
    try:
        derivative = piece.slopes(none, signal)
    except DataError as error:
        return NotTestable(piece.term.effect, str(error))
    if not np.isfinite(derivative).all():
        return NotTestable(piece.term.effect, "it gives no finite number in some readings")
    if not derivative.any():
        return NotTestable(piece.term.effect, "it changes nothing in these readings")
    return Candidate(piece.term, piece.names, piece.units, derivative, piece.typical)


def _only_choice(turning: Turning) -> Choice:
    return turning.choices(lambda _: True)[0]


def _without_trivial(form: Form, parts: list[FloatArray], spanned: FloatArray) -> FloatArray:
    # Left out and not projected out: their difference from a large column would lose the digits.
    remaining = [part for part in parts if not _is_spanned(part, spanned)] or parts[-1:]
    derivative = np.sum(remaining, axis=0)
    space = _trivial_space(form, spanned)
    for _ in range(2 if space.shape[1] else 0):
        derivative = derivative - space @ (space.T @ derivative)
    return np.asarray(derivative)


def _trivial_space(form: Form, spanned: FloatArray) -> FloatArray:
    """A basis of the simple functions beside which a form is what remains, as far as the model spans them."""
    return _span([each for each in form.trivial() if _is_spanned(each[:, None], spanned)], len(spanned))


def _span(functions: Sequence[FloatArray], rows: int) -> FloatArray:
    return span_of(np.stack(functions, axis=1)) if functions else np.zeros((rows, 0))


def _explained(functions: FloatArray, spanned: FloatArray, residual: FloatArray) -> float:
    """Square sum of the residual that functions explain beside the model."""
    span = span_of(functions - spanned @ (spanned.T @ functions))
    return float(np.sum((span.T @ residual) ** 2))


def _is_spanned(functions: FloatArray, spanned: FloatArray) -> bool:
    outside = functions - spanned @ (spanned.T @ functions)
    return bool(np.linalg.norm(outside) <= _SPANNED * np.linalg.norm(functions))


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
