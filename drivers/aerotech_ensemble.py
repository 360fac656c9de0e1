"""Aerotech Ensemble: a linear stage over the controller's ASCII command interface.

Facts from Aerotech's library headers and drivers in public use (EPICS motorAerotech, ESRF BLISS, NASA
golaborate). Where these are silent the driver decides:

- Homing: `HOME` blocks the command interpreter, so that nothing could stop it over the same socket. The
  driver sends `HOMEASYNC` and polls; a controller that does not know it (`!`) gets `HOME`, and then a stop
  takes effect only when homing has ended.
- `WAIT MODE NOWAIT` and the ramp are sent before every motion: enabling resets the mode, and other clients
  change both. No exchange is long then, so `stop` gets its turn at once.
- `OSCILLATE` is a raised cosine that begins at one end; whether its distance is the whole travel or the
  amplitude is a setting.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from drivers.aerotech_ascii import INVALID, Answer, AsciiLink
from drivers.aerotech_axis import SAFETY_FAULTS, AsciiAxis, AxisStatus, fault_text
from drivers.aerotech_capture import PositionCapture
from drivers.aerotech_settings import EnsembleSettings
from drivers.numbers import plain
from drivers.transport import Connect
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import InstrumentError, LinkLost, MotionStopped, WrongInstrument
from rigctl.core.interfaces import Channel, Identity, Reading

# Parameter numbers of Aerotech's C header (EnsembleParameterId.h).
UNITS_NAME, AXIS_NAME, COUNTS_PER_UNIT = 129, 140, 2
SOFTWARE_LIMIT_LOW, SOFTWARE_LIMIT_HIGH = 37, 38
GLOBAL_INTEGERS = 124
DECIMALS = 9
"""Of mm and Hz in commands."""


class AerotechEnsemble:
    """One axis of an Ensemble as a linear stage that records its own position at trigger edges."""

    def __init__(self, name: str, settings: EnsembleSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.limits = settings.limits
        self._settings = settings
        self._axis = settings.axis
        self._clock = clock
        self._link = AsciiLink(name, connect, settings.link_timeout_s)
        self._wire = AsciiAxis(name, settings.axis, settings.plane, self._link)
        self._capture = PositionCapture(name, settings, self._wire, clock)
        self._stops = 0
        self._counts_per_mm = 1.0
        self._axis_name = settings.axis

    # instrument

    def open(self) -> None:
        """Connect and check that an Ensemble with this axis, in millimetres, answers; moves nothing."""
        try:
            self._link.open()
            self._check_who_answers()
            self._compare_limits()
        # A Ctrl-C too: whatever ends the opening must free the one connection that the controller serves.
        except BaseException:
            self._link.close()
            raise

    def close(self) -> None:
        """Disconnect; may be called twice. A motion goes on."""
        self._link.close()

    def identify(self) -> Identity:
        """Model and firmware; the interface tells no serial number."""
        firmware = self._wire.succeed("VERSION", self._link.version())
        return Identity("Ensemble", "", firmware, f"Aerotech Ensemble {firmware}, axis {self._axis}")

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._link.confirm_in_step()

    def stop(self) -> None:
        """Abort whatever moves, end a capture, and return when the axis says that it stands still."""
        # First: a motion that is about to be sent in another thread then finds that it was stopped.
        self._stops += 1
        with self._link.urgently():
            self._wire.abort()
            self._capture.end()
            self._await_standstill()

    # linear stage

    def home(self) -> None:
        """Acknowledge faults, enable, find the reference; only what is still to be done of it."""
        with self._stoppable("homing") as stops:
            # Enabling acknowledges faults first: a latched fault would refuse it.
            if not self._wire.status() & AxisStatus.ENABLED:
                self._wire.tell("ACKNOWLEDGEALL")
                self._wire.tell(f"ENABLE {self._axis}")
                # Enabling sets the wait mode back.
                self._wire.tell("WAIT MODE NOWAIT")
            if not self._wire.status() & AxisStatus.HOMED:
                self._find_reference(stops)
            self._check_program_zero()

    def is_homed(self) -> bool:
        """True when enabled and referenced."""
        ready = AxisStatus.ENABLED | AxisStatus.HOMED
        return self._wire.status() & ready == ready

    def safety_stop(self) -> str:
        """The limits and the emergency stop among the axis' latched faults."""
        word = self._wire.fault_word() & SAFETY_FAULTS
        return fault_text(word) if word else ""

    def is_moving(self) -> bool:
        """True while the axis moves or homes."""
        status = self._wire.status()
        return self._wire.moving(status) or bool(status & AxisStatus.HOMING)

    def move_to(self, position_mm: float) -> None:
        """Move and return when the axis is in position."""
        self.limits.require_position(self.name, position_mm)
        with self._stoppable(f"move to {position_mm:g} mm") as stops:
            self._prepare_motion()
            self._move(position_mm, stops)

    def oscillate(self, centre_mm: float, amplitude_mm: float, frequency_hz: float, duration_s: float) -> None:
        """Go to the negative end and start whole cycles for at least `duration_s`; returns once they run."""
        self.limits.require_oscillation(self.name, centre_mm, amplitude_mm, frequency_hz, duration_s)
        whole_travel = self._settings.oscillate_distance == "peak-to-peak"
        distance_mm = 2.0 * amplitude_mm if whole_travel else amplitude_mm
        # Rounded before: 12.0000000001 cycles of rounding must not become 13.
        cycles = math.ceil(round(duration_s * frequency_hz, 9))
        command = f"OSCILLATE {self._axis}, {plain(distance_mm, DECIMALS)}, {plain(frequency_hz, DECIMALS)}, {cycles}"
        with self._stoppable("oscillation") as stops:
            self._prepare_motion()
            # OSCILLATE begins at one end of its travel, so the carriage is brought to the negative end first.
            self._move(centre_mm - amplitude_mm, stops)
            self._start(command, stops)
            self._await_oscillation(command, stops, self._clock.now_s() + cycles / frequency_hz)

    def rest(self) -> None:
        """Decelerate at the controller's AbortDecelRate and return when the axis stands still."""
        self._wire.abort()
        self._await_standstill()

    def position(self) -> Reading:
        """The encoder's position now [mm]."""
        return Reading(self._wire.position_mm(), "mm", self._clock.now_s())

    # paced recorder

    def channels(self) -> tuple[Channel, ...]:
        """The stage's position."""
        return (Channel("stage_x_mm", "mm", "position", self._settings.latency_s),)

    def longest_record(self, period_s: float) -> int:
        """Most positions of one record; `LimitError` when the capture is not that fast."""
        return self._capture.longest_record(period_s)

    def arm(self, samples: int, period_s: float) -> None:
        """Clear and wait for `samples` edges, `period_s` apart."""
        self._capture.arm(samples, period_s)

    def collect(self) -> FloatArray:
        """The captured positions, shape (samples, 1) [mm]; `InstrumentError` when edges were missed."""
        counts = self._capture.counts()
        # After the registers: a unit that was changed at any time before has spoilt them.
        self._require_unit()
        return counts[:, np.newaxis] / self._counts_per_mm

    # what the motions are made of

    def _find_reference(self, stops: int) -> None:
        command = f"HOMEASYNC {self._axis}"
        answer = self._send_motion(command, stops)
        # An older firmware; its HOME answers only when homing has ended, hence the long time-out.
        if answer.status == INVALID:
            command = f"HOME {self._axis}"
            answer = self._send_motion(command, stops, self._settings.motion_timeout_s)
        self._wire.succeed(command, answer)
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        # The first idle poll may be older than the homing; the second says that it has ended.
        idle_polls = 0
        while True:
            status = self._wire.status()
            busy = status & AxisStatus.HOMING or self._wire.moving(status)
            if not busy:
                self._raise_if_stopped(stops, "homing")
                if status & AxisStatus.HOMED:
                    return
                idle_polls += 1
                if idle_polls > 1:
                    raise self._wire.ended(command, "it ended without the reference")
            self._wait(deadline_s, command)

    def _move(self, position_mm: float, stops: int) -> None:
        speed_mm_s = min(self._settings.move_speed_mm_s, self._settings.speed_mm_s)
        # An axis' own speed is XF; F is that of coordinated motions (EPICS' LINEAR).
        speed = f"{self._axis_name}F{plain(speed_mm_s, DECIMALS)}"
        command = f"MOVEABS {self._axis} {plain(position_mm, DECIMALS)} {speed}"
        self._start(command, stops)
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        idle_polls = 0
        while True:
            status = self._wire.status()
            if not self._wire.moving(status):
                self._raise_if_stopped(stops, f"move to {position_mm:g} mm")
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
            self._wait(deadline_s, command)

    def _await_oscillation(self, command: str, stops: int, end_s: float) -> None:
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        idle_polls = 0
        while not self._wire.moving(status := self._wire.status()):
            self._raise_if_stopped(stops, "oscillation")
            if not status & AxisStatus.ENABLED or idle_polls > 1:
                raise self._wire.ended(command, "the axis does not move")
            # An oscillation may be over before it was ever seen to move, when it is shorter than a poll.
            if self._clock.now_s() >= end_s:
                return
            idle_polls += 1
            self._wait(deadline_s, command)

    def _await_standstill(self) -> None:
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        while self._wire.moving(self._wire.status()):
            self._wait(deadline_s, f"ABORT {self._axis}")

    def _wait(self, deadline_s: float, command: str) -> None:
        if self._clock.now_s() > deadline_s:
            # The motion may go on, and who called is about to give up on it.
            self._wire.abort()
            raise InstrumentError(
                f"{self.name}: {command!r} has not ended after {self._settings.motion_timeout_s:g} s and was "
                "aborted; look at the stage, or raise motion_timeout_s",
                instrument=self.name,
            )
        self._clock.sleep_s(self._settings.poll_interval_s)

    def _prepare_motion(self) -> None:
        """At rest, ready, and set up; the query also finds a connection the controller has closed."""
        status = self._wire.status()
        if not (status & AxisStatus.ENABLED and status & AxisStatus.HOMED):
            fault = self._wire.fault_word()
            raise InstrumentError(
                f"{self.name}: axis {self._axis} is not enabled and homed ({fault_text(fault)}); home it",
                instrument=self.name,
                code=str(fault),
                text=fault_text(fault),
            )
        if self._wire.moving(status):
            self.rest()
        self._require_unit()
        ramp_mm_s2 = min(self._settings.ramp_rate_mm_s2, self._settings.acceleration_mm_s2)
        self._wire.tell("WAIT MODE NOWAIT")
        self._wire.tell("RAMP MODE RATE")
        self._wire.tell(f"RAMP RATE {self._axis} {plain(ramp_mm_s2, DECIMALS)}")

    def _start(self, command: str, stops: int) -> None:
        self._wire.succeed(command, self._send_motion(command, stops))

    def _send_motion(self, command: str, stops: int, timeout_s: float | None = None) -> Answer:
        """Send a motion command once, unless somebody has stopped the stage since `stops` was read."""
        # Look and start in one hold of the lock, so that no stop of another thread gets between them.
        with self._link.lock:
            self._raise_if_stopped(stops, command)
            return self._link.tell(command, timeout_s=timeout_s)

    @contextmanager
    def _stoppable(self, motion: str) -> Iterator[int]:
        """How often the stage had been stopped; a connection that a stop took over is no lost link."""
        stops = self._stops
        try:
            yield stops
        except LinkLost:
            self._raise_if_stopped(stops, motion)
            raise

    def _raise_if_stopped(self, stops: int, motion: str) -> None:
        if self._stops != stops:
            raise MotionStopped(f"{self.name}: {motion} was stopped", instrument=self.name)

    # who it is

    def _check_who_answers(self) -> None:
        try:
            # No Ensemble knows this word and says `!`; what answers otherwise is something else.
            nonsense = self._link.tell("NONE").status
            version = self._wire.succeed("VERSION", self._link.version())
            self._axis_name = self._wire.ask(f"GETPARM({self._axis}, {AXIS_NAME})").strip('"')
            units, self._counts_per_mm = self._unit()
            self._capture.provide(self._wire.ask_whole(f"GETPARM({self._axis}, {GLOBAL_INTEGERS})"))
        except InstrumentError as error:
            raise self._wrong(str(error)) from error
        if nonsense != INVALID or not re.match(r"\d+\.\d+", version):
            raise self._wrong(f"it answered 'NONE' with {nonsense!r} and 'VERSION' with {version!r}")
        # An axis addressed by its index has whatever name it was given.
        if not self._axis.startswith("@") and self._axis_name.upper() != self._axis.upper():
            raise self._wrong(f"its axis is called {self._axis_name!r}, not {self._axis!r}: set `axis`")
        if units.lower() != "mm":
            raise self._wrong(f"axis {self._axis} counts in {units!r}: set UnitsName and CountsPerUnit to mm")
        if self._counts_per_mm <= 0.0:
            raise self._wrong(f"its CountsPerUnit is {self._counts_per_mm:g}")

    def _compare_limits(self) -> None:
        """`LimitError` when the controller would refuse, in the middle of a campaign, what the rig file allows."""
        low_mm = self._wire.ask_number(f"GETPARM({self._axis}, {SOFTWARE_LIMIT_LOW})")
        high_mm = self._wire.ask_number(f"GETPARM({self._axis}, {SOFTWARE_LIMIT_HIGH})")
        # Both zero: the controller has no soft limits.
        if low_mm or high_mm:
            self.limits.require_inside(
                self.name, low_mm, high_mm, "SoftwareLimitLow and SoftwareLimitHigh (its parameters 37 and 38)"
            )

    def _unit(self) -> tuple[str, float]:
        """What the axis counts in, and how many counts it has to the unit."""
        name = self._wire.ask(f"GETPARM({self._axis}, {UNITS_NAME})").strip('"')
        return name, self._wire.ask_number(f"GETPARM({self._axis}, {COUNTS_PER_UNIT})")

    def _require_unit(self) -> None:
        """`InstrumentError` when another client has changed the unit since `open`; two questions."""
        name, counts = self._unit()
        if name.lower() != "mm" or counts != self._counts_per_mm:
            raise InstrumentError(
                f"{self.name}: axis {self._axis} counts in {name!r} of {counts:g} counts now, not in mm of "
                f"{self._counts_per_mm:g}; set UnitsName and CountsPerUnit back",
                instrument=self.name,
            )

    def _wrong(self, why: str) -> WrongInstrument:
        return WrongInstrument(f"{self.name}: no Ensemble to work with: {why}", instrument=self.name)

    def _check_program_zero(self) -> None:
        # PFBK counts from home, PFBKPROG from the program's zero; soft limits here are relative to home.
        shift_mm = self._wire.ask_number(f"PFBK({self._axis})") - self._wire.position_mm()
        if abs(shift_mm) > self._settings.position_tolerance_mm:
            raise InstrumentError(
                f"{self.name}: program positions of axis {self._axis} are shifted by {shift_mm:g} mm against "
                f"home (POSOFFSET of another client); send POSOFFSET CLEAR {self._axis} or restart it",
                instrument=self.name,
            )


DRIVER = DriverDeclaration(
    "aerotech-ensemble",
    contract=1,
    roles=dict.fromkeys(("linear", "spare"), Use(EnsembleSettings, AerotechEnsemble)),
    simulator="simulators.aerotech_ensemble.declaration:SIMULATOR",
)
