"""What a term adds to the response of a table: from the generic catalogue, or from somebody's plug-in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from rigctl.analysis.least_squares import Parameter
from rigctl.core.arrays import FloatArray, TextArray
from rigctl.core.errors import DataError
from rigctl.effects.catalogue import Effect
from rigctl.experiments.table.model.form import Choice, Form
from rigctl.experiments.table.model.scanned import Periodic, Scanned, Step
from rigctl.experiments.table.model.words import Group
from rigctl.experiments.table.observe.readings import Readings
from rigctl.workbench.study import Term

# Central differences: the third derivative enters at 1e-8, rounding at 1e-12.
_STEP_IN_TYPICAL = 1e-4


class Piece(Protocol):
    """One term of a model, as a function of its own parameters and of what the baseline predicts, `signal` (n,).

    A `GroupPiece` alters the baseline instead; see there.
    """

    @property
    def term(self) -> Term:
        """What it is for."""
        ...

    @property
    def units(self) -> tuple[str, ...]:
        """Of its parameters."""
        ...

    def parameters(self, values: FloatArray) -> list[Parameter]:
        """With these starts."""
        ...

    def added(self, values: FloatArray, signal: FloatArray) -> FloatArray:
        """What it adds to the response, shape (n,)."""
        ...

    def slopes(self, values: FloatArray, signal: FloatArray) -> FloatArray:
        """Derivatives of `added` by its parameters, shape (n, m)."""
        ...

    def passed_on(self, values: FloatArray, signal: FloatArray, changes: FloatArray) -> FloatArray:
        """How `added` changes when the signal changes by each column of `changes`, (n, k)."""
        ...


@dataclass(frozen=True)
class ColumnPiece:
    """A form of the generic catalogue, whose scanned parameter is fitted on from the term's choice."""

    term: Term
    form: Form
    response_unit: str

    @property
    def choice(self) -> Choice:
        """Values of the scanned parameter and its origin."""
        return self.term.choice

    @property
    def units(self) -> tuple[str, ...]:
        """Of its parameters."""
        linear = self.form.units(self.response_unit, self.choice)
        if not isinstance(self.form, Scanned):
            return linear
        unit = self.form.scanned_unit()
        return (unit, *linear) if self.form.first else (*linear, unit)

    def joined(self, linear: FloatArray) -> FloatArray:
        """All parameters in order: the linear ones, and the scanned one as chosen."""
        if not isinstance(self.form, Scanned):
            return linear
        return np.insert(linear, 0 if self.form.first else linear.size, self.choice[self.form.scanned])

    def parameters(self, values: FloatArray) -> list[Parameter]:
        """With these starts; the place of a step is held."""
        names = [f"{self.term.effect}{name}" for name in self.form.names(self.choice)]
        if isinstance(self.form, Scanned):
            names.insert(0 if self.form.first else len(names), f"{self.term.effect}.{self.form.scanned}")
        parameters = [Parameter(name, float(value)) for name, value in zip(names, values, strict=True)]
        # Beyond lies another peak of the periodogram, which a scan would have preferred.
        if isinstance(self.form, Periodic):
            lower, upper = self.form.neighbourhood(self.choice["period"])
            parameters[0] = Parameter(names[0], float(np.clip(values[0], lower, upper)), lower=lower, upper=upper)
        # Predictions jump with the place and have no derivative by it.
        if isinstance(self.form, Step):
            parameters[-1] = Parameter(names[-1], float(values[-1]), fixed=True)
        return parameters

    def added(self, values: FloatArray, signal: FloatArray) -> FloatArray:
        """See `Piece`."""
        del signal
        choice, linear = self._split(values)
        return np.asarray(self._basis(choice) @ linear)

    def slopes(self, values: FloatArray, signal: FloatArray) -> FloatArray:
        """See `Piece`."""
        del signal
        choice, linear = self._split(values)
        basis = self._basis(choice)
        if not isinstance(self.form, Scanned):
            return basis
        slope = self.form.slope(choice, linear, basis)
        return np.column_stack([slope, basis] if self.form.first else [basis, slope])

    def passed_on(self, values: FloatArray, signal: FloatArray, changes: FloatArray) -> FloatArray:
        """Zero: it does not depend on the signal."""
        del values, signal
        return np.zeros_like(changes)

    def _basis(self, choice: Choice) -> FloatArray:
        # A fit asks for the slopes where it has just asked for what is added.
        at = choice[self.form.scanned] if isinstance(self.form, Scanned) else 0.0
        if at not in self._last:
            basis = self.form.basis(choice)
            basis.setflags(write=False)  # handed out twice
            self._last.clear()
            self._last[at] = basis
        return self._last[at]

    @cached_property
    def _last(self) -> dict[float, FloatArray]:
        """The columns with the scanned value that was last asked for."""
        return {}

    def _split(self, values: FloatArray) -> tuple[Choice, FloatArray]:
        if not isinstance(self.form, Scanned):
            return self.choice, values
        # A period stands before its amplitudes, a rate or a place behind.
        scanned, linear = (values[0], values[1:]) if self.form.first else (values[-1], values[:-1])
        return {**self.choice, self.form.scanned: float(scanned)}, linear


