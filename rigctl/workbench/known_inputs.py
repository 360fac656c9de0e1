"""Models with numbers that are known from elsewhere: they are not fitted, and what is fitted depends on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from rigctl.core.arrays import FloatArray
from rigctl.workbench.study import Model


@dataclass(frozen=True)
class KnownInputs:
    """Input quantities (GUM 4.1) that may be correlated with each other and are not with those of another group.

    `values` (k,) and their `covariance` (k, k), with `dof` degrees of freedom behind it.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    dof: float


@runtime_checkable
class HasKnownInputs(Protocol):
    """A model with such inputs."""

    @property
    def known_inputs(self) -> Sequence[KnownInputs]:
        """Those that are uncertain."""

    def with_inputs(self, values: Mapping[str, float]) -> Model:
        """The same model with other values of some inputs, by name."""
