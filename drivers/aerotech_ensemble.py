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
- `DATAACQ READ`: successive reads go on where the last ended (`capture_read`). Before each read the last
  register is marked, so that a controller with fewer points cannot pass old values off as new.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.aerotech_ascii import FAULT, INVALID, Answer, AsciiLink
from drivers.aerotech_axis import SAFETY_FAULTS, AsciiAxis, AxisStatus, fault_text
from drivers.transport import Connect
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import (
    InstrumentError,
    LimitError,
    LinkLost,
    MotionStopped,
    WrongInstrument,
)
from rigctl.core.interfaces import Channel, Identity, LinearLimits, Reading

UNITS_NAME, AXIS_NAME, COUNTS_PER_UNIT = 129, 140, 2
NOT_WRITTEN = 1e12
"""Marks a register; far beyond any position in mm or counts."""


class EnsembleSettings(BaseModel):
    """The stage's keys in a rig file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    axis: str = Field(default="X", pattern=r"^([A-Za-z]\w*|@\d)$")
    plane: int = Field(default=0, ge=0)
    position_min_mm: float = -25.0
    position_max_mm: float = 25.0
    speed_mm_s: float = Field(default=100.0, gt=0)
    acceleration_mm_s2: float = Field(default=1000.0, gt=0)
    move_speed_mm_s: float = Field(default=20.0, gt=0)
    """Of positioning moves; never above `speed_mm_s`."""
    ramp_rate_mm_s2: float = Field(default=100.0, gt=0)
    """Of positioning moves; never above `acceleration_mm_s2`."""
    position_tolerance_mm: float = Field(default=0.001, gt=0)
    oscillate_distance: Literal["peak-to-peak", "amplitude"] = "peak-to-peak"
    """What the controller's OSCILLATE takes its distance for."""

    capture_input: int = Field(default=1, ge=0)
    capture_trigger: int = Field(default=1, ge=0)
    capture_register_first: int = Field(default=10, ge=0)
    capture_registers: int = Field(default=500, ge=1)
    """How many DGLOBAL registers, from the first, one DATAACQ READ may fill."""
    capture_points_max: int = Field(default=50_000, ge=1)
    capture_period_min_s: float = Field(default=0.0005, ge=0)
    capture_unit: Literal["mm", "counts"] = "mm"
    """What the controller puts into the registers."""
    capture_read: Literal["continues", "restarts"] = "continues"
    """Does a second DATAACQ READ go on, or begin with the first point again? Then one read must hold all."""
    latency_s: float = 0.0
    """From the trigger edge to the latched position."""

    link_timeout_s: float = Field(default=2.0, gt=0)
    motion_timeout_s: float = Field(default=120.0, gt=0)
    poll_interval_s: float = Field(default=0.02, gt=0)

    @model_validator(mode="after")
    def _travel_is_not_empty(self) -> Self:
        if not self.position_min_mm < self.position_max_mm:
            raise ValueError("position_min_mm must lie below position_max_mm")
        return self


