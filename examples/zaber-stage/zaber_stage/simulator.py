"""A Zaber device with one linear axis, as its serial line shows it; written from the manual, not from the driver."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from pydantic import BaseModel, ConfigDict, Field

from simulators.clock import SimulationClock
from simulators.declaration import SimulatorDeclaration, Site, Spec, position_columns
from simulators.faults.mishaps import FollowingError, PowerCycle
from simulators.faults.when import Event
from simulators.measured import Tap, unheard
from simulators.motion import MotionAxis
from simulators.wiring import Connection

_LINE = re.compile(r"/(?:(\d{1,2}) ?)?(?:(\d) ?)?(?:(\d{1,2}) ?)?(.*)", re.ASCII)
_WHOLE = re.compile(r"-?\d{1,10}", re.ASCII)
_TENTHS = re.compile(r"\d{1,9}(\.\d)?", re.ASCII)
LINE_MAX = 80
BRAKE_MM_S2 = 1e4
"""Of a stalled stage, and of one without power."""


class ZaberSimulatorSettings(BaseModel):
    """The simulated device; the defaults are an X-LSM050A."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    device: int = Field(default=1, ge=1, le=99)
    device_id: int = 50081
    serial: int = 12345
    version: str = "7.38"
    microstep_mm: float = Field(default=4.7625e-5, gt=0)
    travel_mm: float = Field(default=50.8, gt=0)
    home_mm: float = -25.4
    """Where the home sensor is, in the world's coordinate."""
    home_speed_mm_s: float = Field(default=10.0, gt=0)


class Refused(Exception):
    """A command that is rejected, with the reason as the manual names it."""


class SimulatedZaber:
    """The device: a position counted in microsteps, flags, and settings."""

    kind = "zaber-linear"

    def __init__(
        self, clock: SimulationClock, axis: MotionAxis, settings: ZaberSimulatorSettings, tap: Tap | None = None
    ) -> None:
        self.clock = clock
        self.settings = settings
        self._axis = axis
        self._tap = tap or unheard()
        self.written = {"comm.checksum": 0, "maxspeed": 153600, "accel": 205}
        self._power_on()

    def connect(self, send: Callable[[bytes], None]) -> Connection:
        """Serve one more client."""
        return ZaberClient(self, send)

    def befall(self, event: Event) -> None:
        """It stalls, or loses its power."""
        self._find()
        moving = self.busy
        if isinstance(event, PowerCycle | FollowingError):
            self._axis.halt(self.clock.now_s(), BRAKE_MM_S2)
            self._found_at_s = math.inf
        if isinstance(event, FollowingError) and moving:
            self.flags |= {"FS"}

    def relieve(self, event: Event) -> None:
        """Power comes back; the reference does not."""
        if isinstance(event, PowerCycle):
            self._power_on()

    @property
    def busy(self) -> bool:
        """True while it moves."""
        return self._axis.moving(self.clock.now_s())

    def raised(self) -> frozenset[str]:
        """The flags that are on."""
        self._find()
        return frozenset(self.flags)

    def answer(self, words: list[str], axis: str) -> str:
        """Carry out a command; what comes back. Raises `Refused`."""
        self._find()
        if axis not in ("0", "1"):
            raise Refused("BADAXIS")
        return self._carry_out(words)

    def _carry_out(self, words: list[str]) -> str:
        match words:
            case []:
                return "0"
            case ["get", key]:
                return self._get(key)
            case ["set", key, value] if key in self.written and _WHOLE.fullmatch(value):
                self.written[key] = int(value)
                return "0"
            case ["set", *_]:
                raise Refused("BADDATA" if words[1:2] and words[1] in self.written else "BADCOMMAND")
            case ["warnings"]:
                return " ".join([f"{len(self.flags):02d}", *sorted(self.flags)])
            case ["stop"]:
                self._interrupt()
                self._axis.halt(self.clock.now_s(), self._acceleration_mm_s2())
                return "0"
            case ["home"]:
                self._home()
                return "0"
            case ["move", *motion]:
                self._move(motion)
                return "0"
        raise Refused("BADCOMMAND")

    def _power_on(self) -> None:
        """Without a reference it takes itself to be at the far end."""
        self._found_at_s = math.inf
        self.flags = {"WR"}
        self._zero_mm = self._axis.position(self.clock.now_s()) - self.settings.travel_mm

    def _get(self, key: str) -> str:
        s = self.settings
        fixed = {"deviceid": str(s.device_id), "system.serial": str(s.serial), "version": s.version, "limit.min": "0"}
        if key in fixed:
            return fixed[key]
        match key:
            case "limit.max":
                return str(self._limit_max())
            case "pos":
                now_s = self.clock.now_s()
                true_mm = self._axis.position(now_s)
                position = round((true_mm - self._zero_mm) / s.microstep_mm)
                self._tap.note("position", now_s, position * s.microstep_mm)
                self._tap.note("true position", now_s, true_mm)
                return str(position)
            case _ if key in self.written:
                return str(self.written[key])
        raise Refused("BADCOMMAND")

    def _limit_max(self) -> int:
        return round(self.settings.travel_mm / self.settings.microstep_mm)

    def _speed_mm_s(self) -> float:
        return max(self.written["maxspeed"], 1) / 1.6384 * self.settings.microstep_mm

    def _acceleration_mm_s2(self) -> float:
        return max(self.written["accel"], 1) / 1.6384 * 1e4 * self.settings.microstep_mm

    def _interrupt(self) -> None:
        self._found_at_s = math.inf
        self.flags -= {"FS"}

    def _home(self) -> None:
        self._interrupt()
        self._brake_at_once()
        s, now_s = self.settings, self.clock.now_s()
        self._found_at_s = self._axis.move_to(now_s, s.home_mm, s.home_speed_mm_s, self._acceleration_mm_s2())

    def _find(self) -> None:
        # Not by an appointment with the clock: who sees the search at its end has to see its outcome as well.
        if self.clock.now_s() >= self._found_at_s:
            self._found_at_s = math.inf
            self.flags -= {"WR"}
            self._zero_mm = self.settings.home_mm

    def _move(self, motion: list[str]) -> None:
        if "WR" in self.flags:
            raise Refused("BADDATA")
        match motion:
            case ["abs", target] if _WHOLE.fullmatch(target):
                target_mm = self._place(int(target))
                self._interrupt()
                self._brake_at_once()
                self._axis.move_to(self.clock.now_s(), target_mm, self._speed_mm_s(), self._acceleration_mm_s2())
            case ["sin", amplitude, period, cycles] if _WHOLE.fullmatch(amplitude) and _TENTHS.fullmatch(period):
                self._swing(int(amplitude), 1e-3 * float(period), int(cycles) if cycles.isdigit() else 0)
            case ["abs" | "sin", *_]:
                raise Refused("BADDATA")
            case _:
                raise Refused("BADCOMMAND")

    def _swing(self, amplitude: int, period_s: float, cycles: int) -> None:
        if self.busy:
            raise Refused("STATUSBUSY")
        if not amplitude or period_s < 2e-4 or cycles < 1:
            raise Refused("BADDATA")
        self._place(int(self._get("pos")) + 2 * amplitude)
        self._interrupt()
        amplitude_mm = amplitude * self.settings.microstep_mm
        self._axis.oscillate(self.clock.now_s(), 1.0 / period_s, [amplitude_mm], cycles)

    def _place(self, position: int) -> float:
        """A position as a place in the world [mm]; refused beyond the limits."""
        if not 0 <= position <= self._limit_max():
            raise Refused("BADDATA")
        return position * self.settings.microstep_mm + self._zero_mm

    def _brake_at_once(self) -> None:
        """A new motion begins from rest."""
        now_s = self.clock.now_s()
        if self.busy:
            self._axis.place(now_s, self._axis.position(now_s))


