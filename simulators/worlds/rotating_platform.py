"""The rotating-platform bench: platform, pendulum and two measuring chains as functions of rig time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from simulators.clock import SimulationClock
from simulators.motion import MotionAxis
from simulators.wiring import Signal, Train, TriggerLine, VoltageLine
from simulators.worlds.platform_chain import CHAINS, ChainRecord
from simulators.worlds.platform_pendulum import Pendulum
from simulators.worlds.platform_settings import PlatformSettings
from simulators.worlds.platform_turntable import Turntable
from simulators.worlds.temperature import Room

SINGLE_PERIOD_S = 0.01
LONGEST_GAP_S = 3600.0
"""Trains of one run that follow each other within this are one record: its noise goes on through the gap."""


@dataclass
class Record:
    """A stretch of nature: its first edge, its period, its key, and the chains that were asked for."""

    first_s: float
    period_s: float
    last_s: float
    key: tuple[int | str, ...]
    chains: dict[str, ChainRecord] = field(default_factory=dict)

    def covers(self, times_s: FloatArray) -> BoolArray:
        """Which times are at or near one of its edges."""
        half_s = 0.5 * self.period_s
        return (times_s >= self.first_s - half_s) & (times_s < self.last_s + half_s)


class RotatingPlatform:
    """Nature on the platform, at any rig time from the recent past to now.

    `rotation` [deg] is what the platform's encoder believes, `inputs` the voltages at the pendulum's offset inputs.
    Signals are asked in order of time, column by column. What nature does in a run depends on the seed and on the
    run's number alone.
    """

    def __init__(
        self,
        settings: PlatformSettings,
        clock: SimulationClock,
        rotation: MotionAxis,
        trigger: TriggerLine,
        inputs: Mapping[str, VoltageLine],
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._rotation = rotation
        self._trigger = trigger
        self._pendulum = Pendulum(settings, inputs)
        self._room = Room(settings.temperature)
        self._flipped = 0
        self._room_c: float | None = None
        self._run = 0
        self._since_s = -math.inf
        self._records_of_run = 0
        self._noted: Train | None = None
        self._records: list[Record] = []

    def announce_run(self, number: int) -> None:
        """The next trains belong to this run; what nature did before is forgotten."""
        # First: a train that began before belongs to the run before.
        self._note_train()
        self._since_s = self._clock.now_s()
        self._run = number
        self._records_of_run = 0

    def flip(self, sign: int) -> float:
        """Turn both sensors to feel +g or -g, amplifiers bypassed, or back (0); returns when the hands are off."""
        if sign not in (-1, 0, 1):
            raise ValueError(f"a flip is +1, -1, or 0 for back on the platform, not {sign}")
        self._flipped = sign
        return self._clock.now_s() + self._settings.flip_s

    def bring_room_to(self, temperature_c: float) -> float:
        """Set the air conditioning [degC]; returns when room and bench have followed."""
        self._room_c = temperature_c
        return self._room.bring_to(temperature_c, self._clock.now_s())

    def stands(self) -> list[dict[str, Any]]:
        """What hands have made of it that still is so, as the actions that would make it so again."""
        room = [] if self._room_c is None else [{"room": {"temperature_c": self._room_c}}]
        return room + ([{"flip": self._flipped}] if self._flipped else [])

    def chain_v(self, column: str) -> Signal:
        """The output of a chain [V]; raises ValueError for a column that no chain fills."""
        if column not in CHAINS:
            raise ValueError(f"no chain gives '{column}'; there are: {', '.join(CHAINS)}")
        return partial(self._chain_v, column)

    def temperature_c(self, times_s: FloatArray) -> FloatArray:
        """The temperature of the bench [degC]."""
        return self._room.temperature_c(np.asarray(times_s, dtype=np.float64))

    def _chain_v(self, column: str, times_s: FloatArray) -> FloatArray:
        times_s = np.asarray(times_s, dtype=np.float64)
        self._note_train()
        volts = np.empty(times_s.shape)
        left = np.ones(times_s.shape, dtype=np.bool_)
        # Where two records claim a time, the later one has it.
        for record in reversed(self._records):
            chosen = left & record.covers(times_s)
            if chosen.any():
                volts[chosen] = self._chain(record, column).output_v(times_s[chosen], self._flipped)
                left &= ~chosen
        for at_s in np.unique(times_s[left]):
            # By time, in microseconds: asked again it is the same reading.
            key = (self._settings.seed, self._run, "single", round(1e6 * at_s))
            single = Record(float(at_s), SINGLE_PERIOD_S, float(at_s), key)
            volts[left & (times_s == at_s)] = self._chain(single, column).output_v(np.array([at_s]), self._flipped)
        return volts

    def _chain(self, record: Record, column: str) -> ChainRecord:
        if column not in record.chains:
            turntable = Turntable(
                self._settings, self._rotation, CHAINS[column], record.first_s, record.key, self._since_s
            )
            record.chains[column] = ChainRecord(
                self._settings,
                turntable,
                self._pendulum,
                self._room,
                column,
                record.first_s,
                record.period_s,
                record.key,
            )
        return record.chains[column]

    def _note_train(self) -> None:
        train = self._trigger.train
        if train is None:
            return
        end_s = train.first_s + (train.count - 1) * train.period_s
        if train is self._noted:
            self._records[-1].last_s = max(self._records[-1].last_s, end_s)
            return
        self._noted = train
        latest = self._records[-1] if self._records and self._records_of_run else None
        goes_on = latest is not None and latest.period_s == train.period_s
        if latest is not None and goes_on and train.first_s - latest.last_s < LONGEST_GAP_S:
            latest.last_s = end_s
            return
        key = (self._settings.seed, self._run, "record", self._records_of_run)
        # The one before is kept as well: its last readings may still be asked for.
        self._records = [*self._records[-1:], Record(train.first_s, train.period_s, end_s, key)]
        self._records_of_run += 1
