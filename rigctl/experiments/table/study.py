"""Anybody's calibration, as the workbench sees it."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigctl.campaign.recording import RunSource
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, DataError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.table.candidates import candidate_of, plugin_candidate
from rigctl.experiments.table.catalogue import base_of, generic, next_id, why_not
from rigctl.experiments.table.model.model import TableModel, fitted
from rigctl.experiments.table.model.pieces import ColumnPiece, Piece, PluginPiece
from rigctl.experiments.table.model.scanned import Scanned
from rigctl.experiments.table.model.start import POINTS_MAX, baseline_start, place, solve, span_of
from rigctl.experiments.table.observe.readings import Readings, declares_noise, read
from rigctl.experiments.table.proposals import options, with_proposals
from rigctl.workbench.study import (
    Candidate,
    Line,
    Model,
    NoisePool,
    NotTestable,
    Observations,
    Proposal,
    Series,
    Term,
)

_ROUNDING = 1e-13
_RESTARTS = 8
_GRID_POINTS, _GRID_LEAST = 1500, 100


class TableStudy:
    """A `rigctl.workbench.study.Study` of a `table` recording: each row of readings.csv is a run.

    `plugins` are further effects; those that act on "response" join the catalogue. `DataError` or `ConfigError`,
    one line, for a question that the readings cannot be asked.
    """

    experiment = "table"

    def __init__(self, source: RunSource, plugins: Sequence[Effect] = ()) -> None:
        self.readings = read(source)
        self._forms = generic(self.readings)
        self._plugins = {effect.id: effect for effect in plugins if effect.on == "response"}
        self._start = baseline_start(self.readings)
        if not declares_noise(source.header, self.readings.response.name):
            self.readings = replace(self.readings, sigma=self._scatter())
        self.observations = _observations(self.readings)
        self._require_enough(len(self._start))
        self._imagined = False

    def effects(self) -> Mapping[str, str]:
        """The catalogue made from the columns, then the plug-ins; of the scanned ones there may be `#2`, `#3`, ..."""
        return {name: form.sentence for name, form in self._forms.items()} | {
            name: effect.summary for name, effect in self._plugins.items()
        }

    def model(self, terms: Sequence[Term]) -> TableModel:
        """The baseline with these terms; what a term's choice leaves open is scanned for."""
        pieces: list[Piece] = []
        for term in terms:
            if term.effect in {piece.term.effect for piece in pieces}:
                raise ConfigError(f"effect '{term.effect}' is in the model already; another needs another number")
            pieces.append(self._piece(term, pieces))
        for i, piece in enumerate(pieces):
            if isinstance(piece, ColumnPiece) and isinstance(piece.form, Scanned):
                pieces[i] = self._placed(piece, pieces[:i] + pieces[i + 1 :])
        model = TableModel(self.observations, self.readings, tuple(pieces), self._starts(pieces))
        self._require_enough(len(model.starts))
        curved = len(self.readings.expression.linear_in()) < len(self._start)
        return self._settled(model) if curved and pieces and not self._imagined else model

    def _settled(self, model: TableModel) -> TableModel:
        """The model starting where its fit ends: beside a curved baseline a scan is only a first guess."""
        first = fitted(model)
        if first is not None and first.verdict == "converged":
            return replace(model, starts=first.values)
        found = [first] if first is not None else []
        for number, piece in enumerate(model.pieces):
            if not isinstance(piece, ColumnPiece) or not isinstance(piece.form, Scanned):
                continue
            grid = piece.form.grid(POINTS_MAX)
            for value in grid[:: max(len(grid) // _RESTARTS, 1)]:
                moved = replace(piece, term=Term(piece.term.effect, piece.form.full_choice(float(value))))
                pieces = (*model.pieces[:number], moved, *model.pieces[number + 1 :])
                fit = fitted(replace(model, pieces=pieces, starts=self._starts(pieces)))
                found += [fit] if fit is not None and fit.verdict == "converged" else []
        return replace(model, starts=min(found, key=lambda fit: fit.chi2).values) if found else model

    def candidates(self, model: Model, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        """Every effect that `model` lacks; a scanned one once per point of its grid."""
        assert isinstance(model, TableModel)
        taken = {term.effect for term in model.terms}
        held = span_of(model.jacobian(values))
        left = self.observations.value - model.predict(values)
        found: list[Candidate] = []
        untestable: list[NotTestable] = []
        for base, form in self._forms.items():
            if base in taken and not isinstance(form, Scanned):
                continue
            if reason := why_not(form, self.readings):
                untestable.append(NotTestable(base, reason))
                continue
            effect = next_id(base, taken)
            choices = self._grid(form) if isinstance(form, Scanned) else [{}]
            unit = self.readings.response.unit
            found += [candidate_of(form, Term(effect, choice), unit, held, left) for choice in choices]
        for name, effect_ in self._plugins.items():
            if name not in taken:
                piece = PluginPiece(Term(name), effect_, self.readings)
                entry = plugin_candidate(piece, model.signal(values))
                (found if isinstance(entry, Candidate) else untestable).append(entry)  # type: ignore[arg-type]
        return found, untestable

    def lines(self, model: Model) -> Sequence[Line]:
        """None: a table has no samples."""
        del model
        return ()

    def result(self, model: Model, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """The parameters: they are what a calibration is for."""
        sigmas = np.sqrt(np.diag(covariance))
        rows = zip(model.parameters, values, sigmas, model.units, strict=True)
        return {
            each.name: {"value": float(value), "sigma": float(sigma), "unit": unit}
            for each, value, sigma, unit in rows
        }

    def options(self) -> list[Proposal]:
        """Values of the columns at which the next readings might be taken."""
        return options(self.readings)

    def extended(self, proposals: Sequence[Proposal]) -> TableStudy:
        """These readings and some more, which mean nothing but where they are taken."""
        other = copy.copy(self)
        other.readings = with_proposals(self.readings, proposals)
        other._forms = generic(other.readings)
        other.observations = _observations(other.readings)
        other._imagined = True
        return other

    def _grid(self, form: Scanned) -> list[dict[str, float]]:
        points = max(_GRID_POINTS // max(len(self.readings.columns), 1), _GRID_LEAST)
        return [form.full_choice(float(value)) for value in form.grid(min(points, POINTS_MAX))]

    def _piece(self, term: Term, before: Sequence[Piece]) -> Piece:
        if term.effect in self._plugins:
            return PluginPiece(Term(term.effect), self._plugins[term.effect], self.readings)
        form = self._forms[base_of(term.effect, self._forms)]
        if reason := why_not(form, self.readings):
            raise DataError(f"effect '{term.effect}' cannot be fitted: {reason}; remove it from the model")
        piece = ColumnPiece(term, form, self.readings.response.unit)
        if not isinstance(form, Scanned):
            return ColumnPiece(Term(term.effect), form, self.readings.response.unit)
        return piece if form.scanned in term.choice else self._placed(piece, before)

    def _placed(self, piece: ColumnPiece, others: Sequence[Piece]) -> ColumnPiece:
        """The piece with its scanned parameter where it fits best beside the others."""
        form = piece.form
        assert isinstance(form, Scanned)
        beside = [each for each in others if isinstance(each, ColumnPiece) and _is_placed(each)]
        weight = self.readings.sigma[:, None]
        signal, slopes = self._baseline()
        held = np.concatenate([slopes, *(each.form.basis(each.choice) for each in beside)], axis=1)
        near = piece.choice.get(form.scanned)
        value = place(form, held / weight, (self.observations.value - signal) / weight[:, 0], near)
        choice = {**form.full_choice(value), **{k: v for k, v in piece.choice.items() if k != form.scanned}}
        return ColumnPiece(Term(piece.term.effect, choice), form, piece.response_unit)

    def _starts(self, pieces: Sequence[Piece]) -> FloatArray:
        """The baseline's curved parameters as it alone is fitted; everything linear solved for beside them."""
        expression = self.readings.expression
        linear = [expression.parameters.index(name) for name in expression.linear_in()]
        columns = [piece for piece in pieces if isinstance(piece, ColumnPiece)]
        bases = [piece.form.basis(piece.choice) for piece in columns]
        signal, slopes = self._baseline()
        with np.errstate(over="ignore"):
            design = np.concatenate([slopes[:, linear], *bases], axis=1) / self.readings.sigma[:, None]
        change = solve(design, (self.observations.value - signal) / self.readings.sigma) if design.shape[1] else None
        own = self._start.copy()
        if change is None:
            return own
        own[linear] += change[: len(linear)]
        found = iter(np.split(change[len(linear) :], np.cumsum([basis.shape[1] for basis in bases])[:-1]))
        parts = [
            piece.joined(next(found)) if isinstance(piece, ColumnPiece) else np.zeros(len(piece.units))
            for piece in pieces
        ]
        return np.concatenate([own, *parts])

    def _scatter(self) -> FloatArray:
        """What the baseline alone leaves, rms, but never less than rounding."""
        left = self.readings.response.values - self._baseline()[0]
        floor = _ROUNDING * float(np.abs(self.readings.response.values).max())
        return np.full(left.size, max(float(np.sqrt(np.mean(left**2))), floor) or 1.0)

    def _baseline(self) -> tuple[FloatArray, FloatArray]:
        given = dict(zip(self.readings.expression.parameters, self._start, strict=True))
        return self.readings.expression.evaluate(self.readings.numbers, given)

    def _require_enough(self, parameters: int) -> None:
        rows = self.observations.value.size
        if rows <= parameters:
            raise DataError(
                f"readings.csv: {rows} usable readings for {parameters} parameters; add readings, or leave terms out"
            )


def _is_placed(piece: ColumnPiece) -> bool:
    return not isinstance(piece.form, Scanned) or piece.form.scanned in piece.choice


def _observations(readings: Readings) -> Observations:
    n = readings.response.values.size
    none = np.zeros(n, dtype=np.intp)
    grouped = [category for category in readings.categories.values() if category.names_groups]
    return Observations(
        run_ids=readings.labels,
        series=(Series(readings.response.name, "", readings.response.unit),),
        pools=(NoisePool(readings.response.name, 0.0, readings.spec.order),),
        value=readings.response.values,
        sigma=readings.sigma,
        series_of=none,
        run_of=np.arange(n, dtype=np.intp),
        pool_of=none,
        group_of=none,
        block_of=readings.block_of,
        covariates={**readings.numbers, **{category.name: category.codes for category in grouped}},
        levels={category.name: category.levels for category in grouped},
    )
