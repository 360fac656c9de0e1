"""In-flight calibration of a differential accelerometer: ten sessions of an inertially pointed, drag-free satellite.

The sessions are those of Hardy et al., "Validation of the in-flight calibration procedures for the MICROSCOPE space
mission" (arXiv 1707.07630). Each looks at one parameter; k2c takes two runs, one for each mass.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from rigctl.campaign.session.recovery import Apparatus
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, ImplausibleSample, LimitError
from rigctl.core.file_tables import Table
from rigctl.core.interfaces import Channel
from rigctl.core.satellites import DragFreeSatellite, FlightSession, Stimulus

SessionName = Literal["dx", "dz", "dx+dz", "dy", "ac12", "ac13", "ad11", "ad12", "ad13", "k2d", "k2c_1", "k2c_2"]
TEN: tuple[SessionName, ...] = ("dx", "dz", "dy", "ac12", "ac13", "ad11", "ad12", "ad13", "k2d", "k2c_1", "k2c_2")

# Far beyond what any satellite does, and near enough for everything that is reckoned from them to stay a number.
Orbits = Annotated[float, Field(ge=1e-2, le=1e3)]
StimulusHz = Annotated[float, Field(ge=1e-7, le=1e3)]
Amplitude = Annotated[float, Field(ge=1e-15, le=1.0)]

TEN_ORBITS_S = 59500.0
STAMP_WITHIN = 1e-2
"""Of a sample period: how exactly a time stamp says which sample it is."""
POSSIBLE = {
    "rad": (-7.0, 7.0),
    "1/s2": (-1e-3, 1e-3),
    "rad/s2": (-1.0, 1.0),
    "K": (0.0, 1000.0),
    "m/s2": (-100.0, 100.0),
}
"""What telemetry can say, by unit: a turn; gradients and accelerations that no orbit and no thruster comes near."""
LINE_WIDTHS = 0.9
"""A stimulus is at least so many inverse durations away from a line of the orbit."""
ORBITAL_LINES = 12

_UNITS = {"drag-free": "m/s2", "attitude": "rad", "none": ""}


class Calibration(Table):
    """The `[procedure]` table of a calibration: `cycles_*` are periods of a stimulus in ten orbits."""

    name: Literal["calibration", "monte-carlo"] = "calibration"
    sessions: tuple[SessionName, ...] = Field(default=TEN, min_length=1)
    orbits: Orbits = 10.0
    orbits_ac12: Orbits = 40.0
    common_m_s2: Amplitude = 5e-8
    common_hz: StimulusHz = 73 / TEN_ORBITS_S
    turn_rad: Amplitude = 1e-2
    turn_hz: StimulusHz = 73 / TEN_ORBITS_S
    displacement_m: Amplitude = 9e-6
    displacement_hz: StimulusHz = 183 / TEN_ORBITS_S
    quadratic_m: Amplitude = 9e-6
    quadratic_hz: StimulusHz = 535 / TEN_ORBITS_S
    phase_rad: float = 0.0

    @field_validator("sessions")
    @classmethod
    def _no_repeats(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(values)) < len(values):
            raise ValueError("has the same session twice")
        return values

    def orbits_of(self, name: str) -> float:
        """How long a session is."""
        return self.orbits_ac12 if name == "ac12" else self.orbits

    def stimulus(self, name: str) -> Stimulus:
        """What a session injects."""
        if name in {"dx", "dz", "dx+dz"}:
            return Stimulus()
        if name == "dy":
            return Stimulus("attitude", "z", self.turn_rad, self.turn_hz, self.phase_rad)
        if name in {"ac12", "ac13"}:
            axis: Literal["y", "z"] = "y" if name == "ac12" else "z"
            return Stimulus("masses", axis, self.displacement_m, self.displacement_hz, self.phase_rad)
        if name in {"k2c_1", "k2c_2"}:
            mass: Literal["mass-1", "mass-2"] = "mass-1" if name == "k2c_1" else "mass-2"
            return Stimulus(mass, "x", self.quadratic_m, self.quadratic_hz, self.phase_rad)
        along: dict[str, Literal["x", "y", "z"]] = {"ad11": "x", "ad12": "y", "ad13": "z", "k2d": "x"}
        return Stimulus("drag-free", along[name], self.common_m_s2, self.common_hz, self.phase_rad)

    def session(self, name: str, orbit_period_s: float) -> FlightSession:
        """A session as the satellite is told it; the mass that moves is not the one that control holds at rest."""
        hold: Literal["both", "mass-1", "mass-2"] = "both"
        if name == "k2c_1":
            hold = "mass-2"
        elif name == "k2c_2":
            hold = "mass-1"
        return FlightSession(self.orbits_of(name) * orbit_period_s, self.stimulus(name), hold)

    def conditions(self, name: str, sample_period_s: float) -> dict[str, Any]:
        """What a run's row in runs.csv says, as far as it is known before."""
        stimulus = self.stimulus(name)
        told: dict[str, Any] = {
            "session": name,
            "orbits": self.orbits_of(name),
            "sample_period_s": sample_period_s,
        }
        if stimulus.target == "none":
            return told
        return {
            **told,
            "calibration_frequency_hz": stimulus.frequency_hz,
            "amplitude": stimulus.amplitude,
            "amplitude_unit": _UNITS.get(stimulus.target, "m"),
            "phase_rad": stimulus.phase_rad,
        }


