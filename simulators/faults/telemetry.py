"""Faults of a satellite and of the way its telemetry takes: there is no wire, packets of rows are counted."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from rigctl.errors import LinkLost
from simulators.clock import SimulationClock
from simulators.faults.line import Occasions
from simulators.faults.plan import FaultPlan
from simulators.faults.when import Occasion
from simulators.measured import Tap
from simulators.wiring import FloatArray

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
        self._stuck_at: dict[float, FloatArray] = {}

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
        rows = self._sensed(self._satellite.fetch())
        if len(rows):
            self._send(rows, self._packets.next())
        now_s = self._clock.now_s()
        come = [np.empty((0, len(self.columns)))]
        while self._under_way and self._under_way[0][0] <= now_s:
            come.append(self._under_way.popleft()[1])
        return np.concatenate(come)

    def _send(self, rows: FloatArray, occasion: Occasion) -> None:
        plan = self._plan
        if plan.ends_before(occasion) or plan.ends_after(occasion):
            raise LinkLost("ground segment (simulated): no connection to the satellite; wait for the next contact")
        if plan.silent is not None and plan.silent.strikes(plan.seed, occasion):
            return
        twice = plan.duplicated is not None and plan.duplicated.strikes(plan.seed, occasion)
        before_s = self._under_way[-1][0] if self._under_way else 0.0
        come_s = max(occasion.at_s + plan.delay_s(occasion), before_s)
        self._under_way.extend([(come_s, rows)] * (1 + twice))

    def _sensed(self, rows: FloatArray) -> FloatArray:
        """The rows with what sensors suffer."""
        plan, times_s = self._plan, self._began_s + rows[:, 0]
        sensors = np.flatnonzero([name.startswith("m") for name in self.columns])
        if plan.stuck is not None:
            since_s = plan.stuck.strikes_at(plan.seed, times_s)
            for begin_s in np.unique(since_s[~np.isnan(since_s)]):
                struck = since_s == begin_s
                first = self._stuck_at.setdefault(float(begin_s), rows[struck][0, sensors])
                rows[np.ix_(np.flatnonzero(struck), sensors)] = first
        if plan.saturation is not None:
            struck = np.flatnonzero(~np.isnan(plan.saturation.strikes_at(plan.seed, times_s)))
            rows[np.ix_(struck, sensors)] = np.copysign(FULL_SCALE_M_S2, rows[np.ix_(struck, sensors)])
        for column, values in zip(self.columns, rows.T, strict=True):
            self._tap.note(column, rows[:, 0], values)
        return rows
