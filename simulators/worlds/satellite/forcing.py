"""What acts on every draw alike, step by step: orbit, drag, what is injected, what nature adds in step with time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite import layout
from simulators.worlds.satellite.layout import FORCING, FORCINGS
from simulators.worlds.satellite.orbit import EARTH_M3_S2, Place, oblateness, place
from simulators.worlds.satellite.settings import SatelliteSettings

Target = Literal["none", "drag-free", "attitude", "masses", "mass-1", "mass-2"]

SPEED_OF_LIGHT_M_S = 299792458.0
EARTH_ORBIT_M_S = 29.78e3
ORBITAL_M_S = 7.49e3
"""Of a satellite 720 km high."""

ROOM_K = 290.0

AXES = {"x": 0, "y": 1, "z": 2}
# The off-centring is from mass 1 to mass 2: it grows when mass 1 goes back.
_SHARES: dict[str, tuple[float, float]] = {"masses": (-0.5, 0.5), "mass-1": (1.0, 0.0), "mass-2": (0.0, 1.0)}


@dataclass(frozen=True)
class Injection:
    """`amplitude` cos(2 pi `frequency_hz` t + `phase_rad`), t = 0 at the perigee where the session begins.

    `drag-free`: the wanted common output [m/s2]. `attitude`: taken from what the star tracker says [rad]. `masses`:
    the growth of the off-centring along their own axis, half by each; `mass-1`, `mass-2`: of one mass [m].
    """

    target: Target = "none"
    axis: Literal["x", "y", "z"] = "x"
    amplitude: float = 0.0
    frequency_hz: float = 0.0
    phase_rad: float = 0.0

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The signal and its first two derivatives."""
        w = 2.0 * math.pi * self.frequency_hz
        angle = w * time_s + self.phase_rad
        signal = self.amplitude * np.cos(angle)
        return signal, -w * self.amplitude * np.sin(angle), -(w**2) * signal


@dataclass(frozen=True)
class Command:
    """One session: what is injected, what drag-free control holds at rest, and for how many samples."""

    samples: int
    injection: Injection = field(default_factory=Injection)
    hold: Literal["both", "mass-1", "mass-2"] = "both"
    spin_hz: float = 0.0
    """Turns about Y against the motion in orbit."""

    @property
    def inputs(self) -> tuple[float, float]:
        """Weights of the two masses in the input of drag-free control."""
        return {"both": (0.5, 0.5), "mass-1": (1.0, 0.0), "mass-2": (0.0, 1.0)}[self.hold]


def forcing(settings: SatelliteSettings, command: Command, time_s: FloatArray) -> FloatArray:
    """One row per time, columns as in `layout.FORCING`."""
    made = np.zeros((len(time_s), FORCINGS))
    _orbit(made, settings, command.spin_hz, time_s)
    _drag(made, settings, command.spin_hz, time_s)
    _injected(made, settings, command.injection, time_s)
    _in_time(made, settings, time_s)
    return made


def temperature_k(settings: SatelliteSettings, time_s: FloatArray) -> FloatArray:
    """How much warmer than usual the sensors are."""
    n, warm = 2.0 * math.pi / settings.orbit_period_s, settings.temperature
    return np.asarray(
        warm.orbit_k * np.cos(n * time_s + warm.orbit_phase_rad)
        + warm.twice_k * np.cos(2.0 * n * time_s + warm.twice_phase_rad)
    )


def _orbit(made: FloatArray, settings: SatelliteSettings, spin_hz: float, time_s: FloatArray) -> None:
    period_s, e, size = settings.orbit_period_s, settings.eccentricity, settings.size
    # The ground knows the orbit as planned; what is wrong about it is in `true` alone.
    believed = true = place(time_s, period_s, e, 0.0)
    if settings.effects.keys() & {"orbit-dating", "orbit-precession"}:
        true = place(
            time_s + size("orbit-dating", "delay"),
            period_s,
            e + size("orbit-precession", "eccentricity_rate") * time_s,
            size("orbit-precession", "rate") * time_s,
        )
    for at, where in ((FORCING["strength"], true), (FORCING["believed"], believed)):
        cosine, sine = _turned(where.cosine, where.sine, spin_hz, time_s)
        made[:, at], made[:, at + 1], made[:, at + 2] = where.strength_s2, cosine, sine
    made[:, FORCING["believed"] + 3] = _pull_m_s2(believed)
    if settings.eotvos:
        made[:, FORCING["falling"]] = 0.5 * settings.eotvos * _pull_m_s2(true)
    if j2 := size("gravity-j2", "j2"):
        inclination, perigee = size("gravity-j2", "inclination"), size("gravity-j2", "perigee")
        _put(made, "gradient", oblateness(true, period_s, j2, inclination, perigee))
    for axis, name in enumerate(AXES):
        made[:, FORCING["tracker"] + axis] = size("tracker-bias", name)
    if "tracker-aberration" in settings.effects:
        # In a session the Earth's own velocity keeps its direction, that in orbit goes round.
        orbital = size("tracker-aberration", "orbital") * ORBITAL_M_S / SPEED_OF_LIGHT_M_S
        made[:, FORCING["tracker"] + 1] += (
            size("tracker-aberration", "annual") * EARTH_ORBIT_M_S / SPEED_OF_LIGHT_M_S + orbital * true.cosine
        )
        made[:, FORCING["tracker"] + 2] += orbital * true.sine


