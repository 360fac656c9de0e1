"""An effect as a candidate: its derivatives without what the model spans already, and without loss of digits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np

from rigctl.analysis.lengths import lengths
from rigctl.analysis.summed_columns import SummedScan
from rigctl.analysis.unit_columns import Scan
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import DataError
from rigctl.experiments.table.model.form import PLAIN, Choice, Form, Spans
from rigctl.experiments.table.model.forms import Drift, Interaction, Offset, Power, Turning
from rigctl.experiments.table.model.functions import Function
from rigctl.experiments.table.model.pieces import PluginPiece
from rigctl.experiments.table.model.scan_sums import sums_of
from rigctl.experiments.table.model.scanned import Periodic, Scanned
from rigctl.experiments.table.model.start import span_of
from rigctl.experiments.table.model.words import Group, Level, Slope
from rigctl.experiments.table.observe.readings import Column
from rigctl.experiments.table.spanned import SPANNED, Functions, Spanned, some_of, span_of_functions
from rigctl.workbench.groups import Groups, ScanChoices
from rigctl.workbench.study import Candidate, NotTestable, Term

Whitener = Callable[[FloatArray], FloatArray]
"""Of columns (n, k), or of one (n,)."""

# Of what the turning point explains: above, its second parameter buys next to nothing.
_ALL_BUT_LITTLE = 0.95
# Of derivatives, 128 MB.
_NUMBERS_KEPT = 1 << 24


class Derivatives:
    """The derivatives of a table's forms beside models, each made once: they depend on the data, and on which simple
    functions a model spans, not on its fit."""

    def __init__(self) -> None:
        self._functions = Functions()
        self._asked: dict[tuple[Any, ...], tuple[list[FloatArray], list[FloatArray], range]] = {}
        self._made: dict[tuple[Any, ...], tuple[FloatArray, FloatArray]] = {}
        self._numbers = 0

    def of(self, form: Form, choice: Choice, spanned: Spanned) -> tuple[FloatArray, FloatArray]:
        """A derivative (n, d) without what the model spans, and its rms (d,)."""
        asked = (form.id, *sorted(choice.items()))
        parts, trivial, places = self._asked.get(asked) or self._noted(asked, form, choice, spanned)
        all_held = spanned.held(self._functions, places) if places else tuple(map(spanned.holds, [*parts, *trivial]))
        left_out, held = all_held[: len(parts)], all_held[len(parts) :]
        key = (*asked, left_out, held)
        if key in self._made:
            return self._made[key]
        derivative = _beside(parts, left_out, _space_of(trivial, held, spanned.rows))
        made = derivative, _rms(derivative)
        if self._has_room_for([derivative]):
            self._made[key] = made
        return made

    def _noted(
        self, asked: tuple[Any, ...], form: Form, choice: Choice, spanned: Spanned
    ) -> tuple[list[FloatArray], list[FloatArray], range]:
        """The functions of a form, (n, d) and (n, 1), and their places among all; none of those that are too long."""
        parts, trivial = form.parts(choice), [each[:, None] for each in form.trivial()]
        if spanned.few is not None or not self._has_room_for(noted := [*parts, *trivial]):
            return parts, trivial, range(0)
        self._asked[asked] = parts, trivial, self._functions.add(noted)
        return self._asked[asked]

    def _has_room_for(self, arrays: Sequence[FloatArray]) -> bool:
        self._numbers += sum(each.size for each in arrays)
        return self._numbers <= _NUMBERS_KEPT


def candidate_of(
    form: Form, term: Term, response_unit: str, spanned: Spanned, residual_rms: float, derivatives: Derivatives
) -> Candidate:
    """A form as a candidate beside a model that spans `spanned` and leaves residuals of this rms.

    A square of years from 1950 to 2020 is all but a multiple of the years: its derivative is given without the
    constant, the line and so on *where the model spans these*, which changes neither what the effect explains nor its
    estimate, and keeps its size honest.
    """
    columns: FloatArray | MadeColumns
    if spanned.few is None or not isinstance(form, Power | Turning | Function | Interaction | Drift):
        columns, rms = derivatives.of(form, term.choice, spanned)
    else:
        # Columns of a long table are made when they are asked for; for a typical size some of the rows do.
        columns, rows = MadeColumns(form, term.choice, spanned), some_of(spanned.rows)
        few = at_rows(form, rows)
        rms = _rms(_without_trivial(few, few.parts(term.choice), spanned.few))
    return Candidate(
        term,
        tuple(f"{term.effect}{name}" for name in form.names(term.choice)),
        form.units(response_unit, term.choice),
        columns,
        # The size that would make all of the residual: of a table's effects nobody knows another.
        residual_rms / np.maximum(rms, np.finfo(np.float64).tiny),
        whole=_whole_of(form, term.choice, spanned) if isinstance(form, Level | Slope) else None,
    )


def _whole_of(form: Level | Slope, choice: Choice, spanned: Spanned) -> Callable[[], FloatArray]:
    return lambda: _without_trivial(form, form.parts(form.of_each_word(choice)), spanned)


@dataclass(frozen=True)
class MadeColumns:
    """The derivative of a form, made anew whenever it is asked for."""

    form: Form
    choice: Choice
    spanned: Spanned

    def of(self, place: int) -> FloatArray:
        """The columns, (n, d)."""
        del place
        return _without_trivial(self.form, self.form.parts(self.choice), self.spanned)


def at_rows(form: Form, rows: IntArray) -> Form:
    """A form of columns of numbers at some of the rows."""
    columns = {
        each.name: replace(column, values=column.values[rows])
        for each in fields(form)  # type: ignore[arg-type]
        if isinstance(column := getattr(form, each.name), Column)
    }
    return replace(form, **columns)  # type: ignore[type-var]


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

    def scan(self, form: Scanned, spanned: Spanned) -> Scan | SummedScan:
        """A form with each of its choices, without the trivial functions that the model spans."""
        held = tuple(spanned.holds(each[:, None]) for each in form.trivial())
        if (form.id, held) not in self._made:
            made = _scan_of if spanned.few is None else _summed_scan_of
            self._made[form.id, held] = made(form, self.choices(form), partial(_held, form, held, spanned.rows))
        return self._made[form.id, held]


def _held(form: Form, held: Sequence[bool], rows: int) -> FloatArray:
    # Of a long table the functions are as long as its columns: made when they are asked for.
    return _space_of(form.trivial(), held, rows)


def _scan_of(form: Scanned, choices: Sequence[Choice], space_of: Callable[[], FloatArray]) -> Scan:
    stack, space = form.scan(choices), space_of()
    columns = stack.reshape(len(stack), -1)
    # Twice: once leaves the rounding of a column that lies almost entirely in the span.
    for _ in range(2 if space.shape[1] else 0):
        columns = columns - space @ (space.T @ columns)
    return Scan(columns.reshape(stack.shape))


def _summed_scan_of(form: Scanned, choices: Sequence[Choice], space_of: Callable[[], FloatArray]) -> SummedScan:
    return SummedScan(sums_of(form, choices), len(form.column.values), space_of)


def scan_candidates(
    form: Scanned,
    effect: str,
    there: Sequence[Choice],
    scans: Scans,
    response_unit: str,
    spanned: Spanned,
    residual_rms: float,
) -> ScanChoices:
    """A scanned form with each of its choices: what `candidate_of` does for one. `there` are periods of the model."""
    scan = scans.scan(form, spanned)
    names, units = tuple(f"{effect}{name}" for name in form.names()), form.units(response_unit)
    typical = residual_rms / np.maximum(scan.rms, np.finfo(np.float64).tiny)
    choices = scans.choices(form)
    return ScanChoices(effect, names, units, scan, choices, typical, _resolved(form, choices, there))


def _resolved(form: Scanned, choices: Sequence[Choice], there: Sequence[Choice]) -> IntArray:
    """Places of the choices that are others than the periods that are `there`."""
    if not isinstance(form, Periodic) or not there:
        return np.arange(len(choices))
    periods = np.array([choice["period"] for choice in choices])
    return np.flatnonzero(np.all([form.resolved_from(periods, one) for one in there], axis=0))


def richer_candidates(
    form: Periodic, terms: Sequence[Term], response_unit: str, spanned: Spanned, residual_rms: float
) -> Groups:
    """Periodic terms of the model, each with one harmonic more: what that adds at its period."""
    groups: Groups = {}
    space = _trivial_space(form, spanned)
    for term in terms:
        richer = [
            _richer(form, term, choice, response_unit, space, residual_rms) for choice in form.richer(term.choice)
        ]
        groups |= {term.effect: [richer]} if richer else {}
    return groups


def _richer(
    form: Periodic, term: Term, choice: Choice, response_unit: str, space: FloatArray, residual_rms: float
) -> Candidate:
    known, named = form.names(term.choice), form.names(choice)
    new = [place for place, name in enumerate(named) if name not in known]
    columns = form.basis(choice)[:, new]
    columns = columns - space @ (space.T @ columns)
    names, units = tuple(f"{term.effect}{named[place]}" for place in new), (response_unit,) * len(new)
    return Candidate(Term(term.effect, choice), names, units, columns, residual_rms / _rms(columns))


def group_candidate(group: Group, slopes: FloatArray, residual_rms: float) -> Candidate:
    """A parameter by words beside a model with these derivatives by the baseline's parameters, (n, m)."""
    derivative = group.derivative(slopes)
    return Candidate(
        Term(group.id),
        tuple(f"{group.id}{name}" for name in group.names()),
        group.units(""),
        derivative,
        residual_rms / np.maximum(_rms(derivative), np.finfo(np.float64).tiny),
        whole=partial(group.of_each_word, slopes),
    )


