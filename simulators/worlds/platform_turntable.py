"""Where the platform really is: what its encoder believes, and how far off and late it stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator
from simulators.motion import MotionAxis, Stop
from simulators.stretches import stretches
from simulators.worlds.platform_settings import PlatformSettings


@dataclass(frozen=True)
class Attitude:
    """True angle [rad], its derivatives, and the dwell each time belongs to."""

    angle_rad: FloatArray
    speed_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    dwelt_s: FloatArray
    """Time since the last turn ended; inf before the first, NaN while turning."""
    direction: FloatArray
    """Of the last turn: +1, -1, 0 before the first."""


class Turntable:
    """The platform, seen `delay_s` late and ever later by `drift`, from the first stop of a record on.

    Turns that were over before `since_s` are forgotten but for their direction.
    """

    def __init__(
        self,
        settings: PlatformSettings,
        axis: MotionAxis,
        channel: str,
        first_s: float,
        key: tuple[int | str, ...],
        since_s: float = -np.inf,
    ) -> None:
        self._axis = axis
        self._since_s = since_s
        self._key = key
        self._first_s = first_s
        self._delay_s = settings.size("clock-skew", "delay", channel)
        self._drift = settings.size("clock-skew", "drift", channel)
        self._scatter_rad = settings.repeatability_rad
        self._backlash_rad = settings.size("platform-repeatability", "backlash")
        self._stop_rad = settings.size("platform-repeatability", "stop")
        stops, at = axis.stops(np.array([first_s]))
        self._first_number = stops[int(at[0])].number
        self._offsets: dict[int, float] = {}

    def own_time(self, times_s: FloatArray) -> FloatArray:
        """The platform's time, of which it is late."""
        return times_s - self._delay_s - self._drift * (times_s - self._first_s)

    def attitude(self, own_s: FloatArray) -> Attitude:
        """Where it is at times of its own."""
        angle_deg, speed_deg_s, acceleration_deg_s2 = self._axis.sample(own_s)
        stops, index = self._axis.stops(own_s)
        offset, ended_s, direction = np.zeros(own_s.shape), np.empty(own_s.shape), np.empty(own_s.shape)
        for number, chosen in stretches(index):
            stop = stops[number]
            offset[chosen] = self._offset_rad(stop)
            ended_s[chosen] = stop.start_s if stop.start_s > self._since_s else -np.inf
            direction[chosen] = stop.direction
        moving = speed_deg_s != 0.0
        nominal = np.deg2rad(angle_deg)
        return Attitude(
            # Nothing at 0, all of it at half a turn: by so much the two stops are not half a turn apart.
            nominal + offset + 0.5 * self._stop_rad * (1.0 - np.cos(nominal)),
            np.deg2rad(speed_deg_s),
            np.deg2rad(acceleration_deg_s2),
            np.where(moving, np.nan, own_s - ended_s),
            direction,
        )

    def motions(self, own_s: FloatArray, tail_s: float) -> list[Stop]:
        """The turns under way at these times, or ended at most `tail_s` before."""
        stops, _ = self._axis.stops(own_s)
        first, last = max(float(own_s.min()) - tail_s, self._since_s), float(own_s.max())
        return [stop for stop in stops if stop.number and stop.start_s > first and stop.began_s < last]

    def motion(self, stop: Stop, nodes: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times, speed and acceleration along the turn that ended in a stop [s, rad/s, rad/s2]."""
        times_s = np.linspace(stop.began_s, stop.start_s, nodes)
        _, speed_deg_s, acceleration_deg_s2 = self._axis.sample(times_s)
        # The last node belongs to the rest already; a motion of constant deceleration has not slackened there.
        acceleration_deg_s2[-1] = self._axis.sample(times_s[-1:] - 1e-9)[2][0]
        return times_s, np.deg2rad(speed_deg_s), np.deg2rad(acceleration_deg_s2)

    def _offset_rad(self, stop: Stop) -> float:
        if stop.number not in self._offsets:
            # Signals are asked in order of time: older turns do not come again.
            self._offsets = {n: o for n, o in self._offsets.items() if n > stop.number - 16}
            # Counted from the record's first turn: how often the platform moved before does not matter.
            drawn = generator(*self._key, "stop", stop.number - self._first_number).standard_normal()
            self._offsets[stop.number] = self._scatter_rad * drawn + 0.5 * self._backlash_rad * stop.direction
        return self._offsets[stop.number]
