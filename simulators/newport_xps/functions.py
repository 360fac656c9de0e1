"""What a function of the controller is: a signature, an object it acts on, and what it does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from simulators.newport_xps.grammar import Signature, format_number
from simulators.newport_xps.group import Done, Group
from simulators.newport_xps.positioner import Positioner

Object = TypeVar("Object")


@dataclass(frozen=True)
class Call:
    """One call: its inputs, its time, and the socket it came from."""

    numbers: tuple[float, ...]
    words: tuple[str, ...]
    now_s: float
    client: object
    finish: Done
    """Answers a call that blocks its socket."""


@dataclass(frozen=True)
class Function(Generic[Object]):
    """A function that acts on an object: the controller, a selection of a group, a positioner.

    `run` returns the output values. A function that `blocks` its socket answers through `Call.finish`.
    """

    signature: Signature
    run: Callable[[Call, Object], Sequence[str] | None]
    blocks: bool = False


@dataclass(frozen=True)
class Selection:
    """A group, and those of its positioners a call is about."""

    group: Group
    positioners: tuple[Positioner, ...]

    def by_name(self, values: Sequence[float]) -> dict[str, float]:
        """Pair one value with each positioner."""
        return {p.name: value for p, value in zip(self.positioners, values, strict=True)}


def numbers(*values: float) -> Sequence[str]:
    """Output values of a function that returns numbers."""
    return tuple(map(format_number, values))
