"""What effects do to the line amplitudes of some runs, and the derivatives of that by their parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.inflight.model.flight import Reducer
from rigctl.experiments.inflight.observe.reduction import ReducedRun

STEP = 1e-3
"""Of a parameter's typical size: the step of its derivative by differences."""

_LINEAR = 1e-6
"""Relative deviation from the sum of its parts below which an effect counts as linear in its parameters."""

_MOST_KEPT = 200


class EffectChanges:
    """Amplitudes that effects add to all halves of `runs`, each (lines, series); evaluated once per effect.

    `usual_k` (2,) are the sensors' temperatures at which the baseline holds: their means over the recording.
    """

    def __init__(self, runs: Sequence[ReducedRun], usual_k: FloatArray) -> None:
        # An imagined run may be a recorded one once more.
        self._runs = [id(run.coarse) for run in runs]
        self._reducers = {id(run.coarse): Reducer(run, usual_k) for run in runs}
        self._evaluations: dict[tuple[str, tuple[tuple[str, float], ...]], list[ComplexArray]] = {}
        self._units: dict[tuple[str, ...], list[list[ComplexArray]] | None] = {}

    def changes(self, effect: Effect, values: FloatArray) -> list[ComplexArray]:
        """What an effect does to the amplitudes of all halves."""
        units = self._linear(effect)
        if units is None:
            return self._evaluated(effect, values)
        totals = [np.zeros_like(each) for each in units[0]]
        for value, unit in zip(values, units, strict=True):
            for total, part in zip(totals, unit, strict=True):
                total += value * part
        return totals

    def derivatives(self, effect: Effect, values: FloatArray) -> list[list[ComplexArray]]:
        """d changes / d each of its parameters."""
        units = self._linear(effect)
        if units is not None:
            return units
        derivatives = []
        for place, name in enumerate(effect.parameters):
            step = STEP * abs(effect.typical[name])
            one = step * np.eye(len(values))[place]
            up, down = (self._evaluated(effect, values + each) for each in (one, -one))
            derivatives.append([(a - b) / (2.0 * step) for a, b in zip(up, down, strict=True)])
        return derivatives

    def reason_for_none(self, effect: Effect) -> str | None:
        """Why an effect cannot be evaluated in these runs, or that it changes nothing; None when it does."""
        try:
            units = self.derivatives(effect, np.zeros(len(effect.parameters)))
        except DataError as error:
            return str(error)
        size = max(float(np.max(np.abs(half), initial=0.0)) for unit in units for half in unit)
        return None if size > 0.0 else "it changes nothing in these runs"

    def _linear(self, effect: Effect) -> list[list[ComplexArray]] | None:
        """Changes per unit of each parameter; None for an effect that is not linear in them."""
        form = (effect.id, *effect.parameters)
        if form not in self._units:
            typical = np.array([effect.typical[name] for name in effect.parameters])
            units = [
                [each / size for each in self._evaluated(effect, one)]
                for size, one in zip(typical, np.diag(typical), strict=True)
            ]
            # All at once and at twice the size: a square of one or a product of two would show.
            whole = self._evaluated(effect, 2.0 * typical)
            summed = [
                sum(2.0 * size * unit[half] for size, unit in zip(typical, units, strict=True))
                for half in range(len(whole))
            ]
            off = sum(float(np.sum(np.abs(a - b) ** 2)) for a, b in zip(whole, summed, strict=True))
            size = sum(float(np.sum(np.abs(a) ** 2)) for a in whole)
            self._units[form] = units if off <= _LINEAR**2 * size else None
        return self._units[form]

    def _evaluated(self, effect: Effect, values: FloatArray) -> list[ComplexArray]:
        parameters = dict(zip(effect.parameters, map(float, values), strict=True))
        key = (effect.id, tuple(parameters.items()))
        if key not in self._evaluations:
            if len(self._evaluations) > _MOST_KEPT:
                # Simplest bound of memory: a fit asks for the same few values again and again.
                self._evaluations.clear()
            changes = {each: reducer.changes(effect, parameters) for each, reducer in self._reducers.items()}
            self._evaluations[key] = [half for each in self._runs for half in changes[each]]
        return self._evaluations[key]
