"""Seating the package and levelling it, by the operator's hands."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from procedures.sensing_axis.bench import Bench
from rigctl.campaign.session.operator import Levelled
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ProcedureError

_MOUNTED_KEY = re.compile(r"(\S+) (\S+) (\d+) mounted$")
"""The key under which a mounting is kept as made."""

LEVELLED = "levelled"
"""The kind of event that keeps when a mounting was levelled."""

MAX_LEVELLINGS = 5
LEVEL_READINGS = 3


@dataclass(frozen=True)
class Mounting:
    """One seating of the package."""

    axis: str
    configuration: str
    number: int

    @property
    def key(self) -> str:
        """The mounting's name in keys of steps and runs."""
        return f"{self.axis} {self.configuration} {self.number}"


@dataclass(frozen=True)
class Seated:
    """What earlier campaigns of the same store have left: the highest number used, and what is mounted."""

    count: int = 0
    last: Mounting | None = None


def mounted_in(store: Store) -> list[Mounting]:
    """Every mounting that a store's campaigns have made, in order."""
    matches = (_MOUNTED_KEY.search(event.data["key"]) for event in store.events("once"))
    return [Mounting(match[1], match[2], int(match[3])) for match in matches if match]


class MountingLostError(ProcedureError):
    """The operator says that the package is no longer as it was seated: what follows needs a new mounting."""


@dataclass
class Fixture:
    """Keeps track of what is mounted, through restarts."""

    session: Session
    bench: Bench
    _mounted: Mounting | None = field(default=None, init=False)

    def mount(self, mounting: Mounting) -> None:
        """Have the package seated and levelled as `mounting`; nothing is done for one that is recorded as done.

        A mounting made before a restart is confirmed with the operator as soon as something is to be measured in it.
        """
        seated = f"{mounting.key} mounted"
        replayed = self.session.done(seated)
        if not replayed:
            self.session.checkpoint()
            # A person will touch the package: nothing may move.
            self.session.guarded("rest", self.bench.apparatus(), self.bench.rest)
            # On a virtual clock the hands have to act when they did, or drifts meet the mounting at another time.
            self._take_up()
            self.session.operator.remount(mounting.axis, mounting.configuration, mounting.number)
            self._mounted = mounting
        # After the hands: killed before it, the mounting is made again under the same number.
        self.session.once(seated, lambda: True)
        self._level(mounting)
        self.session.mounted(replayed=replayed)

    def confirm(self, mounting: Mounting) -> None:
        """Before measuring: is this mounting in place? `MountingLostError` when it is not."""
        if self._mounted == mounting:
            return
        lost = f"{mounting.key} lost"
        operator = self.session.operator
        # Once said, it holds for every later restart.
        if self.session.done(lost) or not operator.still_mounted(
            mounting.axis, mounting.configuration, mounting.number, self._levelled(mounting)
        ):
            self.session.once(lost, lambda: True)
            raise MountingLostError(f"{mounting.key} was disturbed; it is measured anew as another mounting")
        self._mounted = mounting

    def _levelled(self, mounting: Mounting) -> Levelled | None:
        """When this mounting was levelled last, perhaps by an earlier campaign of the store."""
        store = self.session.store
        # A levelling counts once its reading is kept: what was broken off is done anew.
        completed = {None, *(event.data["key"] for event in store.events("once"))}
        levellings = [
            event
            for event in store.events(LEVELLED)
            if event.data["mounting"] == mounting.key and event.data.get("key") in completed
        ]
        last = levellings[-1] if levellings else None
        if last is None or last.rig_time_s is None:
            return None
        return Levelled(last.data.get("at_s", last.rig_time_s), last.data["angle_deg"])

    def _take_up(self) -> None:
        self.session.guarded("taking up", self.bench.apparatus(), self.session.take_up)

    def _level(self, mounting: Mounting) -> None:
        limit_v = self.bench.package.level_limit_v
        reading_v = np.nan
        for attempt in range(1, MAX_LEVELLINGS + 1):
            key = f"{mounting.key} level {attempt}"
            if not self.session.done(key):
                self.confirm(mounting)
                self._take_up()
                at_s = self.session.operator.level(reading_v)
                # Hands with a clock of their own say when; a person's moment is now.
                if at_s is None:
                    at_s = self.session.clock.now_s()
                angle_deg = self.session.guarded(
                    key, self.bench.apparatus(), lambda: self.bench.rotation.angle().value
                )
                levelled = {"mounting": mounting.key, "angle_deg": angle_deg, "at_s": at_s}
                # Before the reading: killed in between, the levelling is not among those done and is repeated.
                self.session.event(LEVELLED, **levelled, key=self.session.key(key))
            reading_v = self.session.once(key, lambda: self._static_output_v(mounting), self.bench.apparatus())
            if abs(reading_v) < limit_v:
                return
        raise ProcedureError(
            f"{mounting.key}: static output {reading_v:+.2f} V after {MAX_LEVELLINGS} levellings, limit "
            f"{limit_v:g} V; check the screws and the sensor"
        )

    def _static_output_v(self, mounting: Mounting) -> float:
        self.confirm(mounting)
        ring_down_s = self.bench.package.axes[mounting.axis].sensor[mounting.configuration].ring_down_s
        # Levelling has set the sensor swinging; three time constants leave a twentieth.
        self.session.wait_s(3.0 * ring_down_s)
        readings = [self.bench.readout.voltage().value for _ in range(LEVEL_READINGS)]
        mean = float(np.mean(readings))
        # An overloaded meter has no number; the level is then far outside.
        return mean if np.isfinite(mean) else 1e3
