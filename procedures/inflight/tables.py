"""The `[procedure]` tables of in-flight campaigns: which sessions, with which stimulus, and how many draws."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from rigctl.core.file_tables import Table
from rigctl.core.satellites import FlightSession, Stimulus
from rigctl.experiments.inflight.observe.sessions import EQUIVALENCE, GRADIENT, SESSIONS, SessionName

TEN = tuple(name for name in SESSIONS if name != "dx+dz" and name not in EQUIVALENCE)

# Far beyond what any satellite does, and small enough for everything computed from them to stay finite.
Orbits = Annotated[float, Field(ge=1e-2, le=1e3)]
StimulusHz = Annotated[float, Field(ge=1e-7, le=1e3)]
Amplitude = Annotated[float, Field(ge=1e-15, le=1.0)]

# Of 5950 s. Frequencies with a whole number of periods in them leak into no other line.
TEN_ORBITS_S = 59500.0
_UNITS = {"drag-free": "m/s2", "attitude": "rad", "none": ""}


class SessionStimulus(Table):
    """`[procedure.stimuli.SESSION]`: what one session injects in place of what the others of its kind do."""

    amplitude: Amplitude | None = None
    frequency_hz: StimulusHz | None = None
    phase_rad: float | None = None


class Calibration(Table):
    """The `[procedure]` table of a calibration."""

    name: Literal["calibration", "monte-carlo"] = "calibration"
    sessions: tuple[SessionName, ...] = Field(default=TEN, min_length=1)
    orbits: Orbits = 10.0
    orbits_ac12: Orbits = 40.0
    orbits_ep: Orbits = 20.0
    spin_hz: Annotated[float, Field(gt=0, le=1e-2)] = 17.5 / 5950.0
    common_m_s2: Amplitude = 5e-8
    common_hz: StimulusHz = 73 / TEN_ORBITS_S
    turn_rad: Amplitude = 1e-2
    turn_hz: StimulusHz = 73 / TEN_ORBITS_S
    displacement_m: Amplitude = 9e-6
    displacement_hz: StimulusHz = 183 / TEN_ORBITS_S
    quadratic_m: Amplitude = 9e-6
    quadratic_hz: StimulusHz = 535 / TEN_ORBITS_S
    phase_rad: float = 0.0
    stimuli: dict[SessionName, SessionStimulus] = {}

    @field_validator("sessions")
    @classmethod
    def _no_repeats(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(values)) < len(values):
            raise ValueError("has the same session twice")
        return values

    def orbits_of(self, name: str) -> float:
        """How long a session is."""
        orbits: float = getattr(self, self.orbits_key(name))
        return orbits

    @staticmethod
    def orbits_key(name: str) -> str:
        """Which key says how long a session is."""
        if name in EQUIVALENCE:
            return "orbits_ep"
        return "orbits_ac12" if name == "ac12" else "orbits"

    @field_validator("stimuli")
    @classmethod
    def _of_stimulated(cls, values: dict[str, SessionStimulus]) -> dict[str, SessionStimulus]:
        if without := [name for name in values if name in (*GRADIENT, *EQUIVALENCE)]:
            raise ValueError(f"session {without[0]} injects nothing; leave its stimulus out")
        return values

    def stimulus(self, name: SessionName) -> Stimulus:
        """What a session injects."""
        special = self.stimuli.get(name, SessionStimulus())
        return replace(self._usual_stimulus(name), **special.model_dump(exclude_none=True))

    def _usual_stimulus(self, name: SessionName) -> Stimulus:
        """What sessions of its kind inject."""
        if name in (*GRADIENT, *EQUIVALENCE):
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

    def session(self, name: SessionName, orbit_period_s: float) -> FlightSession:
        """A session as the satellite is commanded; the mass that moves is not the one that control holds at rest."""
        hold: Literal["both", "mass-1", "mass-2"] = "both"
        if name == "k2c_1":
            hold = "mass-2"
        elif name == "k2c_2":
            hold = "mass-1"
        return FlightSession(self.orbits_of(name) * orbit_period_s, self.stimulus(name), hold, self.spin_of(name))

    def spin_of(self, name: SessionName) -> float:
        """How fast a session turns, Hz."""
        return self.spin_hz if name == "ep_spin" else 0.0

    def conditions(self, name: SessionName, sample_period_s: float) -> dict[str, Any]:
        """What a run's row in runs.csv says, as far as it is known before."""
        stimulus = self.stimulus(name)
        conditions: dict[str, Any] = {
            "session": name,
            "orbits": self.orbits_of(name),
            "sample_period_s": sample_period_s,
        }
        if spin_hz := self.spin_of(name):
            conditions["spin_frequency_hz"] = spin_hz
        if stimulus.target == "none":
            return conditions
        return {
            **conditions,
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
