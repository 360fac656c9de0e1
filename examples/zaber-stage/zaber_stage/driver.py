"""A Zaber linear stage (X-LSM and others with firmware 6.18 or 7) as a `LinearStage`.

Protocol: see `zaber_stage.messages`. Every command is answered at once; a motion is watched by the BUSY or IDLE of
each reply. `move sin amplitude period count` is a raised cosine from where the axis stands: amplitude in
microsteps, half of the whole travel; period in ms, to 0.1 ms. Speeds are sent as microsteps/s times 1.6384,
accelerations as microsteps/s2 times 1.6384e-4. To confirm at a device: `move sin` on its firmware; that `stop`
decelerates; that WR and WH are gone after homing. It records nothing at trigger edges, hence it is a spare stage.
"""

from __future__ import annotations

import math
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.transport import Connect
from rigctl.core.clock import Clock
from rigctl.core.declarations import USUAL_BAUD, DriverDeclaration, Use
from rigctl.core.errors import InstrumentError, LinkLost, MotionStopped, WrongInstrument
from rigctl.core.interfaces import Identity, Reading
from rigctl.core.limits import LinearLimits
from zaber_stage.line import ZaberLine

SPEED_UNIT, ACCELERATION_UNIT = 1.6384, 1.6384e-4
NO_REFERENCE = frozenset({"WR", "WH"})
STOPPED_BY = {"FD": "driver disabled", "FE": "limit error", "FS": "stalled and stopped"}


