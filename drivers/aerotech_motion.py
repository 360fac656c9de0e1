"""Motions of an Ensemble's axis: sent once, waited for by looking at its status, ended by a stop of any thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.aerotech_ascii import INVALID, SUCCESS, Answer
from drivers.aerotech_axis import AsciiAxis, AxisStatus, fault_text
from drivers.aerotech_program import DECIMALS
from drivers.aerotech_settings import StageSettings
from drivers.numbers import plain
from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError, LinkLost, MotionStopped

# Where HomeAsync looks which axis it has to home (EPICS motorAerotech).
HOME_COUNT, HOME_AXIS = 32, 33


class AxisMotion:
    """Homing, moves, and the waiting for their end."""

    def __init__(self, name: str, settings: StageSettings, wire: AsciiAxis, clock: Clock) -> None:
        self._name = name
        self._settings = settings
        self._wire = wire
        self._clock = clock
        self._stops = 0
        self._homing_task = False

    # stopping

    def note_stop(self) -> None:
        """A motion that is about to be sent in another thread then finds that it was stopped."""
        self._stops += 1

    def abort(self) -> None:
        """Decelerate at the controller's AbortDecelRate, and let no homing of ours go on."""
        self._wire.abort()
        if self._homing_task:
            self._homing_task = False
            self._wire.link.insist(f"PROGRAM STOP {self._settings.home_task}")

    @contextmanager
    def stoppable(self, motion: str) -> Iterator[int]:
        """How often the stage had been stopped; a connection that a stop took over is no lost link."""
        stops = self._stops
        try:
            yield stops
        except LinkLost:
            self.raise_if_stopped(stops, motion)
            raise

    def raise_if_stopped(self, stops: int, motion: str) -> None:
        """`MotionStopped` when somebody has stopped the stage since `stops` was read."""
        if self._stops != stops:
            raise MotionStopped(f"{self._name}: {motion} was stopped", instrument=self._name)

    def send(self, command: str, stops: int, timeout_s: float | None = None) -> Answer:
        """Send a motion command once, unless somebody has stopped the stage since `stops` was read."""
        # Look and start in one hold of the lock, so that no stop of another thread gets between them.
        with self._wire.link.lock:
            self.raise_if_stopped(stops, command)
            return self._wire.link.tell(command, timeout_s=timeout_s)

    def start(self, command: str, stops: int) -> None:
        """As `send`; `InstrumentError` when it is refused."""
        self._wire.succeed(command, self.send(command, stops))

    # motions

    def find_reference(self, stops: int) -> None:
        """Home, and return when the axis is referenced."""
        command = self._start_homing(stops)
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        # A program begins some time after it was told to run.
        begun_s = self._clock.now_s() + self._settings.program_timeout_s if self._homing_task else 0.0
        while True:
            status = self._wire.status()
            busy = status & AxisStatus.HOMING or self._wire.moving(status)
            if busy:
                begun_s = 0.0
            else:
                self.raise_if_stopped(stops, "homing")
                if status & AxisStatus.HOMED:
                    self._homing_task = False
                    return
                if self._clock.now_s() > begun_s:
                    raise self._wire.ended(command, "it ended without the reference")
            self.wait(deadline_s, command)

    def _start_homing(self, stops: int) -> str:
        s = self._settings
        if s.home_program and self._tell_home_program():
            command = f'PROGRAM RUN {s.home_task}, "{s.home_program}"'
            self._homing_task = True
            if self.send(command, stops).status == SUCCESS:
                return command
            self._homing_task = False
        # It answers only when homing has ended, hence the long time-out.
        command = self._wire.words.order("HOME")
        self._wire.succeed(command, self.send(command, stops, s.motion_timeout_s))
        return command

    def _tell_home_program(self) -> bool:
        lines = (f"IGLOBAL({HOME_COUNT}) = 1", f"IGLOBAL({HOME_AXIS}) = {self._wire.number_of_axis()}")
        return all(self._wire.link.insist(line).status == SUCCESS for line in lines)

    def move(self, position_mm: float, stops: int) -> None:
        """Move and return when the axis is in position."""
        speed_mm_s = min(self._settings.move_speed_mm_s, self._settings.speed_mm_s)
        command = self._wire.words.move(plain(position_mm, DECIMALS), plain(speed_mm_s, DECIMALS))
        self.start(command, stops)
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        idle_polls = 0
        while True:
            status = self._wire.status()
            if not self._wire.moving(status):
                self.raise_if_stopped(stops, f"move to {position_mm:g} mm")
                reached_mm = self._wire.position_mm()
                # In position is asked of the controller and of the encoder: another client's move would satisfy the
                # first alone.
                arrived = abs(reached_mm - position_mm) <= self._settings.position_tolerance_mm
                if arrived and status & AxisStatus.IN_POSITION:
                    return
                # The first idle poll may be older than the motion.
                idle_polls += not arrived
                if idle_polls > 1 or not status & AxisStatus.ENABLED:
                    raise self._wire.ended(command, f"it stopped at {reached_mm:g} mm")
            self.wait(deadline_s, command)

    def await_oscillation(self, command: str, stops: int, start_mm: float, end_s: float) -> None:
        """Return once the axis oscillates from `start_mm`, or at `end_s`, when an oscillation may be over unseen."""
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        idle_polls = 0
        while not self._oscillates(status := self._wire.status(), start_mm):
            self.raise_if_stopped(stops, "oscillation")
            idle_polls += not self._wire.task_runs()
            if not status & AxisStatus.ENABLED or idle_polls > 2:
                # It may all the same: a controller that does not show it.
                self.abort()
                raise self._wire.ended(command, "the axis does not move")
            # An oscillation may be over before it was ever seen to move, when it is shorter than a poll.
            if self._clock.now_s() >= end_s:
                return
            self.wait(deadline_s, command)

    def _oscillates(self, status: int, start_mm: float) -> bool:
        if self._wire.shown_moving(status):
            return True
        return abs(self._wire.position_mm() - start_mm) > self._settings.position_tolerance_mm

    def await_standstill(self) -> None:
        """Return when the axis does not move."""
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        while self._wire.moving(self._wire.status()):
            self.wait(deadline_s, self._wire.words.order("ABORT"))

    def prepare(self) -> int:
        """`InstrumentError` unless it is ready for a motion; the status."""
        status = self._wire.status()
        if not (status & AxisStatus.ENABLED and status & AxisStatus.HOMED):
            fault = self._wire.fault_word()
            raise InstrumentError(
                f"{self._name}: {self._wire.words} is not enabled and homed ({fault_text(fault)}); home it",
                instrument=self._name,
                code=str(fault),
                text=fault_text(fault),
            )
        return status

    def set_up(self) -> None:
        """What enabling and other clients change: no waiting for the end of a motion, and the ramp."""
        ramp_mm_s2 = min(self._settings.ramp_rate_mm_s2, self._settings.acceleration_mm_s2)
        self._wire.tell("WAIT MODE NOWAIT")
        rate = plain(ramp_mm_s2, DECIMALS)
        line = "RAMP MODE RATE"
        answer = self._wire.link.tell(line)
        if answer.status == INVALID:
            # EPICS gives a Soloist its ramp by the parameter DefaultRampRate.
            self._wire.tell(self._wire.words.listed("SETPARM", str(self._wire.words.numbers.ramp_rate), rate))
            return
        self._wire.succeed(line, answer)
        self._wire.tell(self._wire.words.order("RAMP RATE", rate))

    def wait(self, deadline_s: float, command: str) -> None:
        """Until the next look; `InstrumentError`, and an abort, after `deadline_s`."""
        if self._clock.now_s() > deadline_s:
            # The motion may go on, and who called is about to give up on it.
            self.abort()
            raise InstrumentError(
                f"{self._name}: {command!r} has not ended after {self._settings.motion_timeout_s:g} s and was "
                "aborted; look at the stage, or raise motion_timeout_s",
                instrument=self._name,
            )
        self._clock.sleep_s(self._settings.poll_interval_s)
