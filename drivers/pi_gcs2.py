"""PI controllers with GCS 2.0 (C-863, C-867, ...): one axis as a rotation stage.

After the C-863.12 user manual (MS249E) and the maker's PIPython. Where these are silent the driver decides:

- Commands are not acknowledged: the error is asked for after each, with nothing in between. Of one that was lost no
  error tells: parameters are read back.
- `FRF` moves to the reference, with the servo on; the controller keeps it, so that a referenced axis is left alone.
  `FRF?` tells as well of a position that was said to it (`POS`, which PIPython's start-up can do); that takes the
  reference mode `RON` off. `DFH` makes any place the zero. Both are asked of controllers that list them in `HLP?`.
- `STP` stops all axes at once and leaves error 10 behind, which is no failure.
- Whether a unit is degrees the controller tells by `PUN?`, if it lists the question; else the operator says so.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from drivers.examining import travel
from drivers.numbers import plain
from drivers.pi_gcs2_line import GcsLine
from drivers.rotation_settings import RotationSettings
from drivers.transport import Connect
from rigctl.core.clock import Clock
from rigctl.core.declarations import USUAL_BAUD, DriverDeclaration, Use
from rigctl.core.errors import BadReply, InstrumentError, LinkError, MotionStopped
from rigctl.core.findings import Finding, ok, unknown
from rigctl.core.interfaces import Identity, Reading

STOPPED = 10
ERRORS = {
    1: "parameter syntax error",
    2: "unknown command",
    5: "not referenced, or servo off",
    7: "position out of limits",
    8: "velocity out of limits",
    10: "stopped by command",
    15: "invalid axis identifier",
    17: "parameter out of range",
    24: "wrong number of parameters",
    1024: "following error: position error too large, the servo is off",
}
"""Of the manual's list (8.7), those that this driver may meet."""
DEGREES = frozenset({"deg", "degree", "degrees"})
MANUAL = "the controller's manual, Physical Unit (parameter 0x07000601)"


class GcsSettings(RotationSettings):
    """The stage's keys in a rig file."""

    axis: str = Field(default="1", pattern=r"^\w{1,8}$")
    unit: Literal["unknown", "deg"] = "unknown"
    """What the axis counts in, for a controller that does not tell."""
    poll_interval_s: float = Field(default=0.05, gt=0)