class ZaberSettings(BaseModel):
    """The stage's keys in a rig file; the defaults are an X-LSM050A."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    device: int = Field(default=1, ge=1, le=99)
    axis: int = Field(default=1, ge=1, le=9)
    microstep_mm: float = Field(default=4.7625e-5, gt=0)
    zero_mm: float = 25.4
    """Where position 0 is, from the home sensor."""
    position_min_mm: float = -25.0
    position_max_mm: float = 25.0
    speed_mm_s: float = Field(default=50.0, gt=0)
    acceleration_mm_s2: float = Field(default=500.0, gt=0)
    move_speed_mm_s: float = Field(default=10.0, gt=0)
    """Of positioning moves; never above `speed_mm_s`."""
    position_tolerance_mm: float = Field(default=0.001, gt=0)
    link_timeout_s: float = Field(default=2.0, gt=0)
    motion_timeout_s: float = Field(default=120.0, gt=0)
    poll_interval_s: float = Field(default=0.02, gt=0)

    @model_validator(mode="after")
    def _travel_is_not_empty(self) -> Self:
        if not self.position_min_mm < self.position_max_mm:
            raise ValueError("position_min_mm must lie below position_max_mm")
        return self


class ZaberLinear:
    """One axis of a Zaber device; implements `rigctl.core.interfaces.LinearStage`."""

    def __init__(self, name: str, settings: ZaberSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        s = self._settings = settings
        self.limits = LinearLimits(s.position_min_mm, s.position_max_mm, s.speed_mm_s, s.acceleration_mm_s2)
        self._clock = clock
        self._line = ZaberLine(name, s.device, s.axis, connect, s.link_timeout_s)
        self._stops = 0

    # instrument

    def open(self) -> None:
        """Connect and check that a stage with this travel answers; moves nothing."""
        try:
            self._line.open()
            self._check_travel()
        except BaseException:
            self._line.close()
            raise

    def close(self) -> None:
        """Disconnect; may be called twice. A motion goes on."""
        self._line.close()

    def identify(self) -> Identity:
        """Device, serial number and firmware."""
        model, serial = (self._line.ask_whole(f"get {key}") for key in ("deviceid", "system.serial"))
        firmware = self._line.succeed("get version").data
        return Identity(f"Zaber {model}", str(serial), firmware, f"Zaber device {model}, firmware {firmware}")

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._line.confirm_in_step()

    def stop(self) -> None:
        """Decelerate and return when the axis says that it stands still."""
        self._stops += 1
        with self._line.urgently():
            self._brake()

    # linear stage

    def home(self) -> None:
        """Find the home sensor and go to position 0; no-op when it is referenced already."""
        if self.is_homed():
            return
        stops = self._stops
        self._run("home", stops)
        if self._flags() & NO_REFERENCE:
            raise InstrumentError(f"{self.name}: 'home' ended without a reference; look at it", instrument=self.name)
        self._go_to(0.0, stops)

    def is_homed(self) -> bool:
        """True when the axis has its reference and its motor is on."""
        return not self._flags() & (NO_REFERENCE | {"FD"})

    def is_moving(self) -> bool:
        """True until the axis says IDLE."""
        return self._line.succeed("get pos").busy

    def safety_stop(self) -> str:
        """What the device itself has stopped for: a limit, a stall, its driver off."""
        flags = self._flags()
        return ", ".join(text for flag, text in STOPPED_BY.items() if flag in flags)

    def move_to(self, position_mm: float) -> None:
        """Move and return when the axis stands at its target."""
        self.limits.require_position(self.name, position_mm)
        stops = self._stops
        self._prepare_motion()
        self._go_to(position_mm, stops)

    def oscillate(self, centre_mm: float, amplitude_mm: float, frequency_hz: float, duration_s: float) -> None:
        """Go to the negative end and start whole cycles for at least `duration_s`; returns once they run."""
        self.limits.require_oscillation(self.name, centre_mm, amplitude_mm, frequency_hz, duration_s)
        stops = self._stops
        self._prepare_motion()
        self._go_to(centre_mm - amplitude_mm, stops)
        cycles = math.ceil(round(duration_s * frequency_hz, 9))
        amplitude = round(amplitude_mm / self._settings.microstep_mm)
        self._start(f"move sin {amplitude} {1e3 / frequency_hz:.1f} {cycles}", stops)

    def rest(self) -> None:
        """Decelerate and return when the axis stands still."""
        self._brake()

    def position(self) -> Reading:
        """The axis' own count of its position [mm], half-way between question and answer."""
        asked_s = self._clock.now_s()
        position_mm = self._line.ask_whole("get pos") * self._settings.microstep_mm - self._settings.zero_mm
        return Reading(position_mm, "mm", 0.5 * (asked_s + self._clock.now_s()))

    # what these are made of

    def _prepare_motion(self) -> None:
        if not self.is_homed():
            raise InstrumentError(f"{self.name}: it has no reference; home it", instrument=self.name)
        if self.is_moving():
            self._brake()
        s = self._settings
        speed = min(s.move_speed_mm_s, s.speed_mm_s) / s.microstep_mm * SPEED_UNIT
        self._line.succeed(f"set maxspeed {round(speed)}")
        self._line.succeed(f"set accel {max(1, round(s.acceleration_mm_s2 / s.microstep_mm * ACCELERATION_UNIT))}")

    def _go_to(self, position_mm: float, stops: int) -> None:
        target = round((position_mm + self._settings.zero_mm) / self._settings.microstep_mm)
        self._run(f"move abs {target}", stops)
        reached_mm = self.position().value
        if abs(reached_mm - position_mm) > self._settings.position_tolerance_mm:
            why = self.safety_stop() or "somebody else stopped it"
            raise MotionStopped(f"{self.name}: stopped at {reached_mm:g} mm: {why}", instrument=self.name)

    def _run(self, words: str, stops: int) -> None:
        """A motion to its end; a connection that a stop took over is no lost link."""
        try:
            self._start(words, stops)
            self._await_idle(words)
        except LinkLost:
            self._raise_if_stopped(words, stops)
            raise
        self._raise_if_stopped(words, stops)

    def _start(self, words: str, stops: int) -> None:
        """Send a motion once, unless somebody has stopped the axis since `stops`."""
        with self._line.lock:
            self._raise_if_stopped(words, stops)
            self._line.succeed(words)

    def _brake(self) -> None:
        self._line.succeed("stop")
        self._await_idle("stop")

    def _await_idle(self, words: str) -> None:
        deadline_s = self._clock.now_s() + self._settings.motion_timeout_s
        while self.is_moving():
            if self._clock.now_s() > deadline_s:
                self._line.succeed("stop")
                raise InstrumentError(
                    f"{self.name}: {words!r} has not ended after {self._settings.motion_timeout_s:g} s and was "
                    "stopped; look at the stage, or raise motion_timeout_s",
                    instrument=self.name,
                )
            self._clock.sleep_s(self._settings.poll_interval_s)

    def _raise_if_stopped(self, words: str, stops: int) -> None:
        if self._stops != stops:
            raise MotionStopped(f"{self.name}: {words!r} was stopped", instrument=self.name)

    def _flags(self) -> frozenset[str]:
        """All faults and warnings that are on."""
        return frozenset(self._line.succeed("warnings").data.split()[1:])

    # limits

    def _check_travel(self) -> None:
        """`WrongInstrument` when the limits in the rig file reach beyond those of the device."""
        s = self._settings
        low_mm, high_mm = (self._line.ask_whole(f"get limit.{end}") * s.microstep_mm for end in ("min", "max"))
        if s.position_min_mm + s.zero_mm < low_mm or s.position_max_mm + s.zero_mm > high_mm:
            raise WrongInstrument(
                f"{self.name}: the device travels from {low_mm - s.zero_mm:g} to {high_mm - s.zero_mm:g} mm; "
                "correct position_min_mm, position_max_mm, zero_mm or microstep_mm",
                instrument=self.name,
            )


DRIVER = DriverDeclaration(
    "zaber-linear",
    contract=1,
    roles={"spare": Use(ZaberSettings, ZaberLinear)},
    simulator="zaber_stage.simulator:SIMULATOR",
    serial_baud=USUAL_BAUD,
)
