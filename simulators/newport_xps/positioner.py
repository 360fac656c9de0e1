"""One axis of a group: coordinates, parameters, and what it reports."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.measured import Tap
from simulators.motion import MotionAxis
from simulators.newport_xps.codes import (
    HIGH_ZERO_MARK_BIT,
    MINUS_END_OF_RUN_BIT,
    PLUS_END_OF_RUN_BIT,
    Refused,
)
from simulators.newport_xps.settings import XpsSimulatorSettings


class Positioner:
    """An axis in the controller's coordinates, which count from where it woke up until it is referenced."""

    def __init__(self, name: str, axis: MotionAxis, now_s: float, settings: XpsSimulatorSettings, tap: Tap) -> None:
        self.name = name
        self._tap = tap
        self.axis = axis
        self.speed_deg_s = settings.speed_max_deg_s
        self.acceleration_deg_s2 = settings.acceleration_max_deg_s2
        self.jerk_times_s = (settings.jerk_time_s, settings.jerk_time_s)
        self.travel_deg = (settings.travel_min_deg, settings.travel_max_deg)
        # Closed loop, KP, KI, KD, KS, integration time, cut-off, GKP, GKI, GKD, KForm, feed-forward; without effect.
        self.corrector: tuple[float, ...] = (1.0, 20.0, 200.0, 0.1, 0.8, 1e-3, 4000.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        self.motion_done: tuple[float, ...] = (0.001, 0.1, 0.02, 0.01, 1.0)
        self.jog = (0.0, settings.acceleration_max_deg_s2)
        self.error_word = 0
        self.end_of_run = 0
        """The switch it has run into; 0 for none."""
        self.maxima = (settings.speed_max_deg_s, settings.acceleration_max_deg_s2)
        self._settings = settings
        self._zero_deg = axis.position(now_s)
        self.target_deg = 0.0

    def set_sgamma(self, speed: float, acceleration: float, jerk_min_s: float, jerk_max_s: float) -> None:
        """Speed, acceleration and jerk times of the next moves; -17 beyond the maxima."""
        allowed = (
            0 < speed <= self._settings.speed_max_deg_s
            and 0 < acceleration <= self._settings.acceleration_max_deg_s2
            and 0 < jerk_min_s <= jerk_max_s
        )
        if not allowed:
            raise Refused(-17)
        self.speed_deg_s, self.acceleration_deg_s2 = speed, acceleration
        self.jerk_times_s = (jerk_min_s, jerk_max_s)

    def set_travel(self, minimum_deg: float, maximum_deg: float) -> None:
        """User travel limits, inside the stage's own; -17 otherwise."""
        if not self._settings.travel_min_deg <= minimum_deg < maximum_deg <= self._settings.travel_max_deg:
            raise Refused(-17)
        self.travel_deg = (minimum_deg, maximum_deg)

    def check_target(self, target_deg: float) -> None:
        """Refuse a target outside the user travel limits."""
        if not self.travel_deg[0] <= target_deg <= self.travel_deg[1]:
            raise Refused(self._settings.outside_limits_code)

    def check_jog(self, velocity_deg_s: float, acceleration_deg_s2: float) -> None:
        """Refuse a jog beyond the maxima with -42."""
        fits = abs(velocity_deg_s) <= self._settings.speed_max_deg_s
        if not (fits and 0 < acceleration_deg_s2 <= self._settings.acceleration_max_deg_s2):
            raise Refused(-42)

    def setpoint(self, at_s: float) -> float:
        """Where the profile is [deg]."""
        return self.axis.position(at_s) - self._zero_deg

    def current(self, at_s: float) -> float:
        """Where the encoder says it is [deg]."""
        resolution_deg = self._settings.resolution_deg
        return round(self.setpoint(at_s) / resolution_deg) * resolution_deg

    def reading(self, at_s: float) -> float:
        """What it answers when asked where it is [deg]."""
        position_deg = self.current(at_s)
        self._tap.note("position", at_s, position_deg)
        self._tap.note("true position", at_s, self.axis.position(at_s))
        return position_deg

    def velocity(self, at_s: float) -> float:
        """How fast it turns [deg/s]."""
        return self.axis.velocity(at_s)

    def start(self, at_s: float, target_deg: float) -> float:
        """Set out for `target_deg`; returns when it is there [s]."""
        self.target_deg = target_deg
        target = target_deg + self._zero_deg
        if self._settings.motion_law == "trapezoid":
            return self.axis.move_to(at_s, target, self.speed_deg_s, self.acceleration_deg_s2)
        distance_deg = abs(target - self.axis.position(at_s))
        # Of a cycloid the peak speed is twice the mean, the peak acceleration 2 pi distances by time squared.
        by_speed_s = 2.0 * distance_deg / self.speed_deg_s
        by_acceleration_s = math.sqrt(2.0 * math.pi * distance_deg / self.acceleration_deg_s2)
        return self.axis.turn_to(at_s, target, max(by_speed_s, by_acceleration_s))

    def seek_home(self, at_s: float) -> float:
        """Set out for the mechanical zero; returns when it is there [s]."""
        return self.axis.move_to(at_s, 0.0, self._settings.home_speed_deg_s, self._settings.acceleration_max_deg_s2)

    def start_jog(self, at_s: float, velocity_deg_s: float, acceleration_deg_s2: float) -> float:
        """Turn at a constant velocity; returns when to brake so as to end at the travel limit [s]."""
        self.jog = (velocity_deg_s, acceleration_deg_s2)
        self.axis.jog(at_s, velocity_deg_s, acceleration_deg_s2)
        if velocity_deg_s == 0.0:
            return np.inf
        ramped_s = at_s + abs(velocity_deg_s - self.velocity(at_s)) / acceleration_deg_s2
        # Signed, as the velocity is.
        braking_deg = 0.5 * velocity_deg_s * abs(velocity_deg_s) / acceleration_deg_s2
        # False is the lower limit, True the upper one.
        limit_deg = self.travel_deg[velocity_deg_s > 0]
        left_deg = limit_deg - braking_deg - self.setpoint(ramped_s)
        return max(at_s, ramped_s + left_deg / velocity_deg_s)

    def brake(self, at_s: float, deceleration_deg_s2: float | None = None) -> float:
        """Brake to rest; returns when it stands [s]."""
        stands_s = self.axis.halt(at_s, deceleration_deg_s2 or self.acceleration_deg_s2)
        # After a stop its target is where it stands: relative moves go on from there.
        self.target_deg = self.setpoint(stands_s)
        return stands_s

    def reference_here(self, at_s: float, position_deg: float) -> None:
        """From now on this place is called `position_deg`."""
        self._zero_deg = self.axis.position(at_s) - position_deg
        self.target_deg = position_deg

    def reach_end_of_run(self, at_s: float) -> None:
        """The switch ahead is met; nothing happens at rest."""
        velocity_deg_s = self.velocity(at_s)
        if velocity_deg_s:
            self.end_of_run = PLUS_END_OF_RUN_BIT if velocity_deg_s > 0 else MINUS_END_OF_RUN_BIT
            self.error_word |= self.end_of_run

    def hardware_status(self, at_s: float) -> int:
        """Bits of the switches: which side of the zero mark, ends of run."""
        angle_deg = self.axis.position(at_s)
        return (
            HIGH_ZERO_MARK_BIT * (angle_deg > 0)
            | MINUS_END_OF_RUN_BIT * (angle_deg < self._settings.travel_min_deg)
            | PLUS_END_OF_RUN_BIT * (angle_deg > self._settings.travel_max_deg)
            | self.end_of_run
        )

    def gatherings(self) -> dict[str, Callable[[FloatArray], FloatArray]]:
        """What can be gathered of this axis, each a function of times [s]."""
        axis, resolution_deg = self.axis, self._settings.resolution_deg

        def setpoint(times_s: FloatArray) -> FloatArray:
            return axis.sample(times_s)[0] - self._zero_deg

        def current(times_s: FloatArray) -> FloatArray:
            return np.round(setpoint(times_s) / resolution_deg) * resolution_deg

        return {
            "SetpointPosition": setpoint,
            "CurrentPosition": current,
            "FollowingError": lambda times_s: setpoint(times_s) - current(times_s),
            "SetpointVelocity": lambda times_s: axis.sample(times_s)[1],
            "CurrentVelocity": lambda times_s: axis.sample(times_s)[1],
            "SetpointAcceleration": lambda times_s: axis.sample(times_s)[2],
            "CurrentAcceleration": lambda times_s: axis.sample(times_s)[2],
        }
