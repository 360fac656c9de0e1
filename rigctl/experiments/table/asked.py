"""What can be asked beside a fitted model: the candidates of every effect, and why others are none."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, partial
from itertools import groupby

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import Effect
from rigctl.experiments.table.candidates import (
    Whitener,
    candidate_of,
    group_candidate,
    has_another_name,
    is_a_square,
    plugin_candidate,
    richer_candidates,
    scan_candidates,
    spans_of,
)
from rigctl.experiments.table.catalogue import next_id
from rigctl.experiments.table.model.form import Form
from rigctl.experiments.table.model.forms import Turning
from rigctl.experiments.table.model.model import TableModel
from rigctl.experiments.table.model.pieces import ColumnPiece, PluginPiece
from rigctl.experiments.table.model.scanned import Periodic, Scanned
from rigctl.experiments.table.model.start import span_of
from rigctl.experiments.table.model.words import Group, Level
from rigctl.experiments.table.spanned import Spanned
from rigctl.experiments.table.study_data import TableData
from rigctl.workbench.groups import Groups
from rigctl.workbench.study import Candidate, NotTestable, Term
from rigctl.workbench.verdict.offsets import in_units


class Asked:
    """Questions beside `model` at its fitted `values`; `plugins` are effects of the user's own."""

    def __init__(self, data: TableData, plugins: Mapping[str, Effect], model: TableModel, values: FloatArray) -> None:
        self._data, self._plugins, self._model, self._values = data, plugins, model, values
        self._taken = {term.effect for term in model.terms}

    def of(self, base: str) -> Groups | NotTestable:
        """The candidates of an effect, by its id in the catalogue, and of terms of it that the model has."""
        if base in self._plugins:
            return self._of_plugin(base)
        effect = self._data.generic[base]
        if base in self._taken and not isinstance(effect, Scanned):
            return {}
        if reason := self._data.why_not(base):
            return NotTestable(base, reason)
        if isinstance(effect, Group):
            return {base: [[group_candidate(effect, self._jacobian, self._left_rms)]]}
        assert isinstance(effect, Form)
        # In this order: a form that is another one by name is not asked about further.
        reason = (
            effect.unasked()
            or has_another_name(effect, self._spanned)
            or self._shared(effect)
            or self._simpler(effect)
        )
        if reason:
            return NotTestable(base, reason)
        unit = self._data.readings.response.unit
        if isinstance(effect, Scanned):
            name = next_id(base, self._taken)
            there, beside = self._periods(effect), (unit, self._spanned, self._left_rms)
            scan = scan_candidates(effect, name, [term.choice for term in there], self._data.scans, *beside)
            groups: Groups = {name: [scan]} if len(scan) else {}
            return groups | (richer_candidates(effect, there, *beside) if isinstance(effect, Periodic) else {})
        choices = effect.choices(spans_of(self._spanned))
        alike = (unit, self._spanned, self._left_rms, self._data.derivatives)
        found = [candidate_of(effect, Term(base, x), *alike) for x in choices]
        return {base: [list(group) for _, group in groupby(found, lambda each: len(each.names))]} if found else {}

    def _periods(self, form: Scanned) -> list[Term]:
        """The terms of a periodic form that the model has, with the periods as they are fitted."""
        return [
            Term(piece.term.effect, {**piece.choice, "period": float(part[0])})
            for piece, part in self._model.with_values(self._values)
            if isinstance(piece, ColumnPiece) and isinstance(piece.form, Periodic) and piece.form.id == form.id
        ]

    def _of_plugin(self, name: str) -> Groups | NotTestable:
        if name in self._taken:
            return {}
        piece = PluginPiece(Term(name), self._plugins[name], self._data.readings)
        found = plugin_candidate(piece, self._model.signal(self._values))
        return {name: [[found]]} if isinstance(found, Candidate) else found

    @cached_property
    def _jacobian(self) -> FloatArray:
        return self._model.jacobian(self._values)

    @cached_property
    def _spanned(self) -> Spanned:
        return Spanned(self._jacobian)

    @cached_property
    def _weighed(self) -> tuple[Whitener, FloatArray, FloatArray]:
        """How readings weigh, a basis of what the model spans then, and what it leaves."""
        weigh = partial(in_units, self._model.observations, np.arange(self._left.size))
        return weigh, span_of(weigh(self._jacobian)), weigh(self._left)

    @cached_property
    def _left(self) -> FloatArray:
        return np.asarray(self._model.observations.value - self._model.predict(self._values))

    @cached_property
    def _left_rms(self) -> float:
        return float(np.sqrt(np.mean(self._left**2)))

    def _shared(self, form: Form) -> str:
        """Why levels of words are part of the noise; "" where they are not."""
        if isinstance(form, Level) and self._data.ratios.get(form.category.name, 0.0) > 0.0:
            return f"readings of one {form.category.name} share an offset, which is part of the noise"
        return ""

    def _simpler(self, form: Form) -> str:
        if not isinstance(form, Turning):
            return ""
        weigh, spanned, left = self._weighed
        square = is_a_square(form, spans_of(self._spanned), spanned, left, weigh)
        return "the square of the column alone shows the same" if square else ""
