"""Newport XPS (C8, Q8, D, RL): a rotation stage in a group of its own.

Facts from Newport's programmer's manual and the drivers in public use (newportxps, EPICS motorNewport, ESRF
BLISS). Motion functions block their socket until the motion has ended, so there are two: motions go over
one; angle, status and stop over the other. Where the sources are silent the driver decides:

- A motion that has not ended in time is stopped, never repeated. One that is said to have ended is looked at.
- A home search ignores `GroupMoveAbort`: it is stopped by killing the group, which must then be homed anew.
- Speed and acceleration are set before the first motion, and the user travel limits in the controller must
  reach at least as far as the limits set here.
- A motion that has to take a given time gets the peak speed and acceleration of a cycloid of that length: a
  controller with a trapezoidal law arrives earlier.
"""

from __future__ import annotations

import contextlib
import math
import re
import threading
from collections.abc import Iterator

from pydantic import Field

from drivers.newport_xps_examined import examined
from drivers.newport_xps_group import (
    ABORTED,
    AT_REST,
    DISABLED,
    IN_MOTION,
    NOT_ALLOWED,
    NOT_INITIALISED,
    NOT_REFERENCED,
    ONLY_KILL_STOPS,
    READY,
    XpsGroup,
)
from drivers.newport_xps_socket import FIRMWARE, XpsSocket
from drivers.numbers import plain
from drivers.rotation_settings import RotationSettings
from drivers.transport import Connect
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import (
    BadReply,
    InstrumentError,
    LimitError,
    LinkError,
    LinkTimeout,
    MotionStopped,
    OutOfStep,
    RigError,
    WrongInstrument,
)
from rigctl.core.findings import Finding
from rigctl.core.interfaces import Identity, Reading

REST_POLL_S = 0.02
STANDING_DEG = 1e-3
"""A motion that is shorter is none that could take a time."""


class XpsSettings(RotationSettings):
    """The stage's keys in a rig file."""

    group: str = Field(default="Group1", pattern=r"^[\w-]+$")
    positioner: str = Field(default="Pos", pattern=r"^[\w-]+$")
    """Without the group: `Pos` for `Group1.Pos`."""


