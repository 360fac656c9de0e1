"""The sessions of an in-flight calibration: what was injected, and at which lines it is looked for.

Pointing is inertial, so the gravity gradient has its strong lines at twice the orbital frequency. The source is Hardy
et al., "Validation of the in-flight calibration procedures for the MICROSCOPE space mission" (arXiv 1707.07630).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError

SessionName = Literal[
    "dx",
    "dz",
    "dx+dz",
    "dy",
    "ac12",
    "ac13",
    "ad11",
    "ad12",
    "ad13",
    "k2d",
    "k2c_1",
    "k2c_2",
    "ep_inertial",
    "ep_spin",
]
SESSIONS: tuple[SessionName, ...] = get_args(SessionName)
GRADIENT = ("dx", "dz", "dx+dz")
"""Sessions without an injected signal: the gradient's own line is used."""

EQUIVALENCE = ("ep_inertial", "ep_spin")
"""Sessions of the test itself, inertial and turning; they calibrate nothing."""

CALIBRATION = tuple(name for name in SESSIONS if name not in EQUIVALENCE)

MASS_MOTION = ("ac12", "ac13")
LINEAR = ("ad11", "ad12", "ad13", "k2d")
QUADRATIC = ("k2c_1", "k2c_2")

FEWEST_ORBITS = 3.0
"""The least length of a stretch: shorter ones do not resolve the lines beside the stimulus."""

HALVES = 2
"""A calibration's runs are also looked at in so many stretches."""

FEWEST_TEST_ORBITS = 8.0
"""The least length of a session of the test itself."""


def fewest_orbits(name: str) -> float:
    """How long a session has to be for its run to be used."""
    return FEWEST_TEST_ORBITS if name in EQUIVALENCE else HALVES * FEWEST_ORBITS


@dataclass(frozen=True)
class Line:
    """A line of the spectrum at `harmonic` times the stimulus frequency plus `orbital` times that of the orbit."""

    harmonic: int
    orbital: int

    @property
    def name(self) -> str:
        """As "f + 2 f_orb"; "drift" for what has no frequency."""
        if self == DRIFT:
            return "drift"
        stimulus = {0: "", 1: "f"}.get(self.harmonic, f"{self.harmonic} f")
        count = abs(self.orbital)
        orbit = {0: "", 1: "f_orb"}.get(count, f"{count} f_orb")
        if stimulus and orbit:
            return f"{stimulus} {'-' if self.orbital < 0 else '+'} {orbit}"
        return stimulus or orbit


ORBITAL = tuple(Line(0, k) for k in (1, 2, 3, 4))
STIMULUS = Line(1, 0)
DRIFT = Line(0, 0)
"""What is slower than the orbit: slope and bend of a stretch with gaps stand at its place, for cosine and sine."""


