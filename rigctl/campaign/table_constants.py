"""Numbers in a table's baseline that are known from elsewhere, with uncertainty, degrees of freedom, correlations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rigctl.core.numbers import MAGNITUDE_MAX

if TYPE_CHECKING:
    from rigctl.core.arrays import FloatArray

_ROUNDING = 1e-9
"""Of correlation coefficients, as they are written down."""


@dataclass(frozen=True)
class TableConstant:
    """One constant: its `value`, the standard uncertainty `u` and the degrees of freedom `dof` behind that.

    `correlation` has its correlation coefficients with other constants by their names; each pair is stated once.
    """

    value: float
    u: float = 0.0
    dof: float = math.inf
    correlation: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """What is stated, as recording.toml and a store keep it."""
        known: dict[str, Any] = {"value": self.value}
        if self.u:
            known["u"] = self.u
        if math.isfinite(self.dof):
            known["dof"] = self.dof
        return {**known, "correlation": dict(self.correlation)} if self.correlation else known


TableConstants = Mapping[str, TableConstant]


def correlation_matrix(constants: TableConstants) -> FloatArray:
    """Correlation coefficients of all constants in their order, (k, k)."""
    import numpy as np

    places = {name: place for place, name in enumerate(constants)}
    matrix = np.eye(len(places))
    for name, other, coefficient in _pairs(constants):
        matrix[places[name], places[other]] = matrix[places[other], places[name]] = coefficient
    return matrix


def flaw_of_constants(constants: TableConstants) -> tuple[tuple[str, ...], str] | None:
    """Which key cannot be (name of the constant, then what of it), why, and the mend; None where all can."""
    for name, constant in constants.items():
        # NaN fails these too.
        if not abs(constant.value) <= MAGNITUDE_MAX:
            return (name, "value"), "is no quantity; write a number"
        if not 0.0 <= constant.u <= MAGNITUDE_MAX:
            return (name, "u"), "is no standard uncertainty; write a positive one, or leave it out"
        if not constant.dof >= 1.0:
            return (name, "dof"), "is less than 1; write the degrees of freedom behind u, or leave it out"
    return _flaw_of_correlations(constants)


def _flaw_of_correlations(constants: TableConstants) -> tuple[tuple[str, ...], str] | None:
    import numpy as np

    for name, other, coefficient in _pairs(constants):
        keys = (name, "correlation", other)
        if other not in constants or other == name:
            return keys, "is with no other constant; name one of [table.constants]"
        if not abs(coefficient) <= 1.0:
            return keys, "is no correlation coefficient; write a number from -1 to 1"
        if abs(constants[other].correlation.get(name, coefficient) - coefficient) > _ROUNDING:
            return keys, f"is another number for {other} with {name}; state it once"
    if constants and np.linalg.eigvalsh(correlation_matrix(constants))[0] < -_ROUNDING * len(constants):
        return (), "have correlations that no quantities can have together; mend one of them"
    return None


def _pairs(constants: TableConstants) -> Iterator[tuple[str, str, float]]:
    for name, constant in constants.items():
        for other, coefficient in constant.correlation.items():
            yield name, other, coefficient
