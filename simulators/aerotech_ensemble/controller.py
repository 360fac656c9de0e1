"""The state machine of the axis: enabled, homed, faulted, and what it is moving for."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum, auto

import numpy as np

from simulators.aerotech_ensemble.grammar import Invalid
from simulators.aerotech_ensemble.limits import AxisLimits
from simulators.aerotech_ensemble.parameters import Parameter, Parameters
from simulators.aerotech_ensemble.refusals import Faulted
from simulators.aerotech_ensemble.settings import StageSimulatorSettings
from simulators.aerotech_ensemble.status import AxisFault, AxisStatus, PlaneStatus
from simulators.clock import SimulationClock
from simulators.keyed_random import generator
from simulators.motion import MotionAxis

SLOWEST_MM_S = 1e-4
# Beyond these a controller would refuse; the bounds are chosen, as no source gives them.
FREQUENCIES_HZ = (1e-3, 1e3)
LIMIT_FAULTS = AxisFault.CW_HARD_LIMIT | AxisFault.CCW_HARD_LIMIT | AxisFault.CW_SOFT_LIMIT | AxisFault.CCW_SOFT_LIMIT


class Activity(Enum):
    """What the axis moves for."""

    NONE = auto()
    MOVE = auto()
    LINEAR = auto()
    JOG = auto()
    OSCILLATE = auto()
    HOME = auto()
    BRAKE = auto()


class AxisController:
    """One axis. Positions are relative to `zero_mm`: where it was switched on, after homing the reference.

    Every call takes the axis to the present first, so that the end of a motion or a limit switch is never
    late, however rarely the clock's events are run.
    """

    def __init__(
        self,
        clock: SimulationClock,
        axis: MotionAxis,
        parameters: Parameters,
        settings: StageSimulatorSettings,
    ) -> None:
        self._clock = clock
        self._axis = axis
        self._parameters = parameters
        self._settings = settings
        self._limits = AxisLimits(axis, parameters, settings)
        self._lasting = AxisFault(0)
        self.on_fault: Callable[[], None] = lambda: None
        self.restart()

    def restart(self) -> None:
        """As after switching on: disabled, not homed."""
        now_s = self._clock.now_s()
        # Without power the stage brakes by itself, as far as the world is concerned.
        if self._axis.velocity(now_s):
            self._axis.halt(now_s, self._settings.abort_deceleration_mm_s2)
        self.enabled = False
        self.homed = False
        # A cause that is still there is a fault after switching on as well.
        self._fault = self._lasting
        self.zero_mm = self._axis.position(now_s)
        self._activity = Activity.NONE
        self._end_s = -math.inf
        self._limit_s = math.inf
        self._limit_fault = AxisFault(0)

    # what it is asked to do

    def enable(self) -> None:
        """Close the loop; `Faulted` while a fault is pending."""
        self._now()
        if self._fault:
            raise Faulted
        self.enabled = True

    def disable(self) -> None:
        """Open the loop; the stage brakes."""
        self._brake(self._now())
        self.enabled = False

    def acknowledge(self) -> None:
        """Clear the faults whose cause is gone; the axis stays disabled."""
        self._now()
        self._fault = self._lasting

    def move(self, target_mm: float, speed_mm_s: float, ramp_mm_s2: float, *, linear: bool = False) -> float:
        """Start a move; returns its end."""
        now_s = self._ready_to_move()
        if speed_mm_s < SLOWEST_MM_S:
            raise Invalid
        # A set-point beyond a limit is accepted or refused, as set up; either way nothing moves.
        if self._rejected(speed_mm_s, target_mm):
            return now_s
        start_s = self._standing_s(now_s, ramp_mm_s2)
        end_s = self._axis.move_to(start_s, target_mm + self.zero_mm, speed_mm_s, ramp_mm_s2)
        self._begin(Activity.LINEAR if linear else Activity.MOVE, now_s, end_s, watch_until_s=end_s)
        # After the start: a drive that cannot follow finds out while it moves.
        self._check_following(now_s, ramp_mm_s2)
        return end_s

    def jog(self, velocity_mm_s: float, ramp_mm_s2: float) -> None:
        """Move at constant velocity until told otherwise; 0 ends it."""
        now_s = self._ready_to_move()
        if velocity_mm_s == 0.0:
            self._brake(now_s, ramp_mm_s2)
            return
        speed_mm_s = abs(velocity_mm_s)
        if speed_mm_s < SLOWEST_MM_S:
            raise Invalid
        before_mm_s = abs(self._axis.velocity(now_s))
        if self._rejected(speed_mm_s):
            return
        self._axis.jog(now_s, velocity_mm_s, ramp_mm_s2)
        ramp_s = (before_mm_s + speed_mm_s) / ramp_mm_s2
        s = self._settings
        # As far as it could run before it meets the switch at the far end.
        way_mm = s.travel_max_mm - s.travel_min_mm + 0.5 * before_mm_s * ramp_s
        self._begin(Activity.JOG, now_s, math.inf, watch_until_s=now_s + ramp_s + way_mm / speed_mm_s)
        self._check_following(now_s, ramp_mm_s2)

    def oscillate(self, distance_mm: float, frequency_hz: float, cycles: int) -> float:
        """Start a raised cosine from where the axis stands; returns its end."""
        now_s = self._ready_to_move()
        s = self._settings
        if distance_mm == 0.0 or not FREQUENCIES_HZ[0] <= frequency_hz <= FREQUENCIES_HZ[1]:
            raise Invalid
        amplitude_mm = distance_mm / 2 if s.dialect.oscillate_distance == "peak-to-peak" else distance_mm
        # The controller makes the frequency by its own clock.
        true_hz = frequency_hz * (1.0 + s.clock_ppm * 1e-6)
        w = 2.0 * math.pi * true_hz
        start_s = self._standing_s(now_s, self._parameters[Parameter.DEFAULT_RAMP_RATE])
        # OSCILLATE begins at one end, so the other is twice the amplitude away.
        far_end_mm = self._axis.position(start_s) - self.zero_mm + 2 * amplitude_mm
        if self._rejected(abs(amplitude_mm) * w, far_end_mm):
            return now_s
        amplitudes = [amplitude_mm, *(amplitude_mm * h for h in s.harmonics)]
        end_s = self._axis.oscillate(start_s, true_hz, amplitudes, cycles)
        # One cycle shows every place that the motion reaches.
        self._begin(Activity.OSCILLATE, now_s, end_s, watch_until_s=start_s + 1.0 / true_hz)
        self._check_following(now_s, abs(amplitude_mm) * w * w)
        return end_s

    def home(self) -> float:
        """Start the search for the reference; returns its end."""
        now_s = self._now()
        if self._fault or not self.enabled:
            raise Faulted
        speed_mm_s = self._parameters[Parameter.HOME_SPEED]
        ramp_mm_s2 = self._parameters[Parameter.HOME_RAMP_RATE]
        start_s = self._standing_s(now_s, ramp_mm_s2)
        arrival_s = self._axis.move_to(start_s, self._settings.home_position_mm, speed_mm_s, ramp_mm_s2)
        self.homed = False
        end_s = arrival_s + self._settings.home_search_s
        self._begin(Activity.HOME, now_s, end_s, watch_until_s=arrival_s)
        return end_s

    def abort(self) -> None:
        """Brake at AbortDecelRate, whatever it was doing."""
        self._brake(self._now())

    def trip(self, fault: AxisFault) -> None:
        """A fault appears now: the stage brakes and is disabled until the fault is acknowledged."""
        self._trip(self._now(), fault)

    def hit_limit(self) -> None:
        """A moving axis meets the limit switch ahead of it."""
        velocity_mm_s = self._axis.velocity(self._now())
        if velocity_mm_s:
            self.trip(AxisFault.CW_HARD_LIMIT if velocity_mm_s > 0 else AxisFault.CCW_HARD_LIMIT)

    def suffer(self, fault: AxisFault) -> None:
        """A fault appears that cannot be acknowledged before `recover`."""
        # Kept aside: acknowledging cannot clear what still has a cause.
        self._lasting |= fault
        self.trip(fault)

    def recover(self, fault: AxisFault) -> None:
        """The cause of a fault is gone; it is still to be acknowledged."""
        self._lasting &= ~fault

    # what it tells

    def fault(self) -> AxisFault:
        """The fault word."""
        self._now()
        return self._fault

    def moving(self) -> bool:
        """True until the last motion has ended."""
        self._now()
        return self._activity is not Activity.NONE

    def commanded_mm(self) -> float:
        """Where the axis should be."""
        return self._axis.position(self._now()) - self.zero_mm

    def feedback_mm(self) -> float:
        """What the encoder says."""
        now_s = self._now()
        s = self._settings
        position_mm = self._axis.position(now_s) - self.zero_mm
        if s.encoder_noise_mm:
            # By time, so that one more question shifts no other reading.
            random = generator(s.seed, "encoder", round(now_s * 1e9))
            position_mm += random.normal(0.0, s.encoder_noise_mm)
        return round(position_mm * s.counts_per_mm) / s.counts_per_mm

    def velocity_mm_s(self) -> float:
        """How fast the axis is."""
        return self._axis.velocity(self._now())

    def status(self) -> AxisStatus:
        """The status word, without position capture."""
        now_s = self._now()
        pressed = bool(self._lasting & AxisFault.EMERGENCY_STOP)
        status = self._limits.levels(self._axis.position(now_s), emergency_stop=pressed)
        if self.enabled:
            status |= AxisStatus.ENABLED | AxisStatus.SERVO_CONTROL
        if self.homed:
            status |= AxisStatus.HOMED
        hidden = self._activity is Activity.OSCILLATE and not self._settings.dialect.oscillate_shows
        if hidden:
            return status
        if self._activity is Activity.NONE:
            settled = self.enabled and now_s >= self._end_s + self._settings.settle_s
            return status | AxisStatus.IN_POSITION if settled else status
        status |= AxisStatus.MOVE_ACTIVE
        if self._activity is Activity.HOME:
            status |= AxisStatus.HOMING
        return status | self._direction_of_motion(now_s)

    def plane_status(self) -> PlaneStatus:
        """The coordinated-motion word: only LINEAR moves are coordinated."""
        now_s = self._now()
        if self._activity is not Activity.LINEAR:
            return PlaneStatus(0)
        status = PlaneStatus.MOTION
        motion = self._direction_of_motion(now_s)
        if motion & AxisStatus.ACCELERATING:
            status |= PlaneStatus.ACCELERATING
        if motion & AxisStatus.DECELERATING:
            status |= PlaneStatus.DECELERATING
        return status

    # how it works

    def _now(self) -> float:
        now_s = self._clock.now_s()
        # An axis at rest has nothing to catch up with.
        if self._activity is not Activity.NONE:
            self._advance(now_s)
        return now_s

    def _advance(self, now_s: float) -> None:
        if self._limit_s <= min(now_s, self._end_s):
            # At its own time, however late somebody looks: what the axis does does not depend on being asked.
            self._trip(self._limit_s, self._limit_fault)
        if self._activity is not Activity.NONE and now_s >= self._end_s:
            if self._activity is Activity.HOME:
                self.homed = True
                offset_mm = self._parameters[Parameter.HOME_OFFSET]
                self.zero_mm = self._settings.home_position_mm - offset_mm
            self._activity = Activity.NONE

    def _begin(self, activity: Activity, now_s: float, end_s: float, watch_until_s: float) -> None:
        self._activity = activity
        self._end_s = end_s
        jogging = activity is Activity.JOG
        self._limit_s, self._limit_fault = self._limits.crossing(now_s, watch_until_s, self.zero_mm, soft=jogging)
        self._wake_at(end_s)
        self._wake_at(self._limit_s)

    def _wake_at(self, at_s: float) -> None:
        if math.isfinite(at_s):
            # So that it happens by itself too, such as the end of a wait that holds a reply back.
            self._clock.call_at(at_s, self._wake)

    def _wake(self) -> None:
        self._now()

    def _brake(self, now_s: float, deceleration_mm_s2: float | None = None) -> None:
        if self._activity is Activity.NONE:
            return
        rate = deceleration_mm_s2 or self._parameters[Parameter.ABORT_DECEL_RATE]
        end_s = self._axis.halt(now_s, rate)
        self._activity = Activity.BRAKE
        self._end_s, self._limit_s = end_s, math.inf
        self._wake_at(end_s)

    def _trip(self, at_s: float, fault: AxisFault) -> None:
        self._brake(at_s)
        self._fault |= fault
        self.enabled = False
        self.on_fault()

    def _standing_s(self, now_s: float, deceleration_mm_s2: float) -> float:
        """When the axis stands still so that a new motion can begin."""
        if self._activity is Activity.NONE or self._axis.velocity(now_s) == 0.0:
            return now_s
        return self._axis.halt(now_s, deceleration_mm_s2)

    def _ready_to_move(self) -> float:
        now_s = self._now()
        if self._fault or not self.enabled or (self._settings.dialect.homing_needed and not self.homed):
            raise Faulted
        return now_s

    def _rejected(self, speed_mm_s: float, position_mm: float | None = None) -> bool:
        """A set-point beyond a limit is a fault before anything moves; raises `Faulted` if set up so."""
        fault = self._limits.of_set_point(speed_mm_s, position_mm)
        if not fault:
            return False
        self._trip(self._clock.now_s(), fault)
        if self._settings.dialect.limit_reply == "refuse":
            raise Faulted
        return True

    def _check_following(self, now_s: float, acceleration_mm_s2: float) -> None:
        if acceleration_mm_s2 > self._settings.acceleration_max_mm_s2:
            self._trip(now_s, AxisFault.POSITION_ERROR)

    def _direction_of_motion(self, now_s: float) -> AxisStatus:
        _, velocity, acceleration = self._axis.sample(np.array([now_s]))
        v, a = float(velocity[0]), float(acceleration[0])
        status = AxisStatus.NEGATIVE_DIRECTION if v < 0 or (v == 0 and a < 0) else AxisStatus(0)
        if a == 0.0:
            return status
        return status | (AxisStatus.DECELERATING if v * a < 0 else AxisStatus.ACCELERATING)
