"""A drag-free satellite by its ground segment: telecommands are checked against limits, telemetry is handed on.

There is no wire format here: a ground segment is an object of Python that takes telecommands and gives telemetry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Protocol, cast

from pydantic import BaseModel, ConfigDict, Field

from drivers.transport import Connect
from rigctl.core.arrays import FloatArray
from rigctl.core.clock import Clock
from rigctl.core.declarations import DriverDeclaration, Use
from rigctl.core.errors import LimitError, LinkLost, WrongInstrument
from rigctl.core.interfaces import Channel, Identity
from rigctl.core.satellites import FlightSession, Stimulus

KIND = "drag-free satellite"

_UNITS = {"m": "m/s2", "t": "1/s2", "dw": "rad/s2", "att": "rad", "command": "m/s2", "g": "m/s2", "temperature": "K"}
_KINDS = {
    "m": "accelerometer",
    "t": "gradient",
    "dw": "angular acceleration",
    "att": "angle",
    "command": "thrust",
    "g": "gravity",
}


class Link(Protocol):
    """What a ground segment offers."""

    identity: Mapping[str, str]
    columns: tuple[str, ...]

    @property
    def sample_period_s(self) -> float:
        """Of the telemetry."""
        ...

    def begin(self, command: Mapping[str, Any]) -> float:
        """Uplink a session; the rig time of the perigee it begins at."""
        ...

    def fetch(self) -> FloatArray:
        """What came down since the last call."""
        ...

    def end(self) -> None:
        """Stop a session."""
        ...


class SatelliteLimits(BaseModel):
    """How far a stimulus may go: beyond, sensors and loops are no longer what a calibration takes them for."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    acceleration_max_m_s2: float = Field(default=2e-7, gt=0.0)
    attitude_max_rad: float = Field(default=2e-2, gt=0.0)
    displacement_max_m: float = Field(default=2e-5, gt=0.0)
    frequency_max_hz: float = Field(default=2e-2, gt=0.0)
    range_m_s2: float = Field(default=1e-6, gt=0.0)
    """Largest acceleration that is measured."""


class GroundSegment:
    """Telecommand and telemetry of one satellite (`DragFreeSatellite`)."""

    def __init__(self, name: str, settings: SatelliteLimits, connect: Connect, clock: Clock) -> None:
        # Telemetry brings its own time; all drivers are made with a clock.
        del clock
        self.name = name
        self.settings = settings
        self._connect = connect
        self._link: Link | None = None

    def open(self) -> None:
        """Look whether a satellite answers."""
        link = cast(Link, self._connect())
        self._expect_satellite(link)
        self._link = link

    def close(self) -> None:
        """Hear no more."""
        self._link = None

    def identify(self) -> Identity:
        """Who it is."""
        identity = self._there().identity
        return Identity(
            identity["model"], identity["serial"], identity["firmware"], f"{identity['model']} {identity['serial']}"
        )

    def confirm_in_step(self) -> None:
        """The satellite still answers as itself; telemetry has its own time in every row, and no replies."""
        self._expect_satellite(self._there())

    def stop(self) -> None:
        """Inject nothing more."""
        # A stop must work before `open` too.
        (self._link or cast(Link, self._connect())).end()

    @property
    def sample_period_s(self) -> float:
        """Between two rows of telemetry."""
        return self._there().sample_period_s

    def channels(self) -> tuple[Channel, ...]:
        """`t_s` and what is measured with it."""
        return tuple(self._channel(name) for name in cast(Link, self._connect()).columns)

    def check(self, session: FlightSession) -> None:
        """`LimitError` for what is beyond the limits."""
        stimulus, limits = session.stimulus, self.settings
        if stimulus.target == "none":
            return
        most, unit = {
            "drag-free": (limits.acceleration_max_m_s2, "m/s2"),
            "attitude": (limits.attitude_max_rad, "rad"),
        }.get(stimulus.target, (limits.displacement_max_m, "m"))
        if not 0.0 < abs(stimulus.amplitude) <= most:
            raise LimitError(
                f"{self.name}: a {_named(stimulus)} of {stimulus.amplitude:g} {unit} is refused; "
                f"the linear range ends at {most:g} {unit}"
            )
        if not 0.0 < stimulus.frequency_hz <= limits.frequency_max_hz:
            raise LimitError(
                f"{self.name}: a {_named(stimulus)} at {stimulus.frequency_hz:g} Hz is refused; "
                f"the loops follow up to {limits.frequency_max_hz:g} Hz"
            )

    def begin(self, session: FlightSession) -> float:
        """Uplink a session; the rig time of its first perigee."""
        self.check(session)
        command = {
            "duration_s": session.duration_s,
            "hold": session.hold,
            "spin_hz": session.spin_hz,
            **asdict(session.stimulus),
        }
        return self._there().begin(command)

    def fetch(self) -> FloatArray:
        """The rows that came down since the last call."""
        return self._there().fetch()

    def _channel(self, name: str) -> Channel:
        if name == "t_s":
            return Channel(name, "s", "time")
        stem = name.split("_", 1)[0].rstrip("12")
        full_scale = self.settings.range_m_s2 if stem == "m" else None
        return Channel(name, _UNITS[stem], _KINDS.get(stem, stem), full_scale=full_scale)

    def _expect_satellite(self, link: Link) -> None:
        if link.identity.get("model") != KIND:
            raise WrongInstrument(
                f"{self.name}: {link.identity.get('model')} answers, no {KIND}", instrument=self.name
            )

    def _there(self) -> Link:
        if self._link is None:
            raise LinkLost(f"{self.name}: not open; open the rig first")
        return self._link


def _named(stimulus: Stimulus) -> str:
    return {"drag-free": "common acceleration", "attitude": "turn"}.get(stimulus.target, "displacement of masses")


DRIVER = DriverDeclaration(
    "drag-free-satellite",
    contract=1,
    roles={"satellite": Use(SatelliteLimits, GroundSegment)},
    simulator="simulators.worlds.satellite.declaration:SIMULATOR",
    wired=False,
)
