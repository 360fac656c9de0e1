"""The world of the sensing-axis rig: stages, package, sensor, cube, lasers and the operator's hands."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from functools import partial
from typing import Any, get_args

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from simulators.clock import SimulationClock
from simulators.keyed_random import normal_at_times
from simulators.motion import MotionAxis
from simulators.wiring import Signal, Train, TriggerLine
from simulators.worlds import mounting as mountings
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.bench_train import BenchTrain
from simulators.worlds.laser_head import LaserHead
from simulators.worlds.mounting import Mounting
from simulators.worlds.rotations import Configuration, about_z
from simulators.worlds.sensor import Electronics, bias_v
from simulators.worlds.specific_force import vertical_lab
from simulators.worlds.stages import Stages
from simulators.worlds.temperature import Room

_SINGLE_PERIOD_S = 0.01
LEVELLING_DIGITS = 4
"""Of the angle in degrees at which somebody levels: what he came to follows from what the stage said to him."""


class AccelerometerBench:
    """Nature on the bench, at any rig time from the recent past to the near future.

    `rotation` [deg] is what the rotation stage's encoder believes, `linear` [mm] where the carriage is. Until
    something is mounted the accelerometer gives 0 V and the lasers see nothing (NaN). Nature does not
    depend on what was asked before: randomness is keyed by seed, mounting and announced run.
    """

    def __init__(
        self,
        settings: BenchSettings,
        clock: SimulationClock,
        rotation: MotionAxis,
        linear: MotionAxis,
        trigger: TriggerLine,
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._trigger = trigger
        self._stages = Stages(settings, rotation, linear)
        self._room = Room(settings.temperature)
        self._mounting: Mounting | None = None
        self._levelled: tuple[float, float] | None = None
        self._room_brought: tuple[float, float] | None = None
        self._mounted: dict[tuple[str, str, int], Mounting] = {}
        self._run = 0
        self._since_s = -math.inf
        self._trains_of_run = 0
        self._noted: Train | None = None
        self._trains: deque[BenchTrain] = deque(maxlen=4)

    def remount(self, axis: str, configuration: str, mounting: int) -> float:
        """Put the package in place, unlevelled; returns the rig time at which the hands are off.

        Raises ValueError for an axis or a configuration the package does not have.
        """
        if axis not in self._settings.sensors:
            raise ValueError(f"no sensor '{axis}' in the package; it has: {', '.join(self._settings.sensors)}")
        if configuration not in get_args(Configuration):
            raise ValueError(f"no configuration '{configuration}'; use: {', '.join(get_args(Configuration))}")
        # For the type checker, which does not follow `get_args`.
        known: Configuration = "pendulum" if configuration == "pendulum" else "flag"
        self._put(mountings.mount(self._settings, axis, known, mounting))
        self._levelled = None
        return self._clock.now_s() + self._settings.remount_s

    def level(self) -> float:
        """Turn the package about x_T until the DC level is well below 1 V; returns when that is done.

        Raises ValueError when nothing is mounted.
        """
        if self._mounting is None:
            raise ValueError("nothing to level: mount the package first")
        done_s = self._clock.now_s() + self._settings.level_s
        self._level(self._mounting, done_s, self._stages.angle_deg(done_s))
        return done_s

    def level_as(self, at_s: float, angle_deg: float) -> float:
        """As `level`, but to what it came to at rig time `at_s` with the turntable at `angle_deg`.

        So a mounting that outlived its world's process is as it was: what has drifted since is not levelled away.
        """
        if self._mounting is None:
            raise ValueError("nothing to level: mount the package first")
        self._level(self._mounting, at_s, angle_deg)
        return self._clock.now_s() + self._settings.level_s

    def _level(self, mounting: Mounting, at_s: float, angle_deg: float) -> None:
        angle_rad = math.radians(round(angle_deg, LEVELLING_DIGITS))
        # The hand levels by the output, which has bias and drift in it.
        wanted_m_s2 = Electronics(self._settings, mounting, self._room).felt_m_s2(mounting.level_v, at_s)
        vertical_table = about_z(-angle_rad) @ vertical_lab(self._settings)
        self._put(mountings.levelled(mounting, vertical_table, wanted_m_s2 / self._settings.g_m_s2))
        self._levelled = at_s, angle_deg

    def bring_room_to(self, temperature_c: float, at_s: float | None = None) -> float:
        """Set the air conditioning [degC], now or at `at_s`; returns when room and bench have followed."""
        sets_out_s = self._clock.now_s() if at_s is None else at_s
        self._room_brought = temperature_c, sets_out_s
        return self._room.bring_to(temperature_c, sets_out_s)

    def stands(self) -> list[dict[str, Any]]:
        """What hands have made of it that still is so, as the actions that would make it so again."""
        made: list[dict[str, Any]] = []
        if self._room_brought is not None:
            made.append({"room": dict(zip(("temperature_c", "at_s"), self._room_brought, strict=True))})
        if self._mounting is not None:
            axis, configuration, number = self._mounting.key
            made.append({"remount": {"axis": axis, "configuration": configuration, "mounting": number}})
        if self._levelled is not None:
            made.append({"level": dict(zip(("at_s", "angle_deg"), self._levelled, strict=True))})
        return made

    def announce_run(self, number: int) -> None:
        """The next trains belong to this run; what nature did before is forgotten."""
        # First: a train that began before belongs to the run before.
        self._note_train()
        self._since_s = self._clock.now_s()
        self._run = number
        self._trains_of_run = 0

    def accelerometer_v(self, times_s: FloatArray) -> FloatArray:
        """The sensor's output [V], held at its range's ends beyond them; 0 before anything is mounted."""
        times_s = np.asarray(times_s, dtype=np.float64)
        volts = np.zeros(times_s.shape)
        for train, chosen in self._trains_at(times_s):
            volts[chosen] = train.sensor.output_v(times_s[chosen])
        return volts

    def displacement_mm(self, head: str) -> Signal:
        """What one laser head would read [mm]; raises ValueError for a head that is not there."""
        if head not in self._settings.lasers:
            raise ValueError(f"no laser head '{head}'; there are: {', '.join(self._settings.lasers)}")
        return partial(self._displacement_mm, head)

    def temperature_c(self, times_s: FloatArray) -> FloatArray:
        """The temperature of the bench [degC]."""
        return self._room.temperature_c(np.asarray(times_s, dtype=np.float64))

    def truth(self) -> dict[str, object]:
        """Everything nature has drawn so far, as plain values."""
        return {
            "seed": self._settings.seed,
            "bias_v": {axis: bias_v(self._settings, axis) for axis in self._settings.sensors},
            "mountings": [mountings.truth(self._settings, m) for m in self._mounted.values()],
        }

    def _put(self, mounting: Mounting) -> None:
        # First: a train that began before is with the mounting before.
        self._note_train()
        self._mounting = mounting
        self._mounted[mounting.key] = mounting

    def _displacement_mm(self, head: str, times_s: FloatArray) -> FloatArray:
        times_s = np.asarray(times_s, dtype=np.float64)
        readings = np.full(times_s.shape, np.nan)
        left = np.ones(times_s.shape, dtype=np.bool_)
        for train, chosen in self._trains_over(times_s):
            readings[chosen] = train.displacement_mm(head, times_s[chosen])
            left &= ~chosen
        if self._mounting is not None and left.any():
            # A controller that stores on its own clock reads thousands of times outside of any train.
            key = self._key(self._mounting, "single", 0)
            outside = LaserHead(self._settings, self._stages, self._mounting, head).reading_m(times_s[left])
            noise = normal_at_times(times_s[left], *key, "laser", head)
            readings[left] = 1e3 * outside + 1e-3 * self._settings.lasers[head].noise_um * noise
        return readings

    def _trains_over(self, times_s: FloatArray) -> Iterator[tuple[BenchTrain, BoolArray]]:
        """The trains that times fall in, each with a mask of its times."""
        self._note_train()
        left = np.ones(times_s.shape, dtype=np.bool_)
        # Where two trains claim a time, as at the end of one that was cut, the later one has it.
        for train in reversed(self._trains):
            chosen = left & train.covers(times_s)
            if chosen.any():
                yield train, chosen
            left &= ~chosen
            if not left.any():
                return

    def _trains_at(self, times_s: FloatArray) -> Iterator[tuple[BenchTrain, BoolArray]]:
        """As `_trains_over`; a reading outside is its own train."""
        left = np.ones(times_s.shape, dtype=np.bool_)
        for train, chosen in self._trains_over(times_s):
            yield train, chosen
            left &= ~chosen
        if self._mounting is None:
            return
        for at_s in np.unique(times_s[left]):
            # By time, in microseconds: asked again it is the same reading.
            key = self._key(self._mounting, "single", round(1e6 * at_s))
            single = Train(float(at_s), _SINGLE_PERIOD_S, 1)
            yield (
                BenchTrain(self._settings, self._stages, self._room, self._mounting, single, key, self._since_s),
                left & (times_s == at_s),
            )

    def _note_train(self) -> None:
        train = self._trigger.train
        # By identity: a train that was cut is still the same one.
        if train is None or train is self._noted:
            return
        self._noted = train
        if self._mounting is not None:
            key = self._key(self._mounting, "train", self._trains_of_run)
            self._trains.append(
                BenchTrain(self._settings, self._stages, self._room, self._mounting, train, key, self._since_s)
            )
        self._trains_of_run += 1

    def _key(self, mounting: Mounting, kind: str, number: int) -> tuple[int | str, ...]:
        return self._settings.seed, *mounting.key, self._run, kind, number
