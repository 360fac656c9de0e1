"""The response of a table as a function of parameters: a baseline expression, and what terms add to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.least_squares import FitResult, Parameter
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.model.descent import descend
from rigctl.experiments.table.model.pieces import Piece
from rigctl.experiments.table.observe.readings import Readings
from rigctl.workbench.study import Observations, Term


@dataclass(frozen=True)
class TableModel:
    """A `rigctl.workbench.study.Model`; `starts` are values of all its parameters, (m,)."""

    observations: Observations
    readings: Readings
    pieces: tuple[Piece, ...]
    starts: FloatArray

    @property
    def terms(self) -> tuple[Term, ...]:
        """What the baseline was extended with, choices filled in."""
        return tuple(piece.term for piece in self.pieces)

    @property
    def parameters(self) -> Sequence[Parameter]:
        """Of the baseline, named as its expression does, and then of the terms."""
        baseline_values, parts = self._split(self.starts)
        names = self.readings.expression.parameters
        baseline = [Parameter(name, float(start)) for name, start in zip(names, baseline_values, strict=True)]
        return baseline + [
            each for piece, values in zip(self.pieces, parts, strict=True) for each in piece.parameters(values)
        ]

    @property
    def units(self) -> Sequence[str]:
        """Of each parameter; the baseline's are not known: ""."""
        return ["" for _ in self.readings.expression.parameters] + [
            unit for piece in self.pieces for unit in piece.units
        ]

    @property
    def owners(self) -> Sequence[str]:
        """The effect each parameter belongs to; "" for the baseline."""
        return ["" for _ in self.readings.expression.parameters] + [
            piece.term.effect for piece in self.pieces for _ in piece.units
        ]

    @property
    def local(self) -> Sequence[bool]:
        """A table's parameters hold for all of it."""
        return [False] * len(self.owners)

    def predict(self, values: FloatArray) -> FloatArray:
        """The response, shape (n,); NaN or infinite where undefined."""
        baseline_values, parts = self._split(values)
        signal, _ = self.readings.baseline(baseline_values)
        added = (piece.added(part, signal) for piece, part in zip(self.pieces, parts, strict=True))
        return np.asarray(sum(added, signal))

    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        baseline_values, parts = self._split(values)
        signal, slopes = self.readings.baseline(baseline_values)
        baseline_slopes = slopes + sum(
            (piece.passed_on(part, signal, slopes) for piece, part in zip(self.pieces, parts, strict=True)),
            np.zeros_like(slopes),
        )
        piece_slopes = [piece.slopes(part, signal) for piece, part in zip(self.pieces, parts, strict=True)]
        return np.concatenate([baseline_slopes, *piece_slopes], axis=1)

    def signal(self, values: FloatArray) -> FloatArray:
        """What the baseline alone predicts, shape (n,)."""
        return self.readings.baseline(self._split(values)[0])[0]

    def _split(self, values: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
        sizes = [len(self.readings.expression.parameters), *(len(piece.units) for piece in self.pieces)]
        baseline_values, *parts = np.split(np.asarray(values, dtype=np.float64), np.cumsum(sizes)[:-1])
        return baseline_values, parts


def fitted(model: TableModel) -> FitResult | None:
    """The model fitted with the readings' own weights; None when its start is undefined or the fit is singular."""
    given = model.observations
    return descend(
        lambda values: (given.value - model.predict(values)) / given.sigma,
        lambda values: -model.jacobian(values) / given.sigma[:, None],
        model.parameters,
    )
