"""What a simulated world is to its instruments, and which worlds there are: entry points, as drivers are."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from pydantic import BaseModel, ConfigDict

from rigctl.core.arrays import FloatArray
from rigctl.core.entry_points import Registry
from simulators.clock import SimulationClock
from simulators.motion import MotionAxis
from simulators.wiring import Signal, TriggerLine, VoltageLine

WORLD_CONTRACT = 1
"""The version of what is between a rig and a world: `WorldDeclaration`, `Bench`."""


class Bench(Protocol):
    """A world with its axes and wires, as instruments find it."""

    axes: Mapping[str, MotionAxis]
    """What moves in it, by role."""
    inputs: Mapping[str, VoltageLine]
    """Where voltages can be put, by the column they fill."""
    sensors: Collection[str]
    heads: Collection[str]
    nature: Any
    """Its settings."""
    world: Any

    @property
    def seed(self) -> int:
        """What all its randomness follows from."""
        ...

    def volts(self, column: str) -> Signal:
        """What a voltmeter for this column is connected to; ValueError when there is nothing."""
        ...

    def displacement_mm(self, head: str) -> Signal:
        """What a laser head sees."""
        ...

    def temperature_c(self, times_s: FloatArray) -> FloatArray:
        """What a thermometer feels."""
        ...

    def announce_run(self, number: int) -> None:
        """A run begins, the key of its randomness."""
        ...

    def operate(self, action: Mapping[str, Any]) -> float:
        """Do what an operator's hands do; returns the rig time when it is done. ValueError for another action."""
        ...

    def stands(self) -> list[dict[str, Any]]:
        """What hands have made of it that still is so, as the actions that would make it so again."""
        ...


class BareBench:
    """A bench with no instruments yet and no laser head; `nature` has a seed."""

    axes: Mapping[str, MotionAxis] = {}
    inputs: Mapping[str, VoltageLine] = {}
    sensors: Collection[str] = ()
    heads: Collection[str] = ()
    nature: Any

    @property
    def seed(self) -> int:
        """What all its randomness follows from."""
        return int(self.nature.seed)

    def displacement_mm(self, head: str) -> Signal:
        """There are none."""
        raise ValueError(f"no laser head '{head}' looks here")


class WorldTable(BaseModel):
    """Settings of a world: a table of a rig file."""

    model_config = ConfigDict(frozen=True, extra="forbid")


@dataclass(frozen=True)
class WorldDeclaration:
    """A world as the rig file's `[world] kind` names it: its settings, and the bench they are made into."""

    kind: str
    settings: type[BaseModel]
    build: Callable[[Any, SimulationClock, TriggerLine], Bench]
    contract: int = WORLD_CONTRACT


WORLDS = Registry("rigctl.worlds", WorldDeclaration, WORLD_CONTRACT, lambda world: world.kind)


def no_such_action(action: Mapping[str, Any], there_are: str) -> ValueError:
    """An operator's action that this bench does not have."""
    return ValueError(f"no such action: {dict(action)}; there are {there_are}, run, stands and clock")
