"""The satellite in orbit as its ground segment finds it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.benches import BareBench, WorldDeclaration, no_such_action
from simulators.clock import SimulationClock
from simulators.wiring import Signal, TriggerLine
from simulators.worlds.satellite.settings import SatelliteSettings
from simulators.worlds.satellite.world import Satellite


class SatelliteBench(BareBench):
    """A satellite in orbit: nothing is wired to it, its ground segment talks with it."""

    def __init__(self, nature: SatelliteSettings, clock: SimulationClock, pace: TriggerLine) -> None:
        del pace
        self.nature = nature
        self.world = Satellite(nature, clock)
        self.announce_run = self.world.announce_run

    def volts(self, column: str) -> Signal:
        """There are none."""
        raise ValueError(f"no cable leads to a satellite; nothing to measure '{column}' on")

    def temperature_c(self, times_s: FloatArray) -> FloatArray:
        """What a thermometer would feel in a room that has none."""
        return np.full_like(times_s, np.nan)

    def stands(self) -> list[dict[str, Any]]:
        """No hand reaches a satellite."""
        return []

    def operate(self, action: Mapping[str, Any]) -> float:
        """No hand reaches a satellite; which one of the ensemble is flown can be chosen."""
        match dict(action):
            case {"draw": int(draw)} if draw >= 0:
                return self.world.choose(draw)
            case _:
                raise no_such_action(action, "draw")


WORLD = WorldDeclaration("drag-free-satellite", SatelliteSettings, SatelliteBench)