class MonteCarlo(Calibration):
    """The `[procedure]` table of a Monte Carlo study: how many instruments, on how many cores (0: all there are).

    `scheduler` is the address of a dask scheduler whose workers do it instead. The samples of `kept_draw` are kept;
    -1 for none.
    """

    draws: Annotated[int, Field(ge=1, le=1_000_000)] = 100
    workers: Annotated[int, Field(ge=0, le=1024)] = 0
    scheduler: str = ""
    kept_draw: Annotated[int, Field(ge=-1)] = -1
    expected_m_s2_rthz: Amplitude = 1.2e-12
    """One-sided amplitude density of a sensor's noise along x: white, and 1/f in power below the corner."""
    expected_corner_hz: Annotated[float, Field(ge=0, le=1.0)] = 5e-4
    expected_readout_m_rthz: Annotated[float, Field(ge=0, le=1.0)] = 3e-11

    @model_validator(mode="after")
    def _all_parameters(self) -> Self:
        both = {"dx", "dz"} if "dx+dz" in self.sessions else set()
        if missing := [name for name in TEN if name not in {*self.sessions, *both}]:
            raise ValueError(f"a study scores all ten parameters; add sessions {', '.join(missing)}")
        return self


@dataclass(frozen=True)
class Flight:
    """The satellite, and what is believed of its orbit."""

    satellite: DragFreeSatellite
    orbit_period_s: float
    eccentricity: float


def check(flight: Flight, calibration: Calibration) -> list[str]:
    """What is to be said of the sessions; `ConfigError`, `LimitError` for one that cannot be."""
    remarks = []
    for name in calibration.sessions:
        session = calibration.session(name, flight.orbit_period_s)
        try:
            flight.satellite.check(session)
        except LimitError as error:
            raise LimitError(f"session {name}: {error}") from None
        remarks.extend(_remarks(name, session, flight.orbit_period_s))
    return remarks


def _remarks(name: str, session: FlightSession, orbit_period_s: float) -> list[str]:
    stimulus = session.stimulus
    if stimulus.target == "none":
        return []
    cycles = stimulus.frequency_hz * session.duration_s
    per_orbit = stimulus.frequency_hz * orbit_period_s
    away = abs(per_orbit - round(per_orbit)) * session.duration_s / orbit_period_s
    if cycles < 1.0:
        raise ConfigError(
            f"session {name}: {session.duration_s:g} s is less than one period of its stimulus; record longer"
        )
    if away < LINE_WIDTHS and round(per_orbit) <= ORBITAL_LINES:
        raise ConfigError(
            f"session {name}: {stimulus.frequency_hz:g} Hz is a line of the orbit ({round(per_orbit)} f_orb); "
            f"go at least {LINE_WIDTHS / session.duration_s:.2g} Hz away from it"
        )
    if abs(cycles - round(cycles)) > 1e-3:
        return [
            f"session {name}: {cycles:.3f} periods of the stimulus are no whole number; its line leaks into others"
        ]
    return []


def calibrate(session: Session, flight: Flight, calibration: Calibration) -> None:
    """One run per session; everything is in the session's store."""
    for remark in check(flight, calibration):
        session.event("remark", text=remark)
    for name in calibration.sessions:
        with session.step(f"session {name}"):
            asked = calibration.session(name, flight.orbit_period_s)
            conditions = calibration.conditions(name, flight.satellite.sample_period_s)
            measure = _Recording(session, flight, asked).measure
            session.acquire(name, conditions, measure, Apparatus(others=(flight.satellite,)))