def _pull_m_s2(at: Place) -> FloatArray:
    """mu / r^2."""
    return np.asarray(at.strength_s2 ** (2.0 / 3.0) * EARTH_M3_S2 ** (1.0 / 3.0))


def _turned(x: FloatArray, z: FloatArray, spin_hz: float, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """In the axes of a satellite that turns."""
    if spin_hz == 0.0:
        return x, z
    c, s = np.cos(2.0 * math.pi * spin_hz * time_s), np.sin(2.0 * math.pi * spin_hz * time_s)
    return c * x - s * z, s * x + c * z


def _drag(made: FloatArray, settings: SatelliteSettings, spin_hz: float, time_s: FloatArray) -> None:
    mean = 2.0 * math.pi / settings.orbit_period_s * time_s
    c1, s1 = np.cos(mean), np.sin(mean)
    # Of the double angle without further cosines: this is worked out for every step.
    c2, s2 = 1.0 - 2.0 * s1**2, 2.0 * s1 * c1
    drag = settings.drag
    for axis, (once, twice) in enumerate(((c1, s2), (s1, c2), (s1, c2))):
        level, first, second = drag.force_m_s2[axis], drag.force_1_m_s2[axis], drag.force_2_m_s2[axis]
        made[:, FORCING["force"] + axis] = level + first * once + second * twice
    if external := settings.external():
        _put(made, "force", external.at(time_s))
    x, z = FORCING["force"], FORCING["force"] + 2
    made[:, x], made[:, z] = _turned(made[:, x].copy(), made[:, z].copy(), spin_hz, time_s)
    for axis, (once, twice) in enumerate(((c1, s2), (s1, c2), (c1, s2))):
        level, first, second = drag.torque_rad_s2[axis], drag.torque_1_rad_s2[axis], drag.torque_2_rad_s2[axis]
        made[:, FORCING["torque"] + axis] = level + first * once + second * twice


def _injected(made: FloatArray, settings: SatelliteSettings, injection: Injection, time_s: FloatArray) -> None:
    if injection.target == "none":
        return
    signal, speed, acceleration = injection.at(time_s)
    if injection.target in {"drag-free", "attitude"}:
        column = FORCING["wanted" if injection.target == "drag-free" else "attitude"] + AXES[injection.axis]
        made[:, column] = signal
        return
    w = 2.0 * math.pi * injection.frequency_hz
    reaction = settings.size("moved-mass-reaction", "factor") / settings.satellite_kg
    for k, share in enumerate(_SHARES[injection.target]):
        mass, name = settings.mass_kg[k], str(k + 1)
        made[:, FORCING["moved"] + k] = share * signal
        made[:, FORCING["speed"] + k] = share * speed
        kappa = settings.size("wire-stiffness", "kappa", name)
        # A loss angle 1/Q is at one frequency a damping of kappa / (Q w).
        loss = kappa / (mass * settings.size("wire-stiffness", "quality", name) * w) if kappa else 0.0
        cubic = settings.size("cubic-stiffness", "kappa3", name)
        made[:, FORCING["pushed"] + k] = share * (
            # The share stands in front: of the cube of a mass' own way its square is left within.
            acceleration + kappa / mass * signal + loss * speed + cubic / mass * share**2 * signal**3
        )
        made[:, FORCING["reaction"] + k] = reaction * mass * share * acceleration


def _in_time(made: FloatArray, settings: SatelliteSettings, time_s: FloatArray) -> None:
    made[:, FORCING["gain"] : FORCING["gain"] + 2] = 1.0
    made[:, FORCING["loudness"]] = 1.0
    if not settings.effects:
        return
    size = settings.size
    n = 2.0 * math.pi / settings.orbit_period_s
    warmer_k = temperature_k(settings, time_s)
    # Half of it by each mass.
    made[:, FORCING["parted"]] = 0.5 * size("thermal-off-centring", "beta") * warmer_k
    for axis, name in enumerate(AXES):
        made[:, FORCING["centre"] + axis] = size("mass-drift", f"rate_{name}") * time_s
    for k, mass in enumerate(("1", "2")):
        made[:, FORCING["applied"] + k] = size("charge", "rate", mass) * time_s + sum(
            size("magnetic", f"a{harmonic}_{name}", mass) * wave(harmonic * n * time_s)
            for harmonic in (1, 2)
            for name, wave in (("cos", np.cos), ("sin", np.sin))
        )
        made[:, FORCING["measured"] + k] = (
            size("thermal-bias", "lambda", mass) * warmer_k
            + size("bias-drift", "rate", mass) * time_s
            + size("bias-drift", "curvature", mass) * time_s**2
        )
        made[:, FORCING["gain"] + k] += size("thermal-gain", "kappa", mass) * warmer_k
    if change := size("noise-level", "change"):
        made[:, FORCING["loudness"]] += change * np.sin(2.0 * math.pi * time_s / size("noise-level", "period"))


def _put(made: FloatArray, name: str, columns: FloatArray) -> None:
    at = layout.FORCING[name]
    made[:, at : at + columns.shape[1]] = columns