class AerotechEnsemble:
    """One axis of an Ensemble as a linear stage that records its own position at trigger edges."""

    def __init__(self, name: str, settings: EnsembleSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.limits = LinearLimits(
            settings.position_min_mm,
            settings.position_max_mm,
            settings.speed_mm_s,
            settings.acceleration_mm_s2,
        )
        self._settings = settings
        self._axis = settings.axis
        self._clock = clock
        self._link = AsciiLink(name, connect, settings.link_timeout_s)
        self._wire = AsciiAxis(name, settings.axis, settings.plane, self._link)
        self._stops = 0
        self._armed = 0
        self._counts_per_mm = 1.0

    # instrument

    def open(self) -> None:
        """Connect and check that an Ensemble with this axis, in millimetres, answers; moves nothing."""
        try:
            self._link.open()
            self._check_who_answers()
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
        self._stops += 1
        with self._link.urgently():
            self._wire.abort()
            if self._armed:
                self._armed = 0
                self._wire.insist(f"DATAACQ {self._axis} OFF")
            self._await_standstill()

    # linear stage

    def home(self) -> None:
        """Acknowledge faults, enable, find the reference; only what is still to be done of it."""
        with self._stoppable("homing") as stops:
            if not self._wire.status() & AxisStatus.ENABLED:
                self._wire.tell("ACKNOWLEDGEALL")
                self._wire.tell(f"ENABLE {self._axis}")
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
        self._check_position(position_mm)
        with self._stoppable(f"move to {position_mm:g} mm") as stops:
            self._prepare_motion()
            self._move(position_mm, stops)

    def oscillate(self, centre_mm: float, amplitude_mm: float, frequency_hz: float, duration_s: float) -> None:
        """Go to the negative end and start whole cycles for at least `duration_s`; returns once they run."""
        self._check_oscillation(centre_mm, amplitude_mm, frequency_hz, duration_s)
        whole_travel = self._settings.oscillate_distance == "peak-to-peak"
        distance_mm = 2.0 * amplitude_mm if whole_travel else amplitude_mm
        cycles = math.ceil(round(duration_s * frequency_hz, 9))
        command = f"OSCILLATE {self._axis}, {_decimal(distance_mm)}, {_decimal(frequency_hz)}, {cycles}"
        with self._stoppable("oscillation") as stops:
            self._prepare_motion()
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
        s = self._settings
        if period_s < s.capture_period_min_s:
            raise LimitError(
                f"{self.name}: cannot capture every {period_s:g} s; "
                f"the shortest period is {s.capture_period_min_s:g} s"
            )
        return (
            min(s.capture_points_max, s.capture_registers) if s.capture_read == "restarts" else s.capture_points_max
        )

    def arm(self, samples: int, period_s: float) -> None:
        """Clear and wait for `samples` edges, `period_s` apart."""
        s = self._settings
        capacity = self.longest_record(period_s)
        if not 1 <= samples <= capacity:
            raise LimitError(
                f"{self.name}: cannot capture {samples} positions, at most {capacity}; "
                "record for a shorter time or at a longer period"
            )
        self._wire.tell(f"DATAACQ {self._axis} INPUT {s.capture_input}")
        self._wire.tell(f"DATAACQ {self._axis} TRIGGER {s.capture_trigger}")
        self._wire.tell(f"DATAACQ {self._axis} ON {samples}")
        self._armed = samples

    def collect(self) -> FloatArray:
        """The captured positions, shape (samples, 1) [mm]; `InstrumentError` when edges were missed."""
        samples, self._armed = self._armed, 0
        if not samples:
            raise InstrumentError(f"{self.name}: no capture is armed; arm it before the run", instrument=self.name)
        if self._settings.latency_s > 0.0:
            self._clock.sleep_s(self._settings.latency_s)
        values: list[float] = []
        while len(values) < samples:
            count = min(self._settings.capture_registers, samples - len(values))
            values += self._read_captured(count, len(values), samples)
        self._require_unit()
        mm_per_register = 1.0 / self._counts_per_mm if self._settings.capture_unit == "counts" else 1.0
        return np.array(values)[:, np.newaxis] * mm_per_register

    def _read_captured(self, count: int, already: int, samples: int) -> list[float]:
        first = self._settings.capture_register_first
        last = first + count - 1
        self._wire.tell(f"DGLOBAL({last}) = {NOT_WRITTEN:.0f}")
        command = f"DATAACQ {self._axis} READ {first}, {count}"
        answer = self._link.tell(command)
        if answer.status == FAULT and not self._wire.fault_word():
            raise self._too_few(already, count, samples)
        self._wire.succeed(command, answer)
        values = self._wire.ask_numbers([f"DGLOBAL({register})" for register in range(first, last + 1)])
        if values[-1] == NOT_WRITTEN:
            raise self._too_few(already, count, samples)
        return values

    def _too_few(self, already: int, count: int, samples: int) -> InstrumentError:
        return InstrumentError(
            f"{self.name}: fewer positions captured than the {samples} armed for "
            f"(points {already + 1} to {already + count} are not all there); "
            "check the trigger line and capture_trigger, and collect after the last edge",
            instrument=self.name,
        )

    # what the motions are made of

    def _find_reference(self, stops: int) -> None:
        command = f"HOMEASYNC {self._axis}"
        answer = self._send_motion(command, stops)
        if answer.status == INVALID:
            command = f"HOME {self._axis}"
            answer = self._send_motion(command, stops, self._settings.motion_timeout_s)
        self._wire.succeed(command, answer)
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
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
        command = f"MOVEABS {self._axis} {_decimal(position_mm)} F{_decimal(speed_mm_s)}"
        self._start(command, stops)
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        idle_polls = 0
        while True:
            status = self._wire.status()
            if not self._wire.moving(status):
                self._raise_if_stopped(stops, f"move to {position_mm:g} mm")
                reached_mm = self._wire.position_mm()
                arrived = abs(reached_mm - position_mm) <= self._settings.position_tolerance_mm
                if arrived and status & AxisStatus.IN_POSITION:
                    return
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
        self._wire.tell(f"RAMP RATE {self._axis} {_decimal(ramp_mm_s2)}")

    def _start(self, command: str, stops: int) -> None:
        self._wire.succeed(command, self._send_motion(command, stops))

    def _send_motion(self, command: str, stops: int, timeout_s: float | None = None) -> Answer:
        """Send a motion command once, unless somebody has stopped the stage since `stops` was read."""
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

    # limits

    def _check_position(self, position_mm: float) -> None:
        low, high = self.limits.position_min_mm, self.limits.position_max_mm
        if not low <= position_mm <= high:
            raise LimitError(f"{self.name}: {position_mm:g} mm is outside the travel {low:g} to {high:g} mm")

    def _check_oscillation(
        self, centre_mm: float, amplitude_mm: float, frequency_hz: float, duration_s: float
    ) -> None:
        if not (amplitude_mm > 0 and 0 < frequency_hz < math.inf and 0 < duration_s < math.inf):
            raise LimitError(
                f"{self.name}: an oscillation needs amplitude, frequency and duration above zero, "
                f"not {amplitude_mm:g} mm, {frequency_hz:g} Hz, {duration_s:g} s"
            )
        self._check_position(centre_mm)
        w = 2.0 * math.pi * frequency_hz
        limits = self.limits
        room_mm = min(centre_mm - limits.position_min_mm, limits.position_max_mm - centre_mm)
        largest_mm, limit = min(
            (room_mm, f"travel {limits.position_min_mm:g} to {limits.position_max_mm:g} mm"),
            (limits.speed_mm_s / w, f"speed limit {limits.speed_mm_s:g} mm/s"),
            (limits.acceleration_mm_s2 / w**2, f"acceleration limit {limits.acceleration_mm_s2:g} mm/s2"),
        )
        if amplitude_mm > largest_mm:
            raise LimitError(
                f"{self.name}: {amplitude_mm:g} mm at {frequency_hz:g} Hz about {centre_mm:g} mm exceeds the "
                f"{limit}; the amplitude can be {largest_mm:.4g} mm at most"
            )

    def _check_who_answers(self) -> None:
        try:
            nonsense = self._link.tell("NONE").status
            version = self._wire.succeed("VERSION", self._link.version())
            axis = self._wire.ask(f"GETPARM({self._axis}, {AXIS_NAME})").strip('"')
            units, self._counts_per_mm = self._unit()
        except InstrumentError as error:
            raise self._wrong(str(error)) from error
        if nonsense != INVALID or not re.match(r"\d+\.\d+", version):
            raise self._wrong(f"it answered 'NONE' with {nonsense!r} and 'VERSION' with {version!r}")
        if not self._axis.startswith("@") and axis.upper() != self._axis.upper():
            raise self._wrong(f"its axis is called {axis!r}, not {self._axis!r}: set `axis`")
        if units.lower() != "mm":
            raise self._wrong(f"axis {self._axis} counts in {units!r}: set UnitsName and CountsPerUnit to mm")
        if self._counts_per_mm <= 0.0:
            raise self._wrong(f"its CountsPerUnit is {self._counts_per_mm:g}")

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
        shift_mm = self._wire.ask_number(f"PFBK({self._axis})") - self._wire.position_mm()
        if abs(shift_mm) > self._settings.position_tolerance_mm:
            raise InstrumentError(
                f"{self.name}: program positions of axis {self._axis} are shifted by {shift_mm:g} mm against "
                f"home (POSOFFSET of another client); send POSOFFSET CLEAR {self._axis} or restart it",
                instrument=self.name,
            )


def _decimal(value: float) -> str:
    """Plain decimal notation, to 1e-9."""
    return f"{round(value, 9) + 0.0:.9f}".rstrip("0").rstrip(".")


DRIVER = DriverDeclaration(
    "aerotech-ensemble",
    contract=1,
    roles=dict.fromkeys(("linear", "spare"), Use(EnsembleSettings, AerotechEnsemble)),
    simulator="simulators.aerotech_ensemble.declaration:SIMULATOR",
)