@dataclass(frozen=True)
class Session:
    """What is known of one run beforehand.

    The injected signal is `amplitude` cos(2 pi `frequency_hz` t + `phase_rad`), t = 0 at perigee; its unit is that of
    the session (m/s2, rad or m). `frequency_hz` is 0 where nothing was injected.
    """

    name: str
    orbit_period_s: float
    sample_period_s: float
    frequency_hz: float = 0.0
    amplitude: float = 0.0
    phase_rad: float = 0.0
    spin_hz: float = 0.0

    @property
    def orbital_hz(self) -> float:
        """Frequency of the orbit."""
        return 1.0 / self.orbit_period_s

    @property
    def moves_masses(self) -> bool:
        """Whether `amplitude` is the displacement of masses."""
        return self.name in MASS_MOTION + QUADRATIC

    def frequency_of(self, line: Line) -> float:
        """Of one of its lines, in Hz."""
        return line.harmonic * self.frequency_hz + line.orbital * self.orbital_hz

    def injected(self, t_s: FloatArray) -> FloatArray:
        """The injected signal at times since perigee."""
        angle = 2.0 * np.pi * self.frequency_hz * np.asarray(t_s, dtype=np.float64) + self.phase_rad
        return np.asarray(self.amplitude * np.cos(angle))

    def fitted_lines(self) -> tuple[Line, ...]:
        """Those that the published estimate fits: the parameter's own, then the stimulus as a nuisance."""
        if self.name in GRADIENT:
            return (ORBITAL[1],)
        if self.name in MASS_MOTION:
            # Without the stimulus as a nuisance a_c12 and a_c13 would take up 0.4 and 0.8 of the coupling eta.
            return (Line(1, -2), Line(1, 2), STIMULUS)
        if self.name == "k2d" or self.name in QUADRATIC:
            # Without it K2c would be wrong by 1.2e4 s2/m: it leaks through the edge at 200 s.
            return (Line(2, 0), STIMULUS)
        return (STIMULUS,)

    def observed_lines(self) -> tuple[Line, ...]:
        """Those at which a model is compared with the run."""
        if self.name in GRADIENT:
            return ORBITAL
        if self.name == "dy":
            return (*ORBITAL, *(Line(1, j) for j in range(-3, 4)))
        if self.name in MASS_MOTION:
            return (*ORBITAL, *(Line(1, j) for j in (-3, -2, -1, 1, 2, 3)))
        if self.name in LINEAR:
            around = tuple(Line(1, j) for j in range(-2, 3))
            return (*ORBITAL, *around, Line(2, -1), Line(2, 0), Line(2, 1), Line(3, 0))
        return (*ORBITAL, Line(2, 0), Line(3, 0))

    def reduced_lines(self, duration_s: float) -> tuple[Line, ...]:
        """`observed_lines` and the stimulus, less those that a stretch so long cannot tell from an earlier one."""
        wanted = self.observed_lines()
        if self.frequency_hz > 0.0 and STIMULUS not in wanted:
            wanted = (*wanted, STIMULUS)
        # Below the Nyquist frequency by what a filter needs.
        highest_hz = 0.4 / self.sample_period_s
        kept: list[Line] = []
        for line in wanted:
            f_hz = self.frequency_of(line)
            apart = min((abs(f_hz - self.frequency_of(other)) for other in kept), default=math.inf)
            if 0.5 / duration_s < f_hz < highest_hz and apart * duration_s > 0.9:
                kept.append(line)
        return tuple(kept)


def moved_axis(session: Session) -> int:
    """The axis along which a session moves masses: 0, 1 or 2."""
    return {"ac12": 1, "ac13": 2}.get(session.name, 0)


def moved_shares(session: Session) -> tuple[float, float]:
    """How far each mass goes of `amplitude`."""
    if session.name in MASS_MOTION:
        # In opposition: one mass alone would bring in theta_d, 1.5e-3 rad.
        return (-0.5, 0.5)
    return (1.0, 0.0) if session.name == "k2c_1" else (0.0, 1.0) if session.name == "k2c_2" else (0.0, 0.0)


def session_of(run_id: str, conditions: Mapping[str, Any], orbit_period_s: float, sample_period_s: float) -> Session:
    """The session a run's conditions describe; `DataError` when they do not."""
    name = str(conditions.get("session", ""))
    if name not in SESSIONS:
        raise DataError(f"run {run_id}: session {name!r} is none; use one of: {', '.join(SESSIONS)}")
    if name in GRADIENT or name == "ep_inertial":
        return Session(name, orbit_period_s, sample_period_s)
    if name == "ep_spin":
        spin_hz = float(conditions.get("spin_frequency_hz", math.nan))
        if not 0.0 < spin_hz < 0.1 / sample_period_s:
            raise DataError(f"run {run_id}: session ep_spin needs a spin_frequency_hz, below a tenth of the rate")
        return Session(name, orbit_period_s, sample_period_s, spin_hz=spin_hz)
    frequency_hz, amplitude = (
        float(conditions.get(key, math.nan)) for key in ("calibration_frequency_hz", "amplitude")
    )
    if not (frequency_hz > 0.0 and amplitude != 0.0 and math.isfinite(amplitude)):
        raise DataError(
            f"run {run_id}: session {name} needs a calibration_frequency_hz and an amplitude other than 0"
        )
    phase_rad = float(conditions.get("phase_rad", 0.0) or 0.0)
    phase_rad = 0.0 if math.isnan(phase_rad) else phase_rad
    return Session(name, orbit_period_s, sample_period_s, frequency_hz, amplitude, phase_rad)