def has_another_name(form: Form, spanned: Spanned) -> str:
    """Why a form is another one beside a model that spans `spanned`; "" when it is itself."""
    if isinstance(form, Offset) and spanned.holds(form.basis(PLAIN)):
        return "the model has a constant already"
    if not isinstance(form, Turning):
        return ""
    column = form.column.name
    slope, curvature = form.basis(_only_choice(form)).T
    if spanned.holds((slope - slope.mean())[:, None]):
        return f"the model has a slope in {column} already, beside which it is power2[{column}]"
    if spanned.holds(np.ones((slope.size, 1))) and spanned.holds(_square_of(form, spans_of(spanned))):
        return f"the model has the square of {column} already, beside which it is linear[{column}]"
    line = span_of(np.stack([np.ones(slope.size), slope], axis=1))
    bend = curvature - line @ (line.T @ curvature)
    return f"the model has a curvature in {column} already" if spanned.holds(bend[:, None]) else ""


def is_a_square(
    turning: Turning, spans: Spans, spanned: FloatArray, white_residual: FloatArray, white: Whitener
) -> bool:
    """Whether a turning point is all but the square of the column, `power2[C]`, which is said more simply.

    `spans` asks a model; `spanned` (n, rank) is a basis of what its whitened derivatives span.
    """
    whole = _explained(white(turning.basis(_only_choice(turning))), spanned, white_residual)
    alone = _explained(white(_square_of(turning, spans)), spanned, white_residual)
    return alone >= _ALL_BUT_LITTLE * whole


