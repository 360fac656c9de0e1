"""The state machine of a motion group.

Functions that block their socket take a `done` callback, called with the error code when the action ends.
All of them raise `Refused(-22)` in states that do not allow them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from simulators.clock import SimulationClock
from simulators.newport_xps.codes import FOLLOWING_ERROR_BIT, INHIBITION_BIT, GroupState, Refused
from simulators.newport_xps.positioner import Positioner
from simulators.newport_xps.settings import XpsSimulatorSettings

Done = Callable[[int], None]

_AFTER_FOLLOWING_ERROR = {
    GroupState.HOMING: GroupState.HOMING_FOLLOWING_ERROR,
    GroupState.MOVING: GroupState.MOTION_FOLLOWING_ERROR,
    GroupState.JOGGING: GroupState.JOG_FOLLOWING_ERROR,
}

REFERENCED = frozenset({GroupState.MOVING, GroupState.JOGGING})
"""States under way in which the group knows where it is."""


class Group:
    """One or more positioners that are initialised, homed, moved and stopped together."""

    def __init__(
        self,
        positioners: Mapping[str, Positioner],
        clock: SimulationClock,
        settings: XpsSimulatorSettings,
    ) -> None:
        self.positioners = positioners
        self.state = GroupState.NOT_INITIALISED
        self.inhibited = False
        """The emergency stop is pressed."""
        self._clock = clock
        self._settings = settings
        self._blocked: list[Done] = []
        self._enders: list[Done] = []
        self._action = 0

    def initialise(self, done: Done, *, calibrating: bool = False) -> None:
        """Switch the motors on; -26 while the emergency stop is pressed."""
        self._require(self.state.must_initialise)
        if self.inhibited:
            raise Refused(-26)
        for positioner in self.positioners.values():
            positioner.end_of_run = 0
        state = GroupState.ENCODER_CALIBRATING if calibrating else GroupState.MOTOR_INITIALISATION
        self._begin(state, done)
        ready_s = self._clock.now_s() + self._settings.initialisation_s
        self._then(ready_s, lambda: self._end(GroupState.NOT_REFERENCED))

    def home(self, done: Done) -> None:
        """Find the mechanical zero of every positioner."""
        self._require(self.state is GroupState.NOT_REFERENCED)
        now_s = self._clock.now_s()
        self._begin(GroupState.HOMING, done)
        arrived_s = [p.seek_home(now_s) for p in self.positioners.values()]
        # A search takes its time even where the stage stands at its zero already.
        self._then(max(now_s + self._settings.home_search_s, *arrived_s), self._referenced)

    def move(self, targets_deg: Mapping[str, float], done: Done) -> None:
        """Move some of the positioners to absolute targets."""
        self._require(self.state.ready)
        for name, target_deg in targets_deg.items():
            self.positioners[name].check_target(target_deg)
        now_s = self._clock.now_s()
        self._begin(GroupState.MOVING, done)
        arrived_s = max(self.positioners[name].start(now_s, t) for name, t in targets_deg.items())
        # There already: nothing moves, so nothing has to settle.
        if arrived_s <= now_s:
            self._end(GroupState.READY_FROM_MOTION)
            return
        self._then(arrived_s + self._settings.settle_s, lambda: self._end(GroupState.READY_FROM_MOTION))

    def home_and_move(self, displacements_deg: Mapping[str, float], done: Done) -> None:
        """Home, then move by `displacements_deg` from the zero."""
        for name, displacement_deg in displacements_deg.items():
            self.positioners[name].check_target(displacement_deg)

        def homed(code: int) -> None:
            if code:
                done(code)
                return
            try:
                self.move(displacements_deg, done)
            except Refused as refused:
                done(refused.code)

        self.home(homed)

    def abort(self, done: Done) -> None:
        """Brake a motion or a jog; the group stays ready."""
        self._require(self.state in (GroupState.MOVING, GroupState.JOGGING))
        self._enders.append(done)
        now_s = self._clock.now_s()
        stands_s = max(p.brake(now_s) for p in self.positioners.values())
        self._then(stands_s, lambda: self._end(GroupState.READY_FROM_ABORT, -27))

    def kill(self, done: Done) -> None:
        """Brake hard whatever happens and switch the motors off; always allowed."""
        self._enders.append(done)
        # A second kill only waits for the first.
        if self.state is not GroupState.EMERGENCY_BRAKING:
            self.state = GroupState.EMERGENCY_BRAKING
            code = self._settings.killed_motion_code
            self._brake_hard(lambda: self._end(GroupState.KILLED, code))

    def disable(self) -> None:
        """Open the servo loop."""
        self._require(self.state.ready)
        self.state = GroupState.DISABLED

    def enable(self) -> None:
        """Close the servo loop."""
        self._require(self.state.disabled and not self._turning())
        if self.inhibited:
            raise Refused(-26)
        self.state = GroupState.READY_FROM_ENABLE

    def enable_jog(self) -> None:
        """Obey `jog` from now on."""
        self._require(self.state.ready)
        self.state = GroupState.JOGGING

    def jog(self, velocities: Sequence[tuple[Positioner, float, float]]) -> None:
        """Turn each positioner at (velocity [deg/s], acceleration [deg/s2]), up to its travel limit."""
        # Not while an abort brakes: it would never come to rest.
        self._require(self.state is GroupState.JOGGING and not self._enders)
        for positioner, velocity_deg_s, acceleration_deg_s2 in velocities:
            positioner.check_jog(velocity_deg_s, acceleration_deg_s2)
        now_s = self._clock.now_s()
        # A brake planned for the travel limit does not hold for the new velocity.
        self._action += 1
        for positioner, velocity_deg_s, acceleration_deg_s2 in velocities:
            brake_s = positioner.start_jog(now_s, velocity_deg_s, acceleration_deg_s2)
            if math.isfinite(brake_s):
                self._brake_at(brake_s, positioner, acceleration_deg_s2)

    def disable_jog(self) -> None:
        """End jogging; only at rest."""
        self._require(self.state is GroupState.JOGGING and not self._turning())
        self._end(GroupState.READY_FROM_JOG)

    def start_referencing(self) -> None:
        """Allow positions to be set without motion."""
        self._require(self.state is GroupState.NOT_REFERENCED)
        self.state = GroupState.REFERENCING

    def set_position(self, positioner: Positioner, position_deg: float) -> None:
        """Call the present place `position_deg`."""
        self._require(self.state is GroupState.REFERENCING)
        positioner.reference_here(self._clock.now_s(), position_deg)

    def stop_referencing(self) -> None:
        """Believe the positions that were set."""
        self._require(self.state is GroupState.REFERENCING)
        self.state = GroupState.READY_FROM_HOMING

    def fail_following(self) -> None:
        """Lose a positioner to a following error, as an obstacle or a failing amplifier would."""
        following = _AFTER_FOLLOWING_ERROR.get(self.state)
        if following is None:
            self._require(self.state.ready)
            following = GroupState.READY_FOLLOWING_ERROR
        for positioner in self.positioners.values():
            positioner.error_word |= FOLLOWING_ERROR_BIT
        self._collapse(following, -25)

    def hit_limit(self) -> None:
        """Run into the end-of-run switch ahead: emergency brake, the group is to be initialised anew."""
        if self._turning():
            for positioner in self.positioners.values():
                positioner.reach_end_of_run(self._clock.now_s())
            self._collapse(GroupState.EMERGENCY_BRAKE, -45)

    def press_emergency_stop(self) -> None:
        """Brake hard; the group is to be initialised anew, which is refused until the stop is released."""
        self.inhibited = True
        for positioner in self.positioners.values():
            positioner.error_word |= INHIBITION_BIT
        if not self.state.must_initialise:
            self._collapse(self._stopped_state(), -26)

    def _stopped_state(self) -> GroupState:
        if not self._settings.interlock_states:
            return GroupState.EMERGENCY_STOP
        referenced = self.state.ready or self.state.disabled or self.state in REFERENCED
        return GroupState.DISABLED_INTERLOCK if referenced else GroupState.NOT_INITIALISED_INTERLOCK

    def release_emergency_stop(self) -> None:
        """It may be initialised again."""
        self.inhibited = False

    def lose_power(self) -> None:
        """The motors are dead; nobody is told."""
        # Before the state changes, which would answer them.
        self._blocked, self._enders = [], []
        self._end(GroupState.NOT_INITIALISED)
        self._brake_hard(lambda: None)

    def _collapse(self, state: GroupState, code: int) -> None:
        """Answer at once those who wait, brake, and enter the state at rest."""
        self._end(GroupState.EMERGENCY_BRAKING, code)
        self._brake_hard(lambda: self._end(state))

    def _referenced(self) -> None:
        for positioner in self.positioners.values():
            positioner.reference_here(self._clock.now_s(), 0.0)
        self._end(GroupState.READY_FROM_HOMING)

    def _brake_hard(self, then: Callable[[], None]) -> None:
        now_s = self._clock.now_s()
        hard_deg_s2 = self._settings.acceleration_max_deg_s2
        stands_s = max(p.brake(now_s, hard_deg_s2) for p in self.positioners.values())
        if stands_s > now_s:
            self._then(stands_s, then)
        else:
            then()

    def _brake_at(self, at_s: float, positioner: Positioner, deceleration_deg_s2: float) -> None:
        action = self._action

        def due() -> None:
            if action == self._action:
                positioner.brake(self._clock.now_s(), deceleration_deg_s2)

        self._clock.call_at(at_s, due)

    def _turning(self) -> bool:
        now_s = self._clock.now_s()
        return any(p.velocity(now_s) != 0.0 for p in self.positioners.values())

    def _require(self, allowed: bool) -> None:
        if not allowed:
            raise Refused(-22)

    def _begin(self, state: GroupState, done: Done) -> None:
        self.state = state
        self._blocked.append(done)

    def _then(self, at_s: float, step: Callable[[], None]) -> None:
        self._action += 1
        # By number: a step that another action has overtaken must not happen.
        action = self._action

        def due() -> None:
            if action == self._action:
                step()

        self._clock.call_at(at_s, due)

    def _end(self, state: GroupState, outcome: int = 0) -> None:
        """Enter a resting state: tell those who waited for the action, then those who ended it."""
        self._action += 1
        self.state = state
        # Taken out first: whoever is told may begin the next action at once.
        blocked, self._blocked = self._blocked, []
        enders, self._enders = self._enders, []
        for tell in blocked:
            tell(outcome)
        for tell in enders:
            tell(0)
