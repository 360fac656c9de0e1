"""The response of a table as a function of parameters: a baseline expression, and what terms add to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from rigctl.analysis.least_squares import FitResult, Parameter
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.model.descent import descend
from rigctl.experiments.table.model.pieces import ColumnPiece, GroupPiece, Piece
from rigctl.experiments.table.model.scanned import Periodic, Scanned, Step
from rigctl.experiments.table.model.step_place import place_sigma, place_sigma_in
from rigctl.experiments.table.model.words import Group
from rigctl.experiments.table.observe.readings import Readings
from rigctl.workbench.asked_again import once_in_a_row
from rigctl.workbench.known_inputs import KnownInputs
from rigctl.workbench.study import Observations, Term
from rigctl.workbench.study_base import parameters_as_json


@dataclass(frozen=True)
class TableModel:
    """A `rigctl.workbench.study.Model`; `starts` are values of all its parameters, (m,)."""

    observations: Observations
    readings: Readings
    pieces: tuple[Piece | GroupPiece, ...]
    starts: FloatArray
    whiten: Callable[[FloatArray], FloatArray] | None = None
    """What makes the readings' noise independent, where it is correlated and known: places are judged in it."""

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """What the baseline was extended with, choices filled in."""
        return tuple(piece.term for piece in self.pieces)

    @cached_property
    def parameters(self) -> Sequence[Parameter]:
        """Of the baseline, named as its expression does, and then of the terms."""
        baseline_values, parts = self._split(self.starts)
        names = self.readings.expression.parameters
        baseline = [Parameter(name, float(start)) for name, start in zip(names, baseline_values, strict=True)]
        return baseline + [
            each for piece, values in zip(self.pieces, parts, strict=True) for each in piece.parameters(values)
        ]

    @cached_property
    def units(self) -> Sequence[str]:
        """Of each parameter; the baseline's are not known: ""."""
        return ["" for _ in self.readings.expression.parameters] + [
            unit for piece in self.pieces for unit in piece.units
        ]

    @cached_property
    def owners(self) -> Sequence[str]:
        """The effect each parameter belongs to; "" for the baseline."""
        return ["" for _ in self.readings.expression.parameters] + [
            piece.term.effect for piece in self.pieces for _ in piece.units
        ]

    @cached_property
    def exactly_linear(self) -> frozenset[str]:
        """Of terms whose shape is fixed."""
        fixed = {
            piece.term.effect
            for piece in self.pieces
            if isinstance(piece, ColumnPiece) and not isinstance(piece.form, Scanned)
        }
        return frozenset(
            each.name for each, owner in zip(self.parameters, self.owners, strict=True) if owner in fixed
        )

    @property
    def local(self) -> Sequence[bool]:
        """A table's parameters hold for all of it."""
        return [False] * len(self.owners)

    @property
    def known_inputs(self) -> Sequence[KnownInputs]:
        """The uncertain constants of the baseline."""
        return self.readings.known_inputs

    def with_inputs(self, values: Mapping[str, float]) -> TableModel:
        """The same model with other values of some of these."""
        return replace(self, readings=self.readings.with_constants(values))

    def predict(self, values: FloatArray) -> FloatArray:
        """The response, shape (n,); NaN or infinite where undefined."""
        signal, _ = self._baseline(values)
        return np.asarray(sum((piece.added(part, signal) for piece, part in self._adding(values)), signal))

    @once_in_a_row
    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        signal, slopes = self._baseline(values)
        # Groups shift the baseline's parameters: what is added on top of the signal (a plug-in) sees that change too.
        changes = np.concatenate([slopes, *(group.derivative(slopes) for group, _ in self._groups(values))], axis=1)
        adding = self._adding(values)
        changes = changes + sum(
            (piece.passed_on(part, signal, changes) for piece, part in adding), np.zeros_like(changes)
        )
        baseline, *groups = np.split(changes, np.cumsum([slopes.shape[1], *self._group_sizes])[:-1], axis=1)
        # Parameters stand in the order of the terms, groups and others mixed.
        of_groups, of_others = iter(groups), iter([piece.slopes(part, signal) for piece, part in adding])
        pieces = [next(of_groups if isinstance(piece, GroupPiece) else of_others) for piece in self.pieces]
        return np.concatenate([baseline, *pieces], axis=1)

    def signal(self, values: FloatArray) -> FloatArray:
        """What the baseline predicts, its groups considered, shape (n,)."""
        return self._baseline(values)[0]

    def with_values(self, values: FloatArray) -> list[tuple[Piece | GroupPiece, FloatArray]]:
        """Each term with its own part of the parameters."""
        return list(zip(self.pieces, self._split(values)[1], strict=True))

    def _baseline(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        # A fit asks for the slopes where it has just asked for the response.
        at = np.asarray(values, dtype=np.float64).tobytes()
        if at not in self._last:
            shifts: dict[int, FloatArray] = {}
            for group, part in self._groups(values):
                shifts[group.place] = shifts.get(group.place, 0.0) + group.shift(part)
            found = self.readings.baseline(self._split(values)[0], shifts)
            for each in found:  # handed out twice
                each.setflags(write=False)
            self._last.clear()
            self._last[at] = found
        return self._last[at]

    @cached_property
    def _last(self) -> dict[bytes, tuple[FloatArray, FloatArray]]:
        """What the baseline was last asked for."""
        return {}

    def _groups(self, values: FloatArray) -> list[tuple[Group, FloatArray]]:
        return [(piece.group, part) for piece, part in self.with_values(values) if isinstance(piece, GroupPiece)]

    @property
    def _group_sizes(self) -> list[int]:
        return [len(piece.units) for piece in self.pieces if isinstance(piece, GroupPiece)]

    def _adding(self, values: FloatArray) -> list[tuple[Piece, FloatArray]]:
        return [(piece, part) for piece, part in self.with_values(values) if not isinstance(piece, GroupPiece)]

    def _split(self, values: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
        given = np.asarray(values, dtype=np.float64)
        baseline_values, *parts = (given[part] for part in self._parts)
        return baseline_values, parts

    @cached_property
    def _parts(self) -> list[slice]:
        """Of all parameters those of the baseline, and of each term."""
        sizes = [len(self.readings.expression.parameters), *(len(piece.units) for piece in self.pieces)]
        return [slice(*ends) for ends in pairwise(accumulate(sizes, initial=0))]


def as_result(model: TableModel, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
    """The parameters as JSON by name; of a periodic term the amplitude, where it is more than its uncertainty.

    An amplitude does not depend on where the phase is counted from, as cos and sin do.
    """
    result = parameters_as_json(model, values, covariance)
    for piece in model.pieces:
        if isinstance(piece, ColumnPiece) and isinstance(piece.form, Step):
            place = f"{piece.term.effect}.{piece.form.scanned}"
            result[place] = {**result[place], "sigma": _sigma_of_place(model, np.asarray(values), piece, piece.form)}
    names = list(result)
    for piece in model.pieces:
        if not isinstance(piece, ColumnPiece) or not isinstance(piece.form, Periodic):
            continue
        cos, sin = (f"{piece.term.effect}{name}" for name in piece.form.names())
        at = [names.index(cos), names.index(sin)]
        # sigma_A = |d A / d (cos, sin)| by the covariance, with d A = (cos, sin) / A.
        quadratures: FloatArray = np.asarray(values)[at]
        amplitude = float(np.linalg.norm(quadratures))
        variance = float(quadratures @ covariance[np.ix_(at, at)] @ quadratures)
        spread = max(variance, 0.0) ** 0.5
        if amplitude**2 > spread:  # below it the linear propagation says nothing
            entry = {"value": amplitude, "sigma": spread / amplitude, "unit": result.pop(sin)["unit"]}
            pairs = (
                (f"{piece.term.effect}.amplitude", entry) if name == cos else (name, result[name]) for name in result
            )
            result = dict(pairs)
    return result


def _sigma_of_place(model: TableModel, values: FloatArray, piece: ColumnPiece, step: Step) -> float:
    """See `place_sigma`; the readings' own sigmas are weights."""
    weight = 1.0 / model.observations.sigma
    names, others = [each.name for each in model.parameters], values.copy()
    at, *own = (names.index(f"{piece.term.effect}{name}") for name in (f".{step.scanned}", *step.names()))
    others[own] = 0.0
    jacobian = np.delete(model.jacobian(values), [at, *own], axis=1)
    # Steps on the way make curved parameters move a little: held where the fit has them.
    left = model.observations.value - model.predict(others)
    dof = model.observations.value.size - len(names)
    if model.whiten is not None:
        return place_sigma_in(step, float(values[at]), model.whiten, jacobian, left, dof)
    return place_sigma(step, float(values[at]), weight, jacobian * weight[:, None], left * weight, dof)


def fitted(model: TableModel) -> FitResult | None:
    """The model fitted with the readings' own weights; None when its start is undefined or the fit is singular."""
    given = model.observations
    return descend(
        lambda values: (given.value - model.predict(values)) / given.sigma,
        lambda values: model.jacobian(values) / given.sigma[:, None],
        model.parameters,
    )
