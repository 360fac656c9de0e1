"""The controller behind its line: one axis, one error, any number of clients.

After the C-863.12 user manual (MS249E, chapter 8); RON, POS and DFH after the maker's PIPython.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from simulators.clock import SimulationClock
from simulators.faults.mishaps import FollowingError, PowerCycle
from simulators.faults.when import Event
from simulators.measured import Tap, unheard
from simulators.motion import MotionAxis
from simulators.pi_gcs2.settings import Gcs2SimulatorSettings
from simulators.wiring import Connection

SYNTAX, UNKNOWN, NO_REFERENCE, OUT_OF_LIMITS, TOO_FAST, STOPPED, NO_AXIS, OUT_OF_RANGE, COUNT = (
    1, 2, 5, 7, 8, 10, 15, 17, 24,
)  # fmt: skip
MOTION_ERROR, REFERENCING_DISABLED = 1024, 50
MOVING, READY, STOP = "\x05", "\x07", "\x18"
_SINGLE = re.compile(f"([{MOVING}{READY}{STOP}])".encode())
"""What is a command by itself, without a line end and wherever it comes."""
IS_READY = "\xb1"
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)


class Refused(Exception):
    """Not done; `code` is what ERR? tells."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class SimulatedGcs2:
    """A controller whose axis is `motion`, in degrees; it wakes up with its servo off and not referenced."""

    kind = "pi-gcs2"
    baud = 115200

    def __init__(
        self,
        clock: SimulationClock,
        motion: MotionAxis,
        settings: Gcs2SimulatorSettings | None = None,
        tap: Tap | None = None,
    ) -> None:
        self.clock = clock
        self._motion = motion
        self._settings = settings or Gcs2SimulatorSettings()
        self._tap = tap or unheard()
        self._off = False
        self._servo = self._referenced = False
        self._wake()
        self._of_controller: dict[str, Callable[[], str]] = {
            MOVING: lambda: f"{int(self._moving()):X}",
            READY: lambda: IS_READY,
            "*IDN?": lambda: self._settings.identity,
            "CSV?": lambda: "2.0",
            "ERR?": self._take_error,
            "SAI?": lambda: self._settings.axis,
            "SAI? ALL": lambda: self._settings.axis,
            "HLP?": self._help,
        }
        self._queries: dict[str, Callable[[], str]] = {
            "POS": lambda: self._number(self._reading_deg()),
            "MOV": lambda: self._number(self._target_deg),
            "ONT": lambda: str(int(self._on_target())),
            "SVO": lambda: str(int(self._servo)),
            "FRF": lambda: str(int(self._referenced)),
            "RON": lambda: str(int(self._by_search)),
            "DFH": lambda: self._number(self._home_deg),
            # The stage has a switch at its reference, and at each end (EPICS' PIGCSController.cpp asks).
            "TRS": lambda: "1",
            "LIM": lambda: "1",
            "TMN": lambda: self._number(self._settings.travel_min_deg),
            "TMX": lambda: self._number(self._settings.travel_max_deg),
            "VEL": lambda: self._number(self._speed_deg_s),
            "ACC": lambda: self._number(self._acceleration_deg_s2),
            "DEC": lambda: self._number(self._acceleration_deg_s2),
        }
        if self._settings.dialect.tells_unit:
            self._queries["PUN"] = lambda: self._settings.unit
        self._commands: dict[str, Callable[[float], None]] = {
            "MOV": self._move,
            "MVR": lambda step_deg: self._move(self._target_deg + step_deg),
            "SVO": self._switch,
            "RON": self._choose_reference,
            "POS": self._say_position,
            "VEL": self._set_speed,
            "ACC": self._set_acceleration,
            "DEC": self._set_acceleration,
        }

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client."""
        return Client(self, send)

    def befall(self, event: Event) -> None:
        """Something happens to the controller and its stage."""
        self._find()
        match event:
            case PowerCycle():
                self._off = True
                self._brake(self._settings.acceleration_max_deg_s2)
            case FollowingError():
                self.fail_following(1)

    def relieve(self, event: Event) -> None:
        """It is over: as after switching on."""
        if isinstance(event, PowerCycle):
            self._off = False
            self._wake()

    def fail_following(self, _: int) -> None:
        """An obstacle: the servo switches itself off."""
        if self._servo:
            self._error = MOTION_ERROR
            self._servo = False
            self._brake(self._settings.acceleration_max_deg_s2)

    def answer(self, line: str) -> str | None:
        """What a line is answered; None for nothing."""
        if self._off:
            return None
        self._find()
        try:
            return self._execute(line.strip())
        except Refused as refused:
            self._error = refused.code
            return None

    def _wake(self) -> None:
        now_s = self.clock.now_s()
        self._error = 0
        self._servo = self._referenced = False
        self._by_search = True
        self._home_deg: float = 0.0
        self._zero_deg = self._motion.position(now_s)
        self._target_deg: float = 0.0
        self._busy_until_s = -math.inf
        self._found_at_s = math.inf
        self._speed_deg_s: float = 10.0
        self._acceleration_deg_s2: float = 40.0

    def _execute(self, line: str) -> str | None:
        words = line.upper().split()
        if (tell := self._of_controller.get(" ".join(words))) is not None:
            return tell()
        match words:
            case []:
                return None
            case ["\x18"] | ["STP"] | ["HLT", *_]:
                self._stop()
                return None
            case [query, *axes] if query.endswith("?"):
                return self._tell(query[:-1], axes)
            case ["FRF", axis]:
                self._require_axis(axis)
                self._refer()
                return None
            case ["DFH", axis]:
                self._require_axis(axis)
                self._home_deg += self._position_deg()
                self._count_from(0.0)
                return None
            case [command, axis, value] if command in self._commands:
                self._require_axis(axis)
                self._commands[command](_value(value))
                return None
        raise Refused(COUNT if words[0] in {*self._commands, "FRF", "DFH"} else UNKNOWN)

    def _take_error(self) -> str:
        code, self._error = self._error, 0
        return str(code)

    def _help(self) -> str:
        others = ["#5", "#7", "#24", "*IDN?", "CSV?", "DFH", "ERR?", "FRF", "HLP?", "HLT", "SAI?", "STP"]
        lines = sorted([*others, *self._commands, *(f"{query}?" for query in self._queries)])
        # A line that is followed by another ends with a space.
        return " \n".join(["The following commands are valid:", *lines, "end of help"])

    def _tell(self, query: str, axes: list[str]) -> str:
        if query not in self._queries:
            raise Refused(UNKNOWN)
        for axis in axes:
            self._require_axis(axis)
        return f"{self._settings.axis}={self._queries[query]()}"

    def _require_axis(self, axis: str) -> None:
        if axis != self._settings.axis.upper():
            raise Refused(NO_AXIS)

    # the axis

    def _moving(self) -> bool:
        return self.clock.now_s() < self._busy_until_s

    def _on_target(self) -> bool:
        settled_s = self._busy_until_s + self._settings.dialect.settle_s
        there = abs(self._position_deg() - self._target_deg) < 1e-3
        return self._servo and there and self.clock.now_s() >= settled_s

    def _position_deg(self) -> float:
        return self._motion.position(self.clock.now_s()) - self._zero_deg

    def _reading_deg(self) -> float:
        step_deg = self._settings.resolution_deg
        reading_deg = round(self._position_deg() / step_deg) * step_deg
        now_s = self.clock.now_s()
        self._tap.note("position", now_s, reading_deg)
        self._tap.note("true position", now_s, self._motion.position(now_s))
        return reading_deg

    def _move(self, target_deg: float) -> None:
        if not (self._servo and self._referenced):
            raise Refused(NO_REFERENCE)
        if not self._settings.travel_min_deg <= target_deg <= self._settings.travel_max_deg:
            raise Refused(OUT_OF_LIMITS)
        self._target_deg = target_deg
        self._go(target_deg + self._zero_deg, self._speed_deg_s)

    def _refer(self) -> None:
        if not self._servo:
            raise Refused(NO_REFERENCE)
        if not self._by_search:
            raise Refused(REFERENCING_DISABLED)
        self._referenced, self._home_deg = False, 0.0
        now_s = self.clock.now_s()
        self._go(0.0, self._settings.reference_speed_deg_s)
        self._busy_until_s = max(self._busy_until_s, now_s + self._settings.reference_s)
        self._found_at_s = self._busy_until_s

    def _find(self) -> None:
        # Not by an appointment with the clock: who sees the search at its end has to see its outcome as well.
        if self.clock.now_s() >= self._found_at_s:
            self._found_at_s = math.inf
            self._zero_deg, self._target_deg, self._referenced = 0.0, 0.0, True

    def _choose_reference(self, value: float) -> None:
        if value not in (0.0, 1.0):
            raise Refused(OUT_OF_RANGE)
        self._by_search = bool(value)

    def _say_position(self, position_deg: float) -> None:
        # Only where the reference is not searched (PIPython, POS); with which error else is not known.
        if self._by_search:
            raise Refused(OUT_OF_RANGE)
        self._count_from(position_deg)
        self._referenced = True

    def _count_from(self, position_deg: float) -> None:
        self._zero_deg = self._motion.position(self.clock.now_s()) - position_deg
        self._target_deg = position_deg

    def _go(self, place_deg: float, speed_deg_s: float) -> None:
        self._found_at_s = math.inf
        now_s = self.clock.now_s()
        start_s = now_s
        if self._motion.moving(now_s):
            start_s = self._motion.halt(now_s, self._acceleration_deg_s2)
        self._busy_until_s = self._motion.move_to(start_s, place_deg, speed_deg_s, self._acceleration_deg_s2)

    def _switch(self, value: float) -> None:
        if value not in (0.0, 1.0):
            raise Refused(OUT_OF_RANGE)
        if not value and self._moving():
            self._brake(self._settings.acceleration_max_deg_s2)
        self._servo = bool(value)

    def _stop(self) -> None:
        self._brake(self._settings.acceleration_max_deg_s2)
        self._error = STOPPED

    def _brake(self, deceleration_deg_s2: float) -> None:
        self._found_at_s = math.inf
        now_s = self.clock.now_s()
        self._busy_until_s = now_s
        # Not by its velocity: a motion that begins at this very instant has none yet.
        if self._motion.moving(now_s):
            self._busy_until_s = self._motion.halt(now_s, deceleration_deg_s2)
        # Where it comes to rest is where it shall be.
        self._target_deg = self._motion.position(self._busy_until_s) - self._zero_deg

    def _set_speed(self, value: float) -> None:
        if not 0.0 < value <= self._settings.speed_max_deg_s:
            raise Refused(TOO_FAST)
        self._speed_deg_s = value

    def _set_acceleration(self, value: float) -> None:
        if not 0.0 < value <= self._settings.acceleration_max_deg_s2:
            raise Refused(OUT_OF_RANGE)
        self._acceleration_deg_s2 = value

    def _number(self, value: float) -> str:
        # Adding zero takes the sign off a zero.
        return f"{value + 0.0:.9e}" if self._settings.dialect.numbers == "exponent" else f"{value + 0.0:.6f}"


def _value(word: str) -> float:
    if _NUMBER.fullmatch(word) is None or not math.isfinite(value := float(word)):
        raise Refused(SYNTAX)
    return value


class Client:
    """The controller's end of one connection."""

    def __init__(self, controller: SimulatedGcs2, send: Callable[[bytes], None]) -> None:
        self._controller = controller
        self._send = send
        self._received = b""

    def receive(self, data: bytes) -> None:
        """Take bytes: lines, and single characters that need no line end."""
        with self._controller.clock.lock:
            for piece in _SINGLE.split(data):
                if _SINGLE.fullmatch(piece):
                    self._answer(piece)
                    continue
                *lines, self._received = (self._received + piece).split(b"\n")
                for line in lines:
                    self._answer(line)

    def _answer(self, line: bytes) -> None:
        if (reply := self._controller.answer(line.decode("latin-1"))) is not None:
            self._send(reply.encode("latin-1") + b"\n")

    def close(self) -> None:
        """The client has gone."""
        with self._controller.clock.lock:
            self._send = lambda _: None
