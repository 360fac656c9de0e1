"""Models whose fit may have several minima, and where those may lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from rigctl.core.arrays import FloatArray


@dataclass(frozen=True)
class OtherMinimum:
    """Where else a fit may end: parameters' `values` by place. `of` is the place of the one it is about, `likelier`
    says that what is known beside the data speaks for it."""

    values: Mapping[int, float]
    of: int
    likelier: bool


@runtime_checkable
class HasOtherMinima(Protocol):
    """A model with effects whose fit may have several minima."""

    def elsewhere(self, values: FloatArray) -> Sequence[OtherMinimum]:
        """Where others may lie, seen from a fit's end."""
