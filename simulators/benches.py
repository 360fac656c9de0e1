"""The benches there are: which world, and what its instruments are wired to."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, Protocol

import numpy as np

from simulators.clock import SimulationClock
from simulators.motion import MotionAxis
from simulators.wiring import LINE_HISTORY_S, FloatArray, Signal, TriggerLine, VoltageLine
from simulators.worlds.accelerometer_bench import AccelerometerBench
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.platform_pendulum import INPUTS
from simulators.worlds.platform_settings import PlatformSettings
from simulators.worlds.rotating_platform import RotatingPlatform
from simulators.worlds.satellite.settings import SatelliteSettings
from simulators.worlds.satellite.world import Satellite


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


class PlatformBench:
    """Two accelerometers on a rotating platform on a servo-controlled pendulum."""

    def __init__(self, nature: PlatformSettings, clock: SimulationClock, pace: TriggerLine) -> None:
        self.nature = nature
        self.axes: Mapping[str, MotionAxis] = {"rotation": MotionAxis(history_s=LINE_HISTORY_S)}
        self.inputs: Mapping[str, VoltageLine] = {name: VoltageLine() for name in INPUTS}
        self.sensors: Collection[str] = ()
        self.heads: Collection[str] = ()
        self.world = RotatingPlatform(nature, clock, self.axes["rotation"], pace, self.inputs)
        self.volts = self.world.chain_v
        self.temperature_c = self.world.temperature_c
        self.announce_run = self.world.announce_run
        self.stands = self.world.stands

    @property
    def seed(self) -> int:
        """What all its randomness follows from."""
        return self.nature.seed

    def displacement_mm(self, head: str) -> Signal:
        """There are none."""
        raise ValueError(f"no laser head '{head}' at the platform")

    def operate(self, action: Mapping[str, Any]) -> float:
        """Flip, heat."""
        match dict(action):
            case {"flip": int(sign)} if not isinstance(sign, bool):
                return self.world.flip(sign)
            case {"room": {"temperature_c": int() | float() as temperature_c}}:
                return self.world.bring_room_to(temperature_c)
            case _:
                raise _no_such(action, "flip, room")


class SatelliteBench:
    """A satellite in orbit: nothing is wired to it, its ground segment talks with it."""

    def __init__(self, nature: SatelliteSettings, clock: SimulationClock, pace: TriggerLine) -> None:
        del pace
        self.nature = nature
        self.axes: Mapping[str, MotionAxis] = {}
        self.inputs: Mapping[str, VoltageLine] = {}
        self.sensors: Collection[str] = ()
        self.heads: Collection[str] = ()
        self.world = Satellite(nature, clock)
        self.announce_run = self.world.announce_run

    @property
    def seed(self) -> int:
        """What all its randomness follows from."""
        return self.nature.seed

    def volts(self, column: str) -> Signal:
        """There are none."""
        raise ValueError(f"no cable leads to a satellite; nothing to measure '{column}' on")

    def displacement_mm(self, head: str) -> Signal:
        """There are none."""
        raise ValueError(f"no laser head '{head}' looks at a satellite")

    def temperature_c(self, times_s: FloatArray) -> FloatArray:
        """What a thermometer would feel in a room that has none."""
        return np.full_like(times_s, np.nan)

    def stands(self) -> list[dict[str, Any]]:
        """No hand reaches it."""
        return []

    def operate(self, action: Mapping[str, Any]) -> float:
        """No hand reaches it; but there are many."""
        match dict(action):
            case {"draw": int(draw)} if draw >= 0:
                return self.world.choose(draw)
            case _:
                raise _no_such(action, "draw")


BENCHES: Mapping[str, tuple[type[Any], Callable[[Any, SimulationClock, TriggerLine], Bench]]] = {
    "sensing-axis": (BenchSettings, SensingAxisBench),
    "rotating-platform": (PlatformSettings, PlatformBench),
    "drag-free-satellite": (SatelliteSettings, SatelliteBench),
}
"""Settings and bench by `[world] kind`."""


def _no_such(action: Mapping[str, Any], there_are: str) -> ValueError:
    return ValueError(f"no such action: {dict(action)}; there are {there_are}, run, stands and clock")
