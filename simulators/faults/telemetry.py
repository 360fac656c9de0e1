"""Faults of a satellite and of the way its telemetry takes: there is no wire, packets of rows are counted."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import LinkLost
from simulators.clock import SimulationClock
from simulators.faults.line import Occasions
from simulators.faults.plan import FaultPlan
from simulators.faults.signals import FaultySensor
from simulators.faults.when import Occasion
from simulators.measured import Tap

FULL_SCALE_M_S2 = 1e-6
"""What a saturated accelerometer reports."""


class Telemetry(Protocol):
    """What a ground segment has of its satellite."""

    identity: Mapping[str, str]
    columns: tuple[str, ...]

    @property
    def sample_period_s(self) -> float:
        """Between two rows."""
        ...

    def begin(self, command: Mapping[str, Any]) -> float:
        """A session; the rig time its rows count from."""
        ...

    def fetch(self) -> FloatArray:
        """The rows that came down since the last call."""
        ...

    def end(self) -> None:
        """Stop a session."""
        ...


class FaultyTelemetry:
    """A satellite that suffers `plan`; what its sensors gave goes to `tap` before anything is lost on the way."""

    def __init__(self, satellite: Telemetry, plan: FaultPlan, clock: SimulationClock, tap: Tap) -> None:
        self.identity, self.columns = satellite.identity, satellite.columns
        self._satellite = satellite
        self._plan = plan
        self._clock = clock
        self._tap = tap
        self._packets = Occasions(clock)
        self._under_way: deque[tuple[float, FloatArray]] = deque()
        self._began_s = 0.0
        self._sensors = {
            place: FaultySensor(plan, tap, FULL_SCALE_M_S2)
            for place, name in enumerate(self.columns)
            if name.startswith("m")
        }

    @property
    def sample_period_s(self) -> float:
        """Between two rows."""
        return self._satellite.sample_period_s

    def begin(self, command: Mapping[str, Any]) -> float:
        """A session; what is still under way of the one before is lost."""
        self._tap.begin()
        self._under_way.clear()
        self._began_s = self._satellite.begin(command)
        return self._began_s

    def end(self) -> None:
        """Stop a session."""
        self._satellite.end()

    def fetch(self) -> FloatArray:
        """The rows that came down since the last call; `LinkLost`."""
        # First what sensors suffer, which is true; then what the way down does to it.
        rows = self._sensed(self._satellite.fetch())
        if len(rows):
            self._send(rows, self._packets.next())
        now_s = self._clock.now_s()
        arrived = [np.empty((0, len(self.columns)))]
        while self._under_way and self._under_way[0][0] <= now_s:
            arrived.append(self._under_way.popleft()[1])
        return np.concatenate(arrived)

    def _send(self, rows: FloatArray, occasion: Occasion) -> None:
        plan, struck = self._plan, self._plan.struck(occasion)
        for fault in sorted(struck):
            self._tap.note(f"fault {fault}", occasion.at_s, occasion.number)
        if "disconnect" in struck:
            # What was in this packet is lost with it.
            raise LinkLost("ground segment (simulated): no connection to the satellite; wait for the next contact")
        if "silent" in struck:
            return
        come_s = occasion.at_s + plan.delay_s(struck)
        # The same packet comes down a second time.
        self._under_way.extend([(come_s, rows)] * (2 if "duplicated" in struck else 1))

    def _sensed(self, rows: FloatArray) -> FloatArray:
        """The rows with what sensors suffer."""
        times_s = self._began_s + rows[:, 0]
        for place, sensor in self._sensors.items():
            rows[:, place] = sensor.gives(times_s, rows[:, place])
        for column, values in zip(self.columns, rows.T, strict=True):
            self._tap.note(column, rows[:, 0], values)
        return rows