@dataclass(frozen=True)
class GroupPiece:
    """A parameter of the baseline that is different for each word: it acts before all that adds to the signal."""

    term: Term
    group: Group

    @property
    def units(self) -> tuple[str, ...]:
        """Of its parameters."""
        return self.group.units("")

    def parameters(self, values: FloatArray) -> list[Parameter]:
        """With these starts."""
        names = [f"{self.term.effect}{name}" for name in self.group.names()]
        return [Parameter(name, float(value)) for name, value in zip(names, values, strict=True)]


@dataclass(frozen=True)
class ReadingsRun:
    """What a plug-in effect is given: `signal` is the response as the baseline predicts it, shape (n,)."""

    signal: FloatArray
    columns: Mapping[str, FloatArray | TextArray]

    def column(self, name: str) -> FloatArray | TextArray:
        """A column of readings.csv over the rows in use, of numbers or of words; `DataError` when there is none."""
        if name not in self.columns:
            raise DataError(f"readings.csv has no column {name}; it has {', '.join(self.columns)}")
        return self.columns[name]


@dataclass(frozen=True)
class PluginPiece:
    """An effect somebody wrote: it acts on the response that the baseline predicts."""

    term: Term
    effect: Effect
    readings: Readings

    @property
    def units(self) -> tuple[str, ...]:
        """Of its parameters."""
        return tuple(self.effect.parameters.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Of its parameters."""
        return tuple(f"{self.term.effect}.{name}" for name in self.effect.parameters)

    @property
    def typical(self) -> FloatArray:
        """Plausible sizes of its parameters."""
        return np.array([self.effect.typical[name] for name in self.effect.parameters])

    def parameters(self, values: FloatArray) -> list[Parameter]:
        """With these starts."""
        return [Parameter(name, float(value)) for name, value in zip(self.names, values, strict=True)]

    def added(self, values: FloatArray, signal: FloatArray) -> FloatArray:
        """See `Piece`; `DataError` when the plug-in gives something else than a finite number per row."""
        given = {name: np.float64(value) for name, value in zip(self.effect.parameters, values, strict=True)}
        added = np.asarray(self.effect(ReadingsRun(signal, self.readings.given), **given), dtype=np.float64)
        if added.shape not in {(), signal.shape}:
            raise DataError(
                f"effect {self.effect.id} gives shape {added.shape} for {signal.size} readings; return one each"
            )
        return np.broadcast_to(added, signal.shape)

    def slopes(self, values: FloatArray, signal: FloatArray) -> FloatArray:
        """See `Piece`; by central differences."""
        steps = _STEP_IN_TYPICAL * self.typical
        return _differences(lambda step: self.added(values + step, signal), np.diag(steps)) / steps

    def passed_on(self, values: FloatArray, signal: FloatArray, changes: FloatArray) -> FloatArray:
        """See `Piece`; by central differences."""
        # Along each column of changes, scaled so that the signal moves by a ten-thousandth of itself.
        size = float(np.abs(signal).max()) or 1.0
        largest = np.abs(changes).max(axis=0)
        scale = _STEP_IN_TYPICAL * size / np.where(largest > 0.0, largest, 1.0)
        return _differences(lambda step: self.added(values, signal + step), (changes * scale).T) / scale


def _differences(function: Callable[[FloatArray], FloatArray], steps: FloatArray) -> FloatArray:
    """Half the difference of a function between +step and -step, for each row of `steps`; shape (n, steps)."""
    columns = [0.5 * (function(step) - function(-step)) for step in steps]
    return np.stack(columns, axis=1)