@dataclass(frozen=True)
class _Recording:
    """One session, from telecommand to the last sample."""

    session: Session
    flight: Flight
    asked: FlightSession

    def measure(self, writer: RunWriter) -> Mapping[str, Any]:
        """Record orbit by orbit; a run whose loop does not hold is ended there, and not valid."""
        satellite = self.flight.satellite
        channels = satellite.channels()
        start_s = satellite.begin(self.asked)
        self.session.wait_s(start_s - self.session.clock.now_s())
        period_s = satellite.sample_period_s
        samples, got = round(self.asked.duration_s / period_s), 0
        over_s = start_s + self.asked.duration_s + self.flight.orbit_period_s
        while got < samples:
            self.session.checkpoint()
            left_s = (samples - got) * period_s
            self.session.wait_s(min(left_s, self.flight.orbit_period_s))
            rows = on_grid(satellite.name, satellite.fetch(), got, samples, period_s)
            _require_possible(satellite.name, rows.came, channels, got)
            if flaw := _flaw(rows.came, channels):
                self._write(writer, channels, rows.all)
                return {"start_s": start_s, "valid": False, "reason": flaw}
            if not len(rows.all) and self.session.clock.now_s() > over_s:
                rows = OnGrid(rows.came, gap(got, samples, period_s, len(channels)))
            self._write(writer, channels, rows.all)
            if len(rows.all) > len(rows.came):
                self.session.event("gap", sample=got, samples=len(rows.all) - len(rows.came))
            got += len(rows.all)
        return {"start_s": start_s}

    @staticmethod
    def _write(writer: RunWriter, channels: tuple[Channel, ...], rows: FloatArray) -> None:
        writer.stream({channel.name: rows[:, place] for place, channel in enumerate(channels)})


@dataclass(frozen=True)
class OnGrid:
    """Rows of telemetry that had not come before, and the same with rows for what was lost between them."""

    came: FloatArray
    all: FloatArray


def on_grid(satellite: str, rows: FloatArray, got: int, samples: int, period_s: float) -> OnGrid:
    """Rows by their time stamps, after the first `got` of a session: a packet that comes twice counts once.

    `ImplausibleSample` for stamps that are no sample times, or do not rise.
    """
    with np.errstate(invalid="ignore"):
        places = rows[:, 0] / period_s
        off = ~((np.abs(places - np.rint(places)) < STAMP_WITHIN) & (places > -0.5) & (places < samples + 1.0))
    if off.any():
        raise _stamp(satellite, rows, int(np.argmax(off)), "is no sample time of the session", got)
    numbers = np.rint(places).astype(np.int64)
    new = numbers >= got
    came, numbers = rows[new], numbers[new]
    if len(numbers) and (np.diff(numbers) <= 0).any():
        # The same packet twice within one fetch is as good as once.
        numbers, first = np.unique(numbers, return_index=True)
        twice = came[first[np.searchsorted(numbers, np.rint(came[:, 0] / period_s).astype(np.int64))]]
        if not np.array_equal(twice, came, equal_nan=True):
            raise _stamp(satellite, came, 0, "comes twice, with other values", got)
        came = came[first]
    filled = gap(got, int(numbers[-1]) + 1 if len(numbers) else got, period_s, rows.shape[1])
    filled[numbers - got] = came
    return OnGrid(came, filled)


def _require_possible(satellite: str, rows: FloatArray, channels: tuple[Channel, ...], got: int) -> None:
    """`ImplausibleSample` for what nothing in orbit is; NaN is lost."""
    for place, channel in enumerate(channels[1:], 1):
        low, high = POSSIBLE.get(channel.unit, (-np.inf, np.inf))
        beyond = (rows[:, place] < low) | (rows[:, place] > high)
        if beyond.any():
            sample = int(np.argmax(beyond))
            said = f"{rows[sample, place]:g} {channel.unit} is not possible"
            raise ImplausibleSample(
                f"{satellite}: {channel.name}, sample {got + sample}: {said}",
                channel=channel.name,
                sample=got + sample,
                instrument=satellite,
            )


def gap(first: int, end: int, period_s: float, columns: int) -> FloatArray:
    """Rows of which nothing but the time is known."""
    rows = np.full((end - first, columns), np.nan)
    rows[:, 0] = period_s * np.arange(first, end)
    return rows


def _stamp(satellite: str, rows: FloatArray, place: int, why: str, got: int) -> ImplausibleSample:
    said = f"{satellite}: t_s, sample {got + place}: a time stamp of {rows[place, 0]:g} s {why}"
    return ImplausibleSample(said, channel="t_s", sample=got + place, instrument=satellite)


def _flaw(rows: FloatArray, channels: tuple[Channel, ...]) -> str | None:
    """What says that the loop does not hold; samples that were lost are no flaw."""
    if len(rows) and not np.isfinite(rows[:, 1:]).any():
        return f"nothing comes down from t_s {rows[0, 0]:g} on: telemetry is lost, or the satellite tumbles"
    for place, channel in enumerate(channels):
        column = rows[:, place]
        if channel.full_scale is None:
            continue
        beyond = np.abs(column) >= channel.full_scale
        if beyond.any():
            at_s = rows[int(np.argmax(beyond)), 0]
            return (
                f"{channel.name} leaves its range of {channel.full_scale:g} {channel.unit} at t_s {at_s:g}: "
                "drag-free control does not hold it; correct its gains, or inject less"
            )
    return None
