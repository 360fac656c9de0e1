"""The sensing-axis bench as its instruments find it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from simulators.benches import WorldDeclaration
from simulators.clock import SimulationClock
from simulators.motion import MotionAxis
from simulators.wiring import Signal, TriggerLine, VoltageLine
from simulators.worlds.accelerometer_bench import AccelerometerBench
from simulators.worlds.bench_settings import BenchSettings


class SensingAxisBench:
    """The accelerometer package on turntable and linear stage."""

    def __init__(self, nature: BenchSettings, clock: SimulationClock, pace: TriggerLine) -> None:
        self.nature = nature
        self.axes: Mapping[str, MotionAxis] = {"rotation": MotionAxis(), "linear": MotionAxis()}
        self.inputs: Mapping[str, VoltageLine] = {}
        self.sensors: Collection[str] = nature.sensors
        self.heads: Collection[str] = nature.lasers
        self.world = AccelerometerBench(nature, clock, self.axes["rotation"], self.axes["linear"], pace)
        self.displacement_mm = self.world.displacement_mm
        self.temperature_c = self.world.temperature_c
        self.announce_run = self.world.announce_run
        self.stands = self.world.stands

    @property
    def seed(self) -> int:
        """What all its randomness follows from."""
        return self.nature.seed

    def volts(self, _: str) -> Signal:
        """There is one sensor at a time."""
        return self.world.accelerometer_v

    def operate(self, action: Mapping[str, Any]) -> float:
        """Mount, level, heat."""
        match dict(action):
            case {"remount": {"axis": str(axis), "configuration": str(configuration), "mounting": int(number)}}:
                return self.world.remount(axis, configuration, number)
            case {"level": True}:
                return self.world.level()
            case {"level": {"at_s": int() | float() as at_s, "angle_deg": int() | float() as angle_deg}}:
                return self.world.level_as(at_s, angle_deg)
            case {"room": {"temperature_c": int() | float() as temperature_c, "at_s": int() | float() as at_s}}:
                return self.world.bring_room_to(temperature_c, at_s)
            case {"room": {"temperature_c": int() | float() as temperature_c}}:
                return self.world.bring_room_to(temperature_c)
            case _:
                raise ValueError(f"no action {dict(action)}; there are remount, level, room, run, stands and clock")


WORLD = WorldDeclaration("sensing-axis", BenchSettings, SensingAxisBench)