class ZaberClient:
    """One end of the serial line."""

    def __init__(self, device: SimulatedZaber, send: Callable[[bytes], None]) -> None:
        self._device = device
        self._send = send
        self._pending = ""

    def receive(self, data: bytes) -> None:
        """Take bytes; complete commands are answered at once."""
        with self._device.clock.lock:
            *lines, rest = re.split(r"[\r\n]+", self._pending + data.decode("latin-1"))
            self._pending = rest[: LINE_MAX + 1]
            for line in lines:
                self._hear(line)

    def close(self) -> None:
        """The client has gone."""
        self._pending = ""

    def _hear(self, line: str) -> None:
        """A command with a wrong sum, or for another device, is not answered."""
        text, colon, given = line.partition(":")
        if colon and given != _lrc(text[1:]):
            return
        match = _LINE.fullmatch(text) if len(line) <= LINE_MAX else None
        if match is None or int(match[1] or 0) not in (0, self._device.settings.device):
            return
        self._send(self._reply(match[2] or "0", match[3], match[4]))

    def _reply(self, axis: str, number: str | None, words: str) -> bytes:
        device = self._device
        try:
            verdict, data = "OK", device.answer(words.split(), axis)
        except Refused as refused:
            verdict, data = "RJ", str(refused)
        message = "" if number is None else f"{int(number):02d} "
        state, flag = "BUSY" if device.busy else "IDLE", min(device.raised(), default="--")
        text = f"{device.settings.device:02d} {axis} {message}{verdict} {state} {flag} {data}"
        total = f":{_lrc(text)}" if device.written["comm.checksum"] else ""
        return f"@{text}{total}\r\n".encode("latin-1")


def _lrc(text: str) -> str:
    """The longitudinal redundancy check of the manual's appendix: all bits of the sum turned, plus one."""
    return f"{((sum(map(ord, text)) & 0xFF ^ 0xFF) + 1) & 0xFF:02X}"


def _build(spec: Spec, site: Site, settings: ZaberSimulatorSettings) -> SimulatedZaber:
    return SimulatedZaber(site.clock, site.axis(spec.role), settings, site.tap)


SIMULATOR = SimulatorDeclaration(
    ZaberSimulatorSettings,
    _build,
    frozenset({"power_cycle", "following_error"}),
    columns=lambda _: position_columns("stage_x_mm"),
)
