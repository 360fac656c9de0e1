"""Newport ESP301 (ESP300, ESP302): one axis of it as a rotation stage.

Facts from Newport's manual and the drivers in public use (pymeasure, instrumentkit, EPICS motorNewport).
Where the sources are silent the driver decides:

- The controller does not tell whether an axis is homed: the driver believes only a home search of its own,
  on the same connection, with the motor on ever since.
- `WS` would hold up every later command, a stop too; motions are watched with `MD?` instead.
- The end of a motion is compared with its target: a stage stopped from the front panel reports no error. A home
  search has to be seen to move, and to end at zero.
- Parameters are read back: a command that was lost on the line leaves no error either.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import re
import statistics
from collections.abc import Iterator

from pydantic import Field

from drivers.newport_esp301_examined import examined
from drivers.newport_esp301_line import ERRORS_QUEUED_MAX, EspLine, QueuedError
from drivers.numbers import plain
from drivers.rotation_settings import RotationSettings
from drivers.transport import Connect
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import BadReply, InstrumentError, LinkError, MotionStopped, RigError, SafetyStop
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Identity, Reading

UNIT_DEGREE = 7

UNKNOWN_COMMAND = 6


class Esp301Settings(RotationSettings):
    """The stage's keys in a rig file."""

    axis_number: int = Field(default=1, ge=1, le=3)
    home_mode: int = Field(default=1, ge=0, le=6)
    """The number behind `OR`: 0 zero count, 1 switch and index, 2 switch, 3-6 limits."""
    poll_interval_s: float = Field(default=0.05, gt=0)


