"""Anybody's calibration, as the workbench sees it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice
from typing import Any

import numpy as np

from rigctl.campaign.recording import RunSource, TableFlaw
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, DataError, ProcedureError
from rigctl.effects.plugins import Plugin
from rigctl.experiments.table.asked import Asked
from rigctl.experiments.table.candidates import spans_of
from rigctl.experiments.table.catalogue import base_of, why_not
from rigctl.experiments.table.model.form import Form
from rigctl.experiments.table.model.model import TableModel, as_result, fitted
from rigctl.experiments.table.model.pieces import ColumnPiece, GroupPiece, Piece, PluginPiece
from rigctl.experiments.table.model.scanned import Scanned, Step
from rigctl.experiments.table.model.start import POINTS_MAX, place, place_of_step, solve
from rigctl.experiments.table.model.words import Group
from rigctl.experiments.table.proposals import options
from rigctl.experiments.table.spanned import Spanned
from rigctl.experiments.table.study_data import TableData
from rigctl.workbench.groups import Groups
from rigctl.workbench.study import (
    Candidate,
    Model,
    NotTestable,
    Observations,
    Proposal,
    Term,
)
from rigctl.workbench.study_base import StudyBase
from rigctl.workbench.verdict.fitted_model import fit_with_given_noise

# Places along a grid from which a fit is tried where the one from the best place does not converge.
_RESTARTS = 8
# Incomplete rows that are named.
_NAMED = 3


class TableStudy(StudyBase[TableData]):
    """A `table` recording: each row of readings.csv is a run.

    Plug-ins that act on "response" join the catalogue made from the columns. `DataError` or `ConfigError`, one line,
    for a question that the readings cannot be asked.
    """

    experiment = "table"

    def __init__(self, source: RunSource, plugins: Sequence[Plugin] = (), data: TableData | None = None) -> None:
        super().__init__(source, plugins, data)
        self._require_other_ids(plugins)
        self._require_enough(len(self.data.start))

    def _require_other_ids(self, plugins: Sequence[Plugin]) -> None:
        """`ConfigError` for a plug-in that changes what an effect made from the columns means."""
        for plugin in plugins:
            for effect in plugin.effects:
                if effect.partition("#")[0] in self.data.generic:
                    known = "the catalogue of this table has an effect of this id"
                    raise ConfigError(f"{plugin.path}: effect '{effect}': {known}; choose another")

    def reduced_source(self) -> TableData:
        """The readings, each a run."""
        return TableData.of(self.source)

    @property
    def observations(self) -> Observations:
        """The response and its conditions."""
        return self.data.observations

    def effects(self) -> Mapping[str, str]:
        """The catalogue made from the columns, then the plug-ins; of the scanned ones there may be `#2`, `#3`, ..."""
        return {name: effect.sentence for name, effect in self.data.generic.items()} | dict(super().effects())

    def family(self, effect: str) -> str:
        """Smooth functions of one column, each scan, all products, all that differs by the words of one column, all
        plug-ins are one family each."""
        if effect in self.catalogue:
            return "plug-ins"
        return self.data.generic[base_of(effect, self.data.generic)].family

    def breaks_level(self, effect: str, order: str) -> bool:
        """A step along the order, and levels by words, which may follow one another along it."""
        base = effect if effect in self.catalogue else base_of(effect, self.data.generic)
        return base == f"step[{order}]" or base.startswith("level[")

    def model(self, terms: Sequence[Term]) -> TableModel:
        """The baseline with these terms; what a term's choice leaves open is scanned for."""
        pieces: list[Piece | GroupPiece] = []
        for term in terms:
            if term.effect in {piece.term.effect for piece in pieces}:
                raise ConfigError(f"effect '{term.effect}' is in the model already; another needs another number")
            pieces.append(self._piece(term, pieces))
        # Once more beside all others: each was first placed without those that come after it.
        for i, piece in enumerate(pieces):
            if isinstance(piece, ColumnPiece) and isinstance(piece.form, Scanned):
                pieces[i] = self._placed(piece, pieces[:i] + pieces[i + 1 :])
        model = TableModel(self.observations, self.data.readings, tuple(pieces), self._starts(pieces))
        self._require_enough(len(model.starts))
        # Imagined readings have no values that a fit could settle on.
        curved = len(self.data.readings.expression.linear_in()) < len(self.data.start)
        return self._settled(model) if curved and pieces and not self.data.imagined else model

    def placed(self, model: Model, terms: Sequence[Term], whiten: Callable[[FloatArray], FloatArray]) -> TableModel:
        """See `rigctl.workbench.study.HoldsPlaces`."""
        assert isinstance(model, TableModel)
        pieces, asked = list(model.pieces), {term.effect: term.choice for term in terms}
        # Twice: each is first placed beside others that may move yet.
        for i, piece in [*enumerate(pieces)] * 2:
            if isinstance(piece, ColumnPiece) and isinstance(piece.form, Step):
                held, residual = self._beside(pieces[:i] + pieces[i + 1 :])
                near = asked[piece.term.effect].get(piece.form.scanned, piece.choice[piece.form.scanned])
                choice = piece.form.full_choice(place_of_step(piece.form, held, residual, near, whiten))
                pieces[i] = replace(piece, term=Term(piece.term.effect, choice))
        if tuple(piece.term for piece in pieces) == model.terms:
            return replace(model, whiten=whiten)
        return replace(model, pieces=tuple(pieces), starts=self._starts(pieces), whiten=whiten)

    def _settled(self, model: TableModel) -> TableModel:
        """The model starting where its fit ends: beside a curved baseline a scan is only a first guess."""
        first = fitted(model)
        if first is not None and first.verdict == "converged":
            return replace(model, starts=first.values)
        fits = [first] if first is not None else []
        for number, piece in enumerate(model.pieces):
            if not isinstance(piece, ColumnPiece) or not isinstance(piece.form, Scanned):
                continue
            grid = piece.form.grid(POINTS_MAX)
            for value in grid[:: max(len(grid) // _RESTARTS, 1)]:
                moved = replace(
                    piece, term=Term(piece.term.effect, {**piece.choice, **piece.form.full_choice(float(value))})
                )
                pieces = (*model.pieces[:number], moved, *model.pieces[number + 1 :])
                fit = fitted(replace(model, pieces=pieces, starts=self._starts(pieces)))
                fits += [fit] if fit is not None and fit.verdict == "converged" else []
        return replace(model, starts=min(fits, key=lambda fit: fit.chi2).values) if fits else model

    def candidates(self, model: Model, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        """Every effect that `model` lacks; a scanned one once per point of its grid."""
        groups, untestable = self.candidate_groups(model, values)
        return [each for of_effect in groups.values() for each in chain(*of_effect)], untestable

    def candidate_groups(self, model: Model, values: FloatArray) -> tuple[Groups, list[NotTestable]]:
        """The same by effect."""
        asked = self._asked(model, values)
        groups: Groups = {}
        untestable: list[NotTestable] = []
        for effect in (*self.data.generic, *self.catalogue):
            found = asked.of(effect)
            if isinstance(found, NotTestable):
                untestable.append(found)
            else:
                groups |= found
        return groups, untestable

    def groups_of(self, model: Model, values: FloatArray, effect: str) -> list[Sequence[Candidate]]:
        """The same of one effect."""
        base = effect if effect in self.catalogue else base_of(effect, self.data.generic)
        found = self._asked(model, values).of(base)
        return [] if isinstance(found, NotTestable) else found.get(effect, [])

    def _asked(self, model: Model, values: FloatArray) -> Asked:
        assert isinstance(model, TableModel)
        return Asked(self.data, self.catalogue, model, values)

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """The parameters, which are what a calibration is for, and the amplitude of what is periodic."""
        assert isinstance(model, TableModel)
        return as_result(model, values, covariance)

    def options(self) -> list[Proposal]:
        """Values of the columns at which the next readings might be taken."""
        return options(self.data.readings)

    def extended(self, proposals: Sequence[Proposal]) -> TableStudy:
        """These readings and some more, which mean nothing but where they are taken."""
        return self.with_data(self.data.with_proposals(proposals))

    def _piece(self, term: Term, before: Sequence[Piece | GroupPiece]) -> Piece | GroupPiece:
        if term.effect in self.catalogue:
            return PluginPiece(Term(term.effect), self.catalogue[term.effect], self.data.readings)
        effect = self.data.generic[base_of(term.effect, self.data.generic)]
        if reason := why_not(effect, self.data.readings):
            raise DataError(f"effect '{term.effect}' cannot be fitted: {reason}; remove it from the model")
        if isinstance(effect, Group):
            return GroupPiece(Term(term.effect), effect)
        assert isinstance(effect, Form)
        unit = self.data.readings.response.unit
        if not isinstance(effect, Scanned):
            slopes = self.data.baseline[1]
            held = np.concatenate([slopes, *(_basis(each, slopes) for each in before if _is_linear(each))], axis=1)
            return ColumnPiece(Term(term.effect, effect.settled(term.choice, spans_of(Spanned(held)))), effect, unit)
        piece = ColumnPiece(term, effect, unit)
        return piece if effect.scanned in term.choice else self._placed(piece, before)

    def _placed(self, piece: ColumnPiece, others: Sequence[Piece | GroupPiece]) -> ColumnPiece:
        """The piece with its scanned parameter where it fits best beside the others."""
        form = piece.form
        assert isinstance(form, Scanned)
        held, residual = self._beside(others)
        near = piece.choice.get(form.scanned)
        value = place(form, held, residual, 1.0 / self.data.readings.sigma, near)
        choice = {**form.full_choice(value), **{k: v for k, v in piece.choice.items() if k != form.scanned}}
        return ColumnPiece(Term(piece.term.effect, choice), form, piece.response_unit)

    def _beside(self, others: Sequence[Piece | GroupPiece]) -> tuple[FloatArray, FloatArray]:
        """What is fitted beside a piece, (n, m), and what the baseline leaves, (n,).

        Linear about the baseline's own fit: good enough to find a place, which is then fitted.
        """
        signal, slopes = self.data.baseline
        held = np.concatenate([slopes, *(_basis(each, slopes) for each in others if _is_linear(each))], axis=1)
        return held, self.observations.value - signal

    def _starts(self, pieces: Sequence[Piece | GroupPiece]) -> FloatArray:
        """The baseline's curved parameters as it alone is fitted; everything linear solved for beside them."""
        expression = self.data.readings.expression
        linear = [expression.parameters.index(name) for name in expression.linear_in()]
        signal, slopes = self.data.baseline
        bases = [_basis(piece, slopes) for piece in pieces if not isinstance(piece, PluginPiece)]
        sigma = self.data.readings.sigma
        with np.errstate(over="ignore"):
            design = np.concatenate([slopes[:, linear], *bases], axis=1) / sigma[:, None]
        change = solve(design, (self.observations.value - signal) / sigma) if design.shape[1] else None
        baseline = self.data.start.copy()
        if change is None:
            return baseline
        baseline[linear] += change[: len(linear)]
        amplitudes = iter(np.split(change[len(linear) :], np.cumsum([basis.shape[1] for basis in bases])[:-1]))
        parts = [
            np.zeros(len(piece.units)) if isinstance(piece, PluginPiece) else _joined(piece, next(amplitudes))
            for piece in pieces
        ]
        return np.concatenate([baseline, *parts])

    def _require_enough(self, parameters: int) -> None:
        rows = self.observations.value.size
        if rows <= parameters:
            raise TableFlaw(f"{rows} usable readings for {parameters} parameters; add readings, or leave terms out")


def require_fit(source: RunSource) -> tuple[str, ...]:
    """What there is to say of the readings that a table's fit leaves out, a line or none.

    `DataError` where the baseline cannot be fitted to its readings, as every command would find.
    """
    study = TableStudy(source)
    model = study.model(())
    try:
        fit_with_given_noise(model, {})
    except ProcedureError as error:
        raise TableFlaw(f"[table] baseline: {error}", ("table", "baseline")) from None
    incomplete = study.data.readings.incomplete
    if not incomplete:
        return ()
    named = [f"{row} has no {columns}" for row, columns in islice(incomplete.items(), _NAMED)]
    more = [f"and {len(incomplete) - _NAMED} more"] if len(incomplete) > _NAMED else []
    what = "row is left out, which lacks" if len(incomplete) == 1 else "rows are left out, which lack"
    return (f"readings.csv: {len(incomplete)} {what} what the fit needs: {', '.join([*named, *more])}",)


def _is_linear(piece: Piece | GroupPiece) -> bool:
    """Whether a piece is known but for linear parameters."""
    if not isinstance(piece, ColumnPiece):
        return isinstance(piece, GroupPiece)
    return not isinstance(piece.form, Scanned) or piece.form.scanned in piece.choice


def _basis(piece: Piece | GroupPiece, slopes: FloatArray) -> FloatArray:
    """What one unit of each linear parameter adds beside a baseline with these derivatives, (n, d)."""
    if isinstance(piece, GroupPiece):
        return piece.group.derivative(slopes)
    assert isinstance(piece, ColumnPiece)
    return piece.form.basis(piece.choice)


def _joined(piece: Piece | GroupPiece, linear: FloatArray) -> FloatArray:
    """All parameters of a piece in order."""
    return piece.joined(linear) if isinstance(piece, ColumnPiece) else linear