class PiGcsStage:
    """One axis as a rotation stage; angles in degrees."""

    def __init__(self, name: str, settings: GcsSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.limits = settings.limits
        self._settings = settings
        self._axis = settings.axis
        self._clock = clock
        self._line = GcsLine(name, connect, settings.link_timeout_s)
        self._stops = 0
        self._known: frozenset[str] = frozenset()
        self._zero = 0.0
        """What `DFH?` said when it was opened or homed."""

    # instrument

    def open(self) -> None:
        """Connect, check that a controller of PI's with this axis answers, forget its old error; moves nothing."""
        try:
            self._line.open()
            self._line.error()
            self._require_axis()
            self._known = self._line.commands()
            self._zero = self._zero_now()
        except BaseException:
            self._line.close()
            raise

    def close(self) -> None:
        """Disconnect; may be called twice. A motion goes on."""
        self._line.close()

    def identify(self) -> Identity:
        """Model, serial number and firmware of `*IDN?`."""
        text = self._line.ask("*IDN?")
        fields = [field.strip() for field in text.split(",")]
        _, model, serial, firmware, *_ = (*fields, "", "", "")
        return Identity(model, serial, firmware, text)

    def examine(self) -> Iterator[Finding]:
        """Connect and look at unit, limits and state; moves nothing."""
        self.open()
        unit = self._unit()
        if unit == "unknown":
            yield unknown("capability", "unit", "the controller does not tell in what its axis counts", MANUAL)
        else:
            yield ok("capability", "unit", unit)
        wanted = self.limits.angle_min_deg, self.limits.angle_max_deg
        yield travel(wanted, self._travel(), "deg", ("angle_min_deg", "angle_max_deg"), "TMN and TMX")
        yield ok("capability", "state", "referenced" if self.is_homed() else "to be homed")

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others."""
        self._line.confirm_in_step()

    def stop(self) -> None:
        """Stop all axes and return when the controller says that none moves."""
        self._stops += 1
        with self._line.reachable():
            try:
                self._line.shout("STP")
            # Once more on a new connection: a stop given twice does no harm.
            except LinkError:
                self._line.shout("STP")
            braking_s = self.limits.speed_deg_s / self.limits.acceleration_deg_s2
            self._await_rest("STP", braking_s + self._settings.link_timeout_s)

    # rotation stage

    def home(self) -> None:
        """Switch the servo on and find the reference; no-op when this was done."""
        if self.is_homed():
            return
        stops = self._stops
        self._require_degrees()
        low_deg, high_deg = self._travel()
        self.limits.require_inside(self.name, low_deg, high_deg, "TMN and TMX")
        self._set_profile()
        if "RON" in self._known:
            self._set("RON", 1)
        self._start(f"SVO {self._axis} 1", stops)
        search = f"FRF {self._axis}"
        self._start(search, stops)
        self._finish(search, stops)
        self._zero = self._zero_now()
        if not self.is_homed():
            raise InstrumentError(f"{self.name}: {search!r} ended without the reference", instrument=self.name)

    def is_homed(self) -> bool:
        """True when the axis is referenced by a search and its servo is on.

        Raises `InstrumentError` when somebody has made another place its zero.
        """
        zero = self._zero_now()
        if zero != self._zero:
            raise InstrumentError(
                f"{self.name}: the zero of axis {self._axis} was defined anew (DFH?: {zero:g}, not {self._zero:g}); "
                "switch the controller off and on, and home it",
                instrument=self.name,
            )
        queries = ("FRF?", "SVO?", *({"RON?"} & self._known))
        return all(self._line.ask_number(query, self._axis) == 1 for query in queries)

    def safety_stop(self) -> str:
        """Nothing: GCS has no answer that names a safety device."""
        return ""

    def is_moving(self) -> bool:
        """True while the controller says that an axis moves."""
        return self._line.moving()

    def move_to(self, angle_deg: float) -> None:
        """Move and return when the controller is on target."""
        self.limits.require_angle(self.name, angle_deg)
        # Counted before the questions: a stop that comes during them keeps the motion back.
        stops = self._stops
        if not self.is_homed():
            raise InstrumentError(f"{self.name}: axis {self._axis} is not homed; home it", instrument=self.name)
        self._require_degrees()
        self._set_profile()
        move = f"MOV {self._axis} {plain(angle_deg)}"
        self._start(move, stops)
        self._finish(move, stops, on_target=True)
        reached_deg = self.angle().value
        if abs(reached_deg - angle_deg) > self._settings.arrival_tolerance_deg:
            raise MotionStopped(
                f"{self.name}: {move!r} ended at {reached_deg:g} deg without an error; did somebody else move it?",
                instrument=self.name,
            )

    def angle(self) -> Reading:
        """The encoder's angle [deg] half-way between question and answer; of three where a bit could turn."""
        asked_s = self._clock.now_s()
        # Three readings: one with a turned bit is outvoted by the median.
        angles_deg = [self._line.ask_number("POS?", self._axis) for _ in range(1 if self._line.guarded else 3)]
        return Reading(statistics.median(angles_deg), "deg", 0.5 * (asked_s + self._clock.now_s()))

    # what these are made of

    def _require_axis(self) -> None:
        axes = self._line.ask("SAI?").split()
        # STP stops all axes, and #5 tells of all of them.
        if axes != [self._axis]:
            raise InstrumentError(
                f"{self.name}: the controller's axes are {' '.join(axes)}, this driver takes one called "
                f"{self._axis}; set `axis`, or give it a controller of its own",
                instrument=self.name,
            )

    def _zero_now(self) -> float:
        return self._line.ask_number("DFH?", self._axis) if "DFH?" in self._known else 0.0

    def _unit(self) -> str:
        return self._line.ask_text("PUN?", self._axis).lower() if "PUN?" in self._known else self._settings.unit

    def _require_degrees(self) -> None:
        if (unit := self._unit()) not in DEGREES:
            raise InstrumentError(
                f"{self.name}: axis {self._axis} counts in {unit!r}, not in degrees; look it up in {MANUAL}, and set "
                "`unit`",
                instrument=self.name,
            )

    def _travel(self) -> tuple[float, float]:
        return self._line.ask_number("TMN?", self._axis), self._line.ask_number("TMX?", self._axis)

    def _set_profile(self) -> None:
        """Speed and ramps, which other clients change."""
        self._set("VEL", self.limits.speed_deg_s)
        for ramp in ("ACC", "DEC"):
            self._set(ramp, self.limits.acceleration_deg_s2)

    def _set(self, parameter: str, value: float) -> None:
        """Set a parameter of the axis and read it back: of a command that never came no error tells."""
        command = f"{parameter} {self._axis} {plain(value)}"
        self._command(command)
        there = self._line.ask_number(f"{parameter}?", self._axis)
        # The controller rounds to units of its own.
        if not math.isclose(there, value, rel_tol=1e-3, abs_tol=1e-4):
            raise BadReply(
                f"{self.name}: {command!r} is {there:g} when it is read back; check cable and baud rate, and that "
                "nobody else uses the controller",
                instrument=self.name,
            )

    def _start(self, command: str, stops: int) -> None:
        """Send a command once, unless somebody has stopped the axis since `stops`."""
        with self._line.lock:
            self._raise_if_stopped(command, stops)
            self._line.error()
            self._line.tell(command)
            # By a signal handler of this thread, whose stop may have gone out before the command.
            if self._stops != stops:
                self._line.tell("STP")
            self._check(command)

    def _finish(self, command: str, stops: int, *, on_target: bool = False) -> None:
        self._await_rest(command, self._settings.motion_timeout_s, on_target=on_target)
        self._raise_if_stopped(command, stops)
        self._check(command)

    def _await_rest(self, command: str, timeout_s: float, *, on_target: bool = False) -> None:
        deadline_s = self._clock.now_s() + timeout_s
        while self._moves() or (on_target and not self._settled()):
            if self._clock.now_s() > deadline_s:
                self._line.tell("STP")
                raise InstrumentError(
                    f"{self.name}: {command!r} has not ended after {timeout_s:g} s and was stopped; "
                    "look at the stage, or raise motion_timeout_s",
                    instrument=self.name,
                )
            self._clock.sleep_s(self._settings.poll_interval_s)

    def _moves(self) -> bool:
        """Not to move is said twice where a bit could turn."""
        return any(self._line.moving() for _ in range(1 if self._line.guarded else 2))

    def _settled(self) -> bool:
        """On target, or not to come there any more: without the servo nothing ever is."""
        return any(self._line.ask_number(query, self._axis) == value for query, value in (("ONT?", 1), ("SVO?", 0)))

    def _command(self, command: str) -> None:
        with self._line.lock:
            # An error of before, as any stop leaves one, is not this command's.
            self._line.error()
            self._line.tell(command)
            self._check(command)

    def _check(self, command: str) -> None:
        code = self._line.error()
        if code == STOPPED:
            raise MotionStopped(f"{self.name}: {command!r} was stopped", instrument=self.name, code=str(code))
        if code:
            text = ERRORS.get(code, "see the manual's list of error codes")
            raise InstrumentError(
                f"{self.name}: {command!r} failed with {code} ({text})",
                instrument=self.name,
                code=str(code),
                text=text,
            )

    def _raise_if_stopped(self, command: str, stops: int) -> None:
        if self._stops != stops:
            raise MotionStopped(f"{self.name}: {command!r} was stopped", instrument=self.name)


DRIVER = DriverDeclaration(
    "pi-gcs2",
    contract=1,
    roles=dict.fromkeys(("rotation", "spare"), Use(GcsSettings, PiGcsStage)),
    simulator="simulators.pi_gcs2.declaration:SIMULATOR",
    serial_baud=USUAL_BAUD,
)