class NewportEsp301:
    """One axis of an ESP301 as a rotation stage; angles in degrees."""

    def __init__(self, name: str, settings: Esp301Settings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.limits = settings.limits
        self._settings = settings
        self._axis = settings.axis_number
        self._clock = clock
        self._line = EspLine(name, connect, settings.link_timeout_s)
        # The number of the connection on which it was homed: a new connection may mean that its power was off.
        self._homed_in_session = 0
        self._stops = 0
        self._keypad = False

    # instrument

    def open(self) -> None:
        """Connect, check that an ESP30x answers and forget its old errors; moves nothing.

        The keypad is unlocked.
        """
        try:
            self._line.open()
            self._line.clear_errors()
            self._find_keypad()
        except BaseException:
            self._line.close()
            raise

    def examine(self) -> Iterator[Finding]:
        """Connect and look at unit, stage, errors and limits; moves nothing. Its queue of errors is emptied."""
        self._line.open()
        queued = tuple(itertools.takewhile(lambda error: error.code, self._queued()))
        self._find_keypad()
        version = self.identify().firmware
        yield from examined(version, self._axis, self.limits, self._line, queued, keypad=self._keypad)

    def close(self) -> None:
        """Disconnect; may be called twice. A motion goes on."""
        self._line.close()

    def identify(self) -> Identity:
        """Model and firmware as `VE?` tells them."""
        text = self._line.ask("VE?")
        found = f", at {self._line.found}" if self._line.found else ""
        model, _, version = text.partition(" ")
        return Identity(model, "", re.sub(r"^\s*[Vv]ersion\s+", "", version), text + found)

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._line.confirm_in_step()

    def stop(self) -> None:
        """Decelerate and return when the axis says that it stands still."""
        self._stops += 1
        # Not urgently: commands have no reply here, so a stop is written past whoever waits for one.
        with self._line.reachable():
            try:
                self._line.shout(f"{self._axis}ST")
            # Once more on a new connection: a stop given twice does no harm.
            except LinkError:
                self._line.shout(f"{self._axis}ST")
            # From full speed, and time for the questions.
            braking_s = self.limits.speed_deg_s / self.limits.acceleration_deg_s2
            self._await_rest(f"{self._axis}ST", braking_s + self._settings.link_timeout_s)

    # rotation stage

    def home(self) -> None:
        """Switch the motor on and find the reference; no-op when this was done on this connection."""
        if self.is_homed():
            return
        stops = self._stops
        # Before the search: one that is broken off has lost the reference.
        self._homed_in_session = 0
        self._line.clear_errors()
        self._prepare()
        # Without a number: that of OM, which has been read back.
        search = f"{self._axis}OR"
        with self._keypad_locked():
            self._start(f"{self._axis}MO", stops)
            # What still moves could be taken for the search.
            self._await_rest(f"{self._axis}MO", self._settings.motion_timeout_s)
            self._start(search, stops)
            # Taken before waiting: a connection that was lost during the search is not the one it was begun on.
            session = self._line.session
            self._await_begin(search, stops)
            self._finish(search, stops)
            self._require_zero(search)
        self._homed_in_session = session

    def is_homed(self) -> bool:
        """True when this driver has homed the axis on this connection and its motor is on.

        Raises `InstrumentError` when somebody has set the axis to another unit than degrees.
        """
        self._require_degrees()
        motor_on = self._line.ask_number(f"{self._axis}MO?") == 1
        return motor_on and self._homed_in_session == self._line.session

    def safety_stop(self) -> str:
        """The emergency stop and the limits among the controller's errors, which are taken off its queue."""
        errors = itertools.takewhile(lambda error: error.code, self._queued())
        return ", ".join(error.text for error in errors if error.is_safety)

    def is_moving(self) -> bool:
        """True until the controller reports motion done."""
        return self._line.ask_number(f"{self._axis}MD?") != 1

    def move_to(self, angle_deg: float) -> None:
        """Move and return when the controller reports motion done at the target."""
        self.limits.require_angle(self.name, angle_deg)
        # Counted before the questions: a stop that comes during them keeps the motion back.
        stops = self._stops
        if not self.is_homed():
            raise InstrumentError(f"{self.name}: axis {self._axis} is not homed; home it", instrument=self.name)
        move = f"{self._axis}PA{plain(angle_deg)}"
        with self._keypad_locked():
            self._start(move, stops)
            self._finish(move, stops)
        reached_deg = self.angle().value
        if abs(reached_deg - angle_deg) > self._settings.arrival_tolerance_deg:
            raise MotionStopped(
                f"{self.name}: {move!r} ended at {reached_deg:g} deg without an error; was it stopped by hand?",
                instrument=self.name,
            )

    def angle(self) -> Reading:
        """The encoder's angle [deg] half-way between question and answer; of three where a bit could turn."""
        asked_s = self._clock.now_s()
        # Three readings: one with a turned bit is outvoted by the median.
        angles_deg = [self._line.ask_number(f"{self._axis}TP?") for _ in range(1 if self._line.guarded else 3)]
        return Reading(statistics.median(angles_deg), "deg", 0.5 * (asked_s + self._clock.now_s()))

    # what these are made of

    def _queued(self) -> Iterator[QueuedError]:
        """The errors in the controller's queue, which are taken off it, and what it says when there are no more."""
        return (self._line.next_error() for _ in range(ERRORS_QUEUED_MAX))

    def _prepare(self) -> None:
        """Check the travel limits, set speed, ramps and how to home."""
        low_deg, high_deg = (self._line.ask_number(f"{self._axis}{limit}?") for limit in ("SL", "SR"))
        self.limits.require_inside(self.name, low_deg, high_deg, "SL and SR")
        self._set("VA", self.limits.speed_deg_s)
        self._set("AC", self.limits.acceleration_deg_s2)
        self._set("AG", self.limits.acceleration_deg_s2)
        self._set("OM", self._settings.home_mode)

    def _set(self, parameter: str, value: float) -> None:
        """Set a parameter of the axis and read it back: of a command that never came no error tells."""
        command = f"{self._axis}{parameter}{plain(value)}"
        self._command(command)
        there = self._line.ask_number(f"{self._axis}{parameter}?")
        # The controller rounds to units of its own, and to four decimals.
        if not math.isclose(there, value, rel_tol=1e-3, abs_tol=1e-4):
            raise BadReply(
                f"{self.name}: {command!r} is {there:g} when it is read back; check cable and baud rate, "
                "and that nobody else uses the controller",
                instrument=self.name,
            )

    def _require_degrees(self) -> None:
        unit = self._line.ask_number(f"{self._axis}SN?")
        if unit != UNIT_DEGREE:
            raise InstrumentError(
                f"{self.name}: axis {self._axis} counts in unit {unit:g}, not in degrees; set it up with SN7",
                instrument=self.name,
            )

    def _start(self, command: str, stops: int) -> None:
        """Send a command once, unless somebody has stopped the axis since `stops`."""
        with self._line.lock:
            self._raise_if_stopped(command, stops)
            # Old errors first, or they would be taken for this command's.
            self._check(f"what happened before {command}")
            self._command(command)
            if self._stops != stops:  # by a signal handler of this thread
                self._line.tell(f"{self._axis}ST")

    def _await_begin(self, search: str, stops: int) -> None:
        """See it move: a search that has not begun is done as well as one that has ended."""
        deadline_s = self._clock.now_s() + self._settings.link_timeout_s
        while not self.is_moving():
            self._raise_if_stopped(search, stops)
            self._check(search)
            if self._clock.now_s() > deadline_s:
                raise InstrumentError(
                    f"{self.name}: {search!r} has not begun after {self._settings.link_timeout_s:g} s; check cable "
                    "and baud rate, then home again",
                    instrument=self.name,
                )
            self._clock.sleep_s(self._settings.poll_interval_s)

    def _require_zero(self, search: str) -> None:
        reached_deg = self.angle().value
        if abs(reached_deg) > self._settings.arrival_tolerance_deg:
            raise MotionStopped(
                f"{self.name}: {search!r} ended at {reached_deg:g} deg, not at its zero, without an error; was it "
                "stopped by hand, or does SH say another number than 0 for that place?",
                instrument=self.name,
            )

    def _finish(self, command: str, stops: int) -> None:
        self._await_rest(command, self._settings.motion_timeout_s)
        self._raise_if_stopped(command, stops)
        self._check(command)

    def _find_keypad(self) -> None:
        """Unlock the keypad, which a session before this one may have left locked; see whether it can be locked."""
        with self._line.lock:
            self._line.tell("LC0")
            error = self._line.next_error()
        # A controller without the command has a keypad that nobody can lock.
        self._keypad = error.code != UNKNOWN_COMMAND
        if error.code and self._keypad:
            raise self._failed("LC0", error)

    @contextlib.contextmanager
    def _keypad_locked(self) -> Iterator[None]:
        """All keys but STOP: one pressed by chance must not move the stage elsewhere."""
        if not self._keypad:
            yield
            return
        self._line.tell("LC1")
        try:
            yield
        finally:
            # Why a motion failed must not hide behind a keypad that stays locked; the next start unlocks it.
            with contextlib.suppress(RigError):
                self._line.tell("LC0")

    def _await_rest(self, command: str, timeout_s: float) -> None:
        deadline_s = self._clock.now_s() + timeout_s
        while not self._at_rest():
            if self._clock.now_s() > deadline_s:
                # Abort, not ST: the stop may be what has not ended.
                self._line.tell(f"{self._axis}AB")
                raise InstrumentError(
                    f"{self.name}: {command!r} has not ended after {timeout_s:g} s and was aborted; "
                    "look at the stage, or raise motion_timeout_s",
                    instrument=self.name,
                )
            self._clock.sleep_s(self._settings.poll_interval_s)

    def _at_rest(self) -> bool:
        """Said twice where a bit could turn: moving and done differ in one."""
        return all(self._line.ask_number(f"{self._axis}MD?") == 1 for _ in range(1 if self._line.guarded else 2))

    def _command(self, command: str) -> None:
        with self._line.lock:
            self._line.tell(command)
            self._check(command)

    def _check(self, command: str) -> None:
        # Commands are not acknowledged: only the queue tells whether this one was taken.
        error = self._line.next_error()
        if error.code:
            raise self._failed(command, error)

    def _failed(self, command: str, error: QueuedError) -> InstrumentError:
        kind = SafetyStop if error.is_safety else InstrumentError
        return kind(
            f"{self.name}: {command!r} failed with {error.code} ({error.text}); see the manual's error list",
            instrument=self.name,
            code=str(error.code),
            text=error.text,
        )

    def _raise_if_stopped(self, command: str, stops: int) -> None:
        if self._stops != stops:
            raise MotionStopped(f"{self.name}: {command!r} was stopped", instrument=self.name)


DRIVER = DriverDeclaration(
    "newport-esp301",
    contract=1,
    roles=dict.fromkeys(("rotation", "spare"), Use(Esp301Settings, NewportEsp301)),
    simulator="simulators.newport_esp301.declaration:SIMULATOR",
    serial_baud=921600,
)
