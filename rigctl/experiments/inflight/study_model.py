"""Baseline and effects as a function of parameters, for the lines of all halves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.analysis.least_squares import Parameter
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.effects.catalogue import Effect
from rigctl.experiments.inflight.effect_changes import STEP
from rigctl.experiments.inflight.model.parameters import NAMES, NUISANCES
from rigctl.experiments.inflight.study_data import FlightData
from rigctl.workbench.asked_again import once_in_a_row
from rigctl.workbench.study import Observations, Term


class InflightModel:
    """A `rigctl.workbench.study.Model` of `data`."""

    def __init__(self, data: FlightData, terms: Sequence[Term], effects: Sequence[Effect]) -> None:
        self.data, self._effects = data, tuple(effects)
        self.terms: tuple[Term, ...] = tuple(terms)
        baseline = data.baseline
        added = [(effect, name) for effect in effects for name in effect.parameters]
        self.parameters: Sequence[Parameter] = (
            *baseline.parameters,
            *(
                Parameter(shown_name(effect, name, effects), 0.0, step=STEP * effect.typical[name])
                for effect, name in added
            ),
        )
        self.units: Sequence[str] = (*baseline.units, *(effect.parameters[name] for effect, name in added))
        self.owners: Sequence[str] = (*("" for _ in baseline.parameters), *(effect.id for effect, _ in added))
        self.local: Sequence[bool] = tuple(
            parameter.name.startswith("inverse_gain[") for parameter in self.parameters
        )

    @property
    def observations(self) -> Observations:
        """The data, in the order of predictions."""
        return self.data.observations

    def predict(self, values: FloatArray) -> FloatArray:
        """The data for parameter values of shape (m,); shape (n,)."""
        shared, changes = self._split(values)
        return np.asarray(self.observations.value - self.data.baseline.residual(shared, changes))

    @once_in_a_row
    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        shared, changes = self._split(values)
        baseline = self.data.baseline
        columns = [-baseline.jacobian(shared, changes)]
        for effect, parameters in self.by_effect(values):
            for derivative in self.data.effects.derivatives(effect, parameters):
                # Effects are taken out of the measured side: predictions move by plus what they do.
                columns.append(baseline.shift(shared, derivative)[:, None])
        return np.hstack(columns)

    def residuals(self, values: FloatArray) -> FloatArray:
        """Data less `predict` for sets of values (m, sets), (n, sets); effects are linear about the sets' mean."""
        shared = len(self.data.baseline.parameters)
        middle = values.mean(axis=1)
        _, changes = self._split(middle)
        added = self.jacobian(middle)[:, shared:] @ (values - middle[:, None])[shared:]
        return np.asarray(self.data.baseline.residuals(values[:shared], changes) - added)

    def _split(self, values: FloatArray) -> tuple[FloatArray, list[ComplexArray] | None]:
        """The baseline's values, and what the effects do to the amplitudes of all halves."""
        total: list[ComplexArray] | None = None
        for effect, parameters in self.by_effect(values):
            changes = self.data.effects.changes(effect, parameters)
            total = changes if total is None else [a + b for a, b in zip(total, changes, strict=True)]
        return values[: len(self.data.baseline.parameters)], total

    def by_effect(self, values: FloatArray) -> list[tuple[Effect, FloatArray]]:
        """Each effect with the values of its parameters."""
        ends = np.cumsum([len(effect.parameters) for effect in self._effects])[:-1]
        parts = np.split(values[len(self.data.baseline.parameters) :], ends)
        return list(zip(self._effects, parts, strict=False))


def shown_name(effect: Effect, name: str, beside: Sequence[Effect]) -> str:
    """A parameter's name in a model; with its effect's before it where another has the same."""
    others = {other for each in beside if each.id != effect.id for other in each.parameters}
    return f"{effect.id}.{name}" if name in others or name in (*NAMES, *NUISANCES) else name
