"""The state machine of one axis."""

from __future__ import annotations

from collections.abc import Callable

from simulators.clock import SimulationClock
from simulators.measured import Tap
from simulators.motion import MotionAxis
from simulators.newport_esp301.errors import Refused
from simulators.newport_esp301.settings import Esp301SimulatorSettings

Report = Callable[[int], None]

COUNTS = 0
"""Encoder counts among the units of SN."""


class EspAxis:
    """A motor with its stage, in the controller's coordinates, which count from where it woke up until homed.

    `report` takes the codes of errors that happen while it moves.
    """

    def __init__(
        self,
        number: int,
        motion: MotionAxis,
        clock: SimulationClock,
        settings: Esp301SimulatorSettings,
        report: Report,
        tap: Tap,
    ) -> None:
        self._tap = tap
        self.number = number
        self.motion = motion
        self.motor_on = False
        self.done = True
        self.homing = False
        self.speed_deg_s = settings.speed_deg_s
        self.acceleration_deg_s2 = settings.acceleration_deg_s2
        self.deceleration_deg_s2 = settings.acceleration_deg_s2
        self.emergency_deceleration_deg_s2 = settings.acceleration_max_deg_s2
        self.soft_limits_deg = (settings.travel_min_deg, settings.travel_max_deg)
        self.decimals = settings.decimals
        self.unit = settings.unit
        self.home_mode = 1
        self.inhibited = False
        """The emergency stop is pressed: the motor cannot be switched on."""
        self._clock = clock
        self._settings = settings
        self._report = report
        self._zero_deg = motion.position(clock.now_s())
        self._action = 0
        self.target_deg = 0.0

    def position(self) -> float:
        """What the encoder says [deg]."""
        resolution_deg = self._settings.resolution_deg
        return round(self.commanded() / resolution_deg) * resolution_deg

    def reading(self) -> float:
        """What it answers when asked where it is [deg]."""
        position_deg = round(self.position(), self.decimals)
        now_s = self._clock.now_s()
        self._tap.note("position", now_s, position_deg)
        self._tap.note("true position", now_s, self.motion.position(now_s))
        return position_deg

    def commanded(self) -> float:
        """Where the profile is [deg]."""
        return self.motion.position(self._clock.now_s()) - self._zero_deg

    def velocity(self) -> float:
        """How fast it turns [deg/s]."""
        return self.motion.velocity(self._clock.now_s())

    def set_speed(self, speed_deg_s: float) -> None:
        """Speed of the next moves; error 10 beyond the maximum."""
        self._require_positive(speed_deg_s)
        if speed_deg_s > self._settings.speed_max_deg_s:
            raise Refused(10, self.number)
        self.speed_deg_s = speed_deg_s

    def allowed_acceleration(self, acceleration_deg_s2: float) -> float:
        """The value itself; error 11 beyond the maximum."""
        self._require_positive(acceleration_deg_s2)
        if acceleration_deg_s2 > self._settings.acceleration_max_deg_s2:
            raise Refused(11, self.number)
        return acceleration_deg_s2

    def move_to(self, target_deg: float) -> None:
        """Set out for a target; brakes first when it moves already."""
        self._require_movable()
        low_deg, high_deg = self.soft_limits_deg
        if target_deg > high_deg:
            raise Refused(6, self.number)
        if target_deg < low_deg:
            raise Refused(7, self.number)
        self._go(target_deg)

    def run_to_soft_limit(self, direction: int) -> None:
        """Turn until stopped or at the software limit, which is an error."""
        self._require_movable()
        low_deg, high_deg = self.soft_limits_deg
        self._go(high_deg if direction > 0 else low_deg, error=6 if direction > 0 else 7)

    def run_to_hard_limit(self, direction: int) -> None:
        """Turn until stopped or at the end of travel."""
        self._require_movable()
        settings = self._settings
        end_deg = settings.travel_max_deg if direction > 0 else settings.travel_min_deg
        self._go(end_deg - self._zero_deg)

    def home(self, mode: int) -> None:
        """Search the reference: the switch (modes 0-2), the positive (3, 5) or negative (4, 6) limit."""
        self._require_movable()
        if not 0 <= mode <= 6:
            raise Refused(1, self.number)
        settings = self._settings
        places = {3: settings.travel_max_deg, 5: settings.travel_max_deg}
        places |= {4: settings.travel_min_deg, 6: settings.travel_min_deg}
        self.homing, self.done = True, False
        self._when_at_rest(lambda: self._search(places.get(mode, 0.0)))

    def define_position(self, position_deg: float) -> None:
        """Call this place `position_deg`."""
        self._zero_deg = self.motion.position(self._clock.now_s()) - position_deg
        self.target_deg = position_deg

    def stop(self, deceleration_deg_s2: float | None = None) -> None:
        """Brake to rest."""
        self.homing = False
        if self.done:
            return
        self._brake(deceleration_deg_s2 or self.deceleration_deg_s2)
        self._then(self.motion.end_s, self._arrived)

    def emergency_stop(self) -> None:
        """Brake hard, and switch the motor off if so configured."""
        self.stop(self.emergency_deceleration_deg_s2)
        self.motor_on = self.motor_on and not self._settings.abort_turns_motor_off

    def switch_off(self) -> None:
        """Brake hard and switch the motor off."""
        self.stop(self.emergency_deceleration_deg_s2)
        self.motor_on = False

    def fail_following(self) -> None:
        """Run into an obstacle: following error, motor off."""
        self._report(self.number * 100 + 3)
        self.switch_off()

    def hit_limit(self) -> None:
        """Run into the limit switch ahead; nothing happens at rest."""
        velocity_deg_s = self.velocity()
        if velocity_deg_s:
            self._report(self.number * 100 + (4 if velocity_deg_s > 0 else 5))
            self.switch_off()

    @property
    def units_per_deg(self) -> float:
        """Of the positions and speeds on the wire; encoder counts when somebody has chosen them."""
        return 1.0 / self._settings.resolution_deg if self.unit == COUNTS else 1.0

    def at_hard_limits(self) -> tuple[bool, bool]:
        """Is the positive, is the negative limit switch on?"""
        place_deg = self.motion.position(self._clock.now_s())
        return place_deg >= self._settings.travel_max_deg, place_deg <= self._settings.travel_min_deg

    def past_home(self) -> bool:
        """Is the home switch high: the positive side of the mechanical zero?"""
        return self.motion.position(self._clock.now_s()) > 0.0

    def _require_movable(self) -> None:
        if self.homing:
            raise Refused(30, self.number)
        if not self.motor_on:
            raise Refused(13, self.number)

    def _require_positive(self, value: float) -> None:
        # Not `<= 0`, which would let NaN pass.
        if not value > 0:
            raise Refused(1, self.number)

    def _go(self, target_deg: float, error: int = 0) -> None:
        """Move to a target, or to the end of travel if that comes first, then report `error`."""
        self.target_deg = target_deg
        self.done = False
        settings, place_deg = self._settings, target_deg + self._zero_deg
        # The end of travel stops it, whatever the software limits say.
        within_deg = min(max(place_deg, settings.travel_min_deg), settings.travel_max_deg)
        if within_deg != place_deg:
            error = 4 if within_deg < place_deg else 5
        self._when_at_rest(lambda: self._set_out(within_deg, error))

    def _set_out(self, place_deg: float, error: int) -> None:
        now_s = self._clock.now_s()
        # The profile is symmetric: the gentler of the two ramps at both ends.
        ramp_deg_s2 = min(self.acceleration_deg_s2, self.deceleration_deg_s2)
        arrived_s = self.motion.move_to(now_s, place_deg, self.speed_deg_s, ramp_deg_s2)
        if arrived_s <= now_s:
            self._arrived(error)
        else:
            self._then(arrived_s + self._settings.settle_s, lambda: self._arrived(error))

    def _search(self, place_deg: float) -> None:
        now_s, settings = self._clock.now_s(), self._settings
        found_s = self.motion.move_to(now_s, place_deg, settings.home_speed_deg_s, settings.acceleration_max_deg_s2)
        self._then(max(found_s, now_s + settings.home_search_s), self._referenced)

    def _referenced(self) -> None:
        self.define_position(0.0)
        self.homing = False
        self._arrived()

    def _arrived(self, error: int = 0) -> None:
        self.done = True
        if error:
            self._report(self.number * 100 + error)

    def _when_at_rest(self, step: Callable[[], None]) -> None:
        if self.velocity() == 0.0:
            # What was still to come of an earlier command does not come any more.
            self._action += 1
            step()
        else:
            self._brake(self.deceleration_deg_s2)
            self._then(self.motion.end_s, step)

    def _brake(self, deceleration_deg_s2: float) -> None:
        self.motion.halt(self._clock.now_s(), deceleration_deg_s2)

    def _then(self, at_s: float, step: Callable[[], None]) -> None:
        self._action += 1
        # By number: a step that another command has overtaken must not happen.
        action = self._action

        def due() -> None:
            if action == self._action:
                step()

        self._clock.call_at(at_s, due)