class NewportXps:
    """A rotation stage that is the only positioner of its group; angles in degrees."""

    def __init__(self, name: str, settings: XpsSettings, connect: Connect, clock: Clock) -> None:
        self.name = name
        self.limits = settings.limits
        self._settings = settings
        self._group = settings.group
        self._positioner = f"{settings.group}.{settings.positioner}"
        self._clock = clock
        self._motions = XpsSocket(name, connect, settings.link_timeout_s)
        self._queries = XpsSocket(name, connect, settings.link_timeout_s)
        self._wire = XpsGroup(name, settings.group, self._queries, settings.link_timeout_s)
        self._open = False
        self._prepared = False
        # Read from the controller and given back with every profile, as they were tuned for the stage.
        self._jerk_times_s: tuple[float, ...] = ()
        self._profile = (0.0, 0.0)
        self._stops = 0
        # One motion at a time: the second would be answered by -1, busy socket.
        self._one_motion = threading.Lock()
        # Re-entrant, since a signal handler may call `stop` in the thread that is just starting a motion.
        self._starting = threading.RLock()

    # instrument

    def open(self) -> None:
        """Make both connections and check that an XPS answers; moves nothing."""
        self._prepared = False
        try:
            self._queries.open()
            self._motions.open()
            self._open = True
            self.identify()
        except BaseException:
            self.close()
            raise

    def examine(self) -> Iterator[Finding]:
        """Connect and look at names, state, errors and limits; moves nothing."""
        self.open()
        yield from examined(self.identify().text, self._group, self._positioner, self.limits, self._wire)

    def close(self) -> None:
        """Disconnect; may be called twice. A motion goes on."""
        self._open = False
        self._motions.close()
        self._queries.close()

    def identify(self) -> Identity:
        """Model and firmware as `FirmwareVersionGet` tells them; `WrongInstrument` when it is no XPS."""
        request = FIRMWARE
        try:
            reply = self._wire.query(request)
        except BadReply as error:
            raise WrongInstrument(str(error), instrument=self.name) from error
        model = re.search(r"XPS(-\w+)?", reply.text)
        if reply.code != 0 or model is None:
            raise WrongInstrument(
                f"{self.name}: no XPS answers, {request!r} gave {reply.code},{reply.text!r}; check the address",
                instrument=self.name,
                code=str(reply.code),
                text=reply.text,
            )
        version = re.search(r"[Vv]\d[\w.]*", reply.text)
        if version is not None:
            return Identity(model[0], "", version[0], reply.text)
        # An XPS-D has the version of its software in another place (newportxps).
        installed = self._wire.query("InstallerVersionGet(char *)")
        firmware = installed.text if installed.code == 0 else ""
        return Identity(model[0], "", firmware, f"{reply.text} {firmware}".strip())

    def confirm_in_step(self) -> None:
        """`OutOfStep` when replies may have been taken for others, on either connection."""
        self._queries.confirm_in_step()
        self._motions.confirm_unless_busy()

    def stop(self) -> None:
        """Abort a move, kill a homing group; returns when the controller says that the group stands still."""
        # Counted under the lock of the start: a motion either sees this stop or is already on the wire ahead of it.
        with self._starting:
            self._stops += 1
        with self._queries.urgently():
            try:
                self._halt()
            # An abort does no harm when given twice; the second goes over a new connection.
            except LinkError:
                self._halt()
            self._await_rest()

    # rotation stage

    def home(self) -> None:
        """Initialise, enable and find the reference; only what is still to be done of it."""
        stops = self._stops
        with self._one_motion:
            self._prepare()
            status = self._wire.status()
            # Killed first: initialising what is initialised is refused, or a driver fault (RGV100BL).
            if status in NOT_INITIALISED:
                self._move(f"GroupKill({self._group})", stops)
                self._move(f"GroupInitialize({self._group})", stops)
                # Asked again after each step: which steps are left depends on what the last one has led to.
                status = self._wire.status()
            if status in DISABLED:
                self._move(f"GroupMotionEnable({self._group})", stops)
                status = self._wire.status()
            if status == NOT_REFERENCED:
                self._move(f"GroupHomeSearch({self._group})", stops)
                status = self._wire.status()
            if status not in READY:
                raise self._wire.not_ready(status)

    def is_homed(self) -> bool:
        """True when the group is in one of its ready states."""
        return self._wire.status() in READY

    def safety_stop(self) -> str:
        """The group's state, when an emergency signal or an end of run has brought it there."""
        return self._wire.safety_text(self._wire.status())

    def is_moving(self) -> bool:
        """True while the group moves, brakes, homes or is initialised."""
        return self._wire.status() in IN_MOTION

    def move_to(self, angle_deg: float) -> None:
        """Move and return when the controller reports motion done."""
        self.limits.require_angle(self.name, angle_deg)
        self._go(angle_deg, self.limits.speed_deg_s, self.limits.acceleration_deg_s2)

    def turn_to(self, angle_deg: float, duration_s: float) -> None:
        """Move in a time and return when the controller reports motion done.

        `LimitError`, before anything moves, when that takes more speed or acceleration than the limits allow.
        """
        self.limits.require_angle(self.name, angle_deg)
        if not duration_s > 0.0:
            raise LimitError(f"{self.name}: a motion cannot take {duration_s:g} s")
        distance_deg = abs(angle_deg - self.angle().value)
        # Peak speed and acceleration of no distance would be zero, which the controller refuses.
        if distance_deg < STANDING_DEG:
            self.move_to(angle_deg)
            return
        speed_deg_s, acceleration_deg_s2 = cycloid_peaks(distance_deg, duration_s)
        if speed_deg_s > self.limits.speed_deg_s or acceleration_deg_s2 > self.limits.acceleration_deg_s2:
            raise LimitError(
                f"{self.name}: {distance_deg:g} deg in {duration_s:g} s takes {speed_deg_s:.3g} deg/s and "
                f"{acceleration_deg_s2:.3g} deg/s2; the limits are {self.limits.speed_deg_s:g} deg/s and "
                f"{self.limits.acceleration_deg_s2:g} deg/s2"
            )
        self._go(angle_deg, speed_deg_s, acceleration_deg_s2)

    def angle(self) -> Reading:
        """The encoder's angle [deg] half-way between question and answer."""
        asked_s = self._clock.now_s()
        (angle_deg,) = self._wire.numbers(f"GroupPositionCurrentGet({self._group},double *)", 1)
        return Reading(angle_deg, "deg", 0.5 * (asked_s + self._clock.now_s()))

    # what these are made of

    def _go(self, angle_deg: float, speed_deg_s: float, acceleration_deg_s2: float) -> None:
        # Counted before the lock is waited for: a stop of the motion ahead stops this one too.
        stops = self._stops
        with self._one_motion:
            if not self._prepared:
                self._prepare()
            # Two more exchanges only where the profile changes.
            if self._profile != (speed_deg_s, acceleration_deg_s2):
                self._set_profile(speed_deg_s, acceleration_deg_s2)
            request = f"GroupMoveAbsolute({self._group},{plain(angle_deg)})"
            self._move(request, stops)
            self._require_arrived(request, angle_deg)

    def _prepare(self) -> None:
        """Compare the travel limits and set speed and acceleration, keeping the jerk times."""
        # The controller's limits are asked: beyond them it would refuse in the middle of a campaign.
        low_deg, high_deg = self._wire.numbers(
            f"PositionerUserTravelLimitsGet({self._positioner},double *,double *)", 2
        )
        self.limits.require_inside(self.name, low_deg, high_deg, "the user travel limits of the stage")
        outputs = ",".join(["double *"] * 4)
        sgamma = self._wire.numbers(f"PositionerSGammaParametersGet({self._positioner},{outputs})", 4)
        self._jerk_times_s = sgamma[2:]
        self._set_profile(self.limits.speed_deg_s, self.limits.acceleration_deg_s2)
        self._prepared = True

    def _set_profile(self, speed_deg_s: float, acceleration_deg_s2: float) -> None:
        # Speed and acceleration cannot be set without the jerk times.
        parameters = (speed_deg_s, acceleration_deg_s2, *self._jerk_times_s)
        self._wire.succeed(f"PositionerSGammaParametersSet({self._positioner},{','.join(map(plain, parameters))})")
        self._profile = (speed_deg_s, acceleration_deg_s2)

    def _move(self, request: str, stops: int) -> None:
        """Call a function over the motion socket once, unless somebody has stopped us since `stops`."""
        try:
            reply = self._motions.exchange(request, self._settings.motion_timeout_s, self._start(request, stops))
        # Whether the motion began is unknown, so it is stopped; that this fails as well must not hide why.
        except LinkTimeout:
            with contextlib.suppress(RigError):
                self._halt()
            raise
        # A stop of ours shows as -27, or as another error where the group was killed.
        if reply.code == ABORTED or (reply.code < 0 and self._stops != stops):
            raise self._stopped(request, str(reply.code))
        self._wire.check(request, reply)

    def _require_arrived(self, request: str, angle_deg: float) -> None:
        """`OutOfStep` when the reply was not this motion's: all are answered alike, and one may come twice."""
        status, reached_deg = self._wire.status(), self.angle().value
        # The other socket may be heard first, when nothing moves yet: hence also where it stands.
        if status not in IN_MOTION and abs(reached_deg - angle_deg) <= self._settings.arrival_tolerance_deg:
            return
        self._motions.give_up()
        # What goes on is stopped, as where no reply has come; that this fails as well must not hide why.
        with contextlib.suppress(RigError):
            self._halt()
        early = OutOfStep(
            f"{self.name}: {request!r} was answered at {reached_deg:g} deg in state {status}; a reply may have come "
            "twice: it was stopped, measure again"
        )
        early.instrument = self.name
        raise early

    @contextlib.contextmanager
    def _start(self, request: str, stops: int) -> Iterator[None]:
        """No other thread can call `stop` between the look and the start; a signal handler of this one can."""
        with self._starting:
            if self._stops != stops:
                raise self._stopped(request)
            yield
            if self._stops != stops:
                self._halt()

    def _halt(self) -> None:
        request = f"GroupMoveAbort({self._group})"
        reply = self._wire.query(request)
        if reply.code == 0:
            return
        # A home search, motor initialisation or encoder calibration takes no abort.
        if self._wire.status() in ONLY_KILL_STOPS:
            self._wire.succeed(f"GroupKill({self._group})")
        elif reply.code != NOT_ALLOWED:
            raise self._wire.refused(request, reply.code)

    def _await_rest(self) -> None:
        braking_s = self.limits.speed_deg_s / self.limits.acceleration_deg_s2
        deadline_s = self._clock.now_s() + braking_s + self._settings.link_timeout_s
        while (status := self._wire.status()) not in AT_REST:
            if self._clock.now_s() > deadline_s:
                text = self._wire.status_text(status)
                raise InstrumentError(
                    f"{self.name}: {self._group} is not at rest after an abort, it is in state {status} ({text}); "
                    "press the emergency stop and look at the stage",
                    instrument=self.name,
                    code=str(status),
                    text=text,
                )
            self._clock.sleep_s(REST_POLL_S)

    def _stopped(self, request: str, code: str = "") -> MotionStopped:
        return MotionStopped(
            f"{self.name}: {request!r} was stopped", instrument=self.name, code=code, text="motion stopped"
        )


def cycloid_peaks(distance_deg: float, duration_s: float) -> tuple[float, float]:
    """Largest speed and acceleration of a cycloid from rest to rest [deg/s, deg/s2]."""
    return 2.0 * distance_deg / duration_s, 2.0 * math.pi * distance_deg / duration_s**2


DRIVER = DriverDeclaration(
    "newport-xps",
    contract=1,
    roles=dict.fromkeys(("rotation", "spare"), Use(XpsSettings, NewportXps)),
    simulator="simulators.newport_xps.declaration:SIMULATOR",
    port=5001,
)
