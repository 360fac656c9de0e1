"""The rotating platform as its instruments find it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simulators.benches import BareBench, WorldDeclaration, no_such_action
from simulators.clock import SimulationClock
from simulators.motion import MotionAxis
from simulators.wiring import LINE_HISTORY_S, TriggerLine, VoltageLine
from simulators.worlds.platform_pendulum import INPUTS
from simulators.worlds.platform_settings import PlatformSettings
from simulators.worlds.rotating_platform import RotatingPlatform


class PlatformBench(BareBench):
    """Two accelerometers on a rotating platform on a servo-controlled pendulum."""

    def __init__(self, nature: PlatformSettings, clock: SimulationClock, pace: TriggerLine) -> None:
        self.nature = nature
        self.axes: Mapping[str, MotionAxis] = {"rotation": MotionAxis(history_s=LINE_HISTORY_S)}
        self.inputs: Mapping[str, VoltageLine] = {name: VoltageLine() for name in INPUTS}
        self.world = RotatingPlatform(nature, clock, self.axes["rotation"], pace, self.inputs)
        self.volts = self.world.chain_v
        self.temperature_c = self.world.temperature_c
        self.announce_run = self.world.announce_run
        self.stands = self.world.stands

    def operate(self, action: Mapping[str, Any]) -> float:
        """Flip, heat."""
        match dict(action):
            case {"flip": int(sign)} if not isinstance(sign, bool):
                return self.world.flip(sign)
            case {"room": {"temperature_c": int() | float() as temperature_c}}:
                return self.world.bring_room_to(temperature_c)
            case _:
                raise no_such_action(action, "flip, room")


WORLD = WorldDeclaration("rotating-platform", PlatformSettings, PlatformBench)