def spans_of(spanned: Spanned) -> Spans:
    """The same as a question about one function."""
    return lambda function: spanned.holds(function[:, None])


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


def _square_of(turning: Turning, spans: Spans) -> FloatArray:
    """The square as in the column, (n, 1)."""
    square = Power(turning.column, 2)
    return square.basis(square.choices(spans)[0])


def _without_trivial(form: Form, parts: list[FloatArray], spanned: Spanned) -> FloatArray:
    return _beside(parts, tuple(map(spanned.holds, parts)), _trivial_space(form, spanned))


def _beside(parts: list[FloatArray], left_out: Sequence[bool], space: FloatArray) -> FloatArray:
    # Left out and not projected out: their difference from a large column would lose the digits.
    remaining = [part for part, is_held in zip(parts, left_out, strict=True) if not is_held] or parts[-1:]
    derivative = np.sum(remaining, axis=0) if len(remaining) > 1 else remaining[0]
    for _ in range(2 if space.shape[1] else 0):
        derivative = derivative - space @ (space.T @ derivative)
    return np.asarray(derivative)


def _trivial_space(form: Form, spanned: Spanned) -> FloatArray:
    """A basis of the simple functions beside which a form is what remains, as far as the model spans them."""
    trivial = form.trivial()
    return _space_of(trivial, [spanned.holds(each[:, None]) for each in trivial], spanned.rows)


def _space_of(trivial: Sequence[FloatArray], held: Sequence[bool], rows: int) -> FloatArray:
    return span_of_functions([each.ravel() for each, is_held in zip(trivial, held, strict=True) if is_held], rows)


def _explained(functions: FloatArray, spanned: FloatArray, residual: FloatArray) -> float:
    """Square sum of the residual that functions explain beside the model."""
    outside = functions - spanned @ (spanned.T @ functions)
    # What the model spans leaves its rounding, which has a direction too.
    beyond = lengths(outside) > SPANNED * lengths(functions)
    return float(np.sum((span_of(outside[:, beyond]).T @ residual) ** 2))


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(lengths(values) / np.sqrt(len(values)))
