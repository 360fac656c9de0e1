"""The satellite in orbit as its ground segment finds it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simulators.benches import BareBench, WorldDeclaration, no_such_action
from simulators.clock import SimulationClock
from simulators.wiring import TriggerLine
from simulators.worlds.satellite.settings import SatelliteSettings
from simulators.worlds.satellite.world import Satellite


class SatelliteBench(BareBench):
    """A satellite in orbit: nothing is wired to it, its ground segment talks with it."""

    def __init__(self, nature: SatelliteSettings, clock: SimulationClock, pace: TriggerLine) -> None:
        del pace
        self.nature = nature
        self.world = Satellite(nature, clock)
        self.announce_run = self.world.announce_run

    def operate(self, action: Mapping[str, Any]) -> float:
        """No hand reaches a satellite; which one of the ensemble is flown can be chosen."""
        match dict(action):
            case {"draw": int(draw)} if draw >= 0:
                return self.world.choose(draw)
            case _:
                raise no_such_action(action, "draw")


WORLD = WorldDeclaration("drag-free-satellite", SatelliteSettings, SatelliteBench)
