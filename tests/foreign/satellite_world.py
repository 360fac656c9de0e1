"""A second world of the drag-free satellite, from its page alone: what both masses, the loops and the sensors read.

Samples, not amplitudes: the full products of the page's measurement equation, a loop that is solved with what its
sensors read (the small part that depends on the satellite's own acceleration by repetition), the effects where they
act. SI and radians; axes are rows, samples columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline

from tests.foreign.satellite_loop import ATTITUDE, DRAG_FREE, Floats
from tests.foreign.satellite_orbit import Orbit, in_satellite, oblate_gradient, sphere_gradient

SETTLING_S = 4000.0
REPEATS = 8
SATELLITE_FORCE = ("ad11", "ad12", "ad13", "k2d")
MOVED_AXIS = {"ac12": 1, "ac13": 2, "k2c_1": 0, "k2c_2": 0}


@dataclass(frozen=True)
class Run:
    """One session; ``offset_k`` are its mean temperatures against the mission's, ``manoeuvres_s`` in its own time."""

    session: str
    orbits: int
    step_s: float
    frequency_hz: float
    amplitude: float
    phase_rad: float
    start_s: float
    offset_k: tuple[float, float]
    manoeuvres_s: tuple[float, ...] = ()

    def samples(self, orbit: Orbit) -> int:
        return round(self.orbits * orbit.period_s / self.step_s)

    def settled_samples(self) -> int:
        return round(SETTLING_S / self.step_s)

    def time_s(self, orbit: Orbit) -> Floats:
        """With the time before the session in which the loops settle."""
        return (np.arange(self.samples(orbit) + self.settled_samples()) - self.settled_samples()) * self.step_s

    def stimulus(self, time_s: Floats) -> Floats:
        return np.asarray(self.amplitude * np.cos(2.0 * np.pi * self.frequency_hz * time_s + self.phase_rad))


@dataclass(frozen=True)
class Mass:
    """K1 - 1 on its diagonal, couplings, rotation (three each), K2, biases, place in the satellite."""

    gain_error: Floats
    coupling: Floats
    rotation_rad: Floats
    quadratic: Floats
    read_bias: Floats
    force_bias: Floats
    place_m: Floats

    @property
    def turn(self) -> Floats:
        tx, ty, tz = self.rotation_rad
        return np.eye(3) + np.array([[0.0, tz, -ty], [-tz, 0.0, tx], [ty, -tx, 0.0]])

    @property
    def gains(self) -> Floats:
        ex, ey, ez = self.coupling
        return np.diag(1.0 + self.gain_error) + np.array([[0.0, ez, ey], [ez, 0.0, ex], [ey, ex, 0.0]])


@dataclass(frozen=True)
class Satellite:
    """What flies: orbit, both masses, thrusters, tracker, the air's force and torque, temperatures, and effects."""

    orbit: Orbit
    masses: tuple[Mass, Mass]
    thrusters: Floats
    tracker_bias_rad: Floats
    turn_bias_rad_s2: Floats
    air: Floats
    torque: Floats
    orbital_k: Floats
    effects: Mapping[str, float] = field(default_factory=dict)

    def acts(self, name: str) -> float:
        return self.effects.get(name, 0.0)

    def with_effects(self, effects: Mapping[str, float]) -> Satellite:
        return replace(self, effects=effects)


@dataclass(frozen=True)
class Noises:
    """What each sensor and thruster adds: masses (2, 3, n); tracker, turning sensor, thrust, torque (3, n)."""

    masses: Floats
    tracker: Floats
    turning: Floats
    thrust: Floats
    torque: Floats

    @classmethod
    def none(cls, count: int) -> Noises:
        return cls(np.zeros((2, 3, count)), *(np.zeros((3, count)) for _ in range(4)))


@dataclass(frozen=True)
class Telemetry:
    """What is recorded, from the session's beginning: (2, 3, n), (n, 3, 3), (3, n), (2, n), (n)."""

    measured: Floats
    gradient: Floats
    turning: Floats
    attitude: Floats
    command: Floats
    temperature_k: Floats
    battery_v: Floats


def waves(parts: Floats, phase: Floats) -> Floats:
    """Constant, cos, sin of the phase, cos, sin of its double, for every row of ``parts``."""
    shapes = [np.ones_like(phase), np.cos(phase), np.sin(phase), np.cos(2.0 * phase), np.sin(2.0 * phase)]
    return np.asarray(parts @ np.array(shapes))


def temperatures_k(run: Run, satellite: Satellite, time_s: Floats) -> Floats:
    """Of both sensors against the mission's mean: the session's own level and the orbit's waves."""
    shared = waves(satellite.orbital_k, satellite.orbit.rate_rad_s * time_s)
    return np.asarray(shared + np.array(run.offset_k)[:, None])


def battery_v(run: Run, satellite: Satellite, time_s: Floats) -> Floats:
    """Charged in the sun to a limit, discharged in the shadow, a third of the orbit."""
    phase = np.mod(time_s / satellite.orbit.period_s + 0.23, 1.0)
    charged = 1.0 - np.exp(-phase / 0.12)
    at_shadow = 1.0 - np.exp(-0.66 / 0.12)
    return np.asarray(28.0 + 1.4 * np.where(phase < 0.66, charged, at_shadow - (phase - 0.66) / 0.34 * at_shadow))


def since_manoeuvre(run: Run, time_s: Floats, memory_s: float) -> Floats:
    """exp(-(time since the last manoeuvre) / memory); 0 before the first."""
    found = np.zeros_like(time_s)
    for moment in run.manoeuvres_s:
        after = time_s >= moment
        found[after] = np.exp(-(time_s[after] - moment) / memory_s)
    return found


def motion(run: Run, satellite: Satellite, time_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Displacement, velocity and acceleration of both masses by command, in satellite axes (2, 3, n)."""
    found = np.zeros((3, 2, 3, len(time_s)))
    if run.session in MOVED_AXIS:
        w = 2.0 * np.pi * run.frequency_hz
        x = run.stimulus(time_s)
        quarter = replace(run, phase_rad=run.phase_rad + np.pi / 2.0)
        shapes = np.array([x, w * quarter.stimulus(time_s), -(w**2) * x])
        parts = {"k2c_1": (1.0, 0.0), "k2c_2": (0.0, 1.0)}.get(run.session, (-0.5, 0.5))
        for mass, part in enumerate(parts):
            own = satellite.masses[mass].turn.T[:, MOVED_AXIS[run.session]]
            found[:, mass] = part * own[:, None] * shapes[:, None, :]
    return found[0], found[1], found[2]


def attitude(run: Run, satellite: Satellite, noises: Noises, time_s: Floats) -> tuple[Floats, ...]:
    """True angle, rate, acceleration; estimated angle and measured acceleration (3, n each)."""
    signal = np.zeros((3, len(time_s)))
    if run.session == "dy":
        signal[2] = run.stimulus(time_s)
    torque = waves(satellite.torque, satellite.orbit.rate_rad_s * time_s) + noises.torque
    tracker = satellite.tracker_bias_rad[:, None] + noises.tracker - signal
    turning = satellite.turn_bias_rad_s2[:, None] + noises.turning
    answers = np.array(
        [ATTITUDE.answer(np.array(inputs), run.step_s) for inputs in zip(torque, tracker, turning, strict=True)]
    )
    angle, rate, acceleration, estimate = np.swapaxes(answers, 0, 1)
    return angle, rate, acceleration, estimate + signal, acceleration + turning


def inertia(rate: Floats, acceleration: Floats) -> Floats:
    """In v = w x (w x v) + dw x v, as matrices behind the samples."""
    turning = cross_matrix(rate)
    return np.asarray(turning @ turning + cross_matrix(acceleration))


def cross_matrix(vectors: Floats) -> Floats:
    x, y, z = vectors
    zero = np.zeros_like(x)
    return np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), -1, 0)


def field_of(satellite: Satellite, time_s: Floats) -> Floats:
    """The gravity gradient in inertial axes: apsides that turn, from perigee on +X at t = 0; an oblate Earth."""
    turned = satellite.acts("precession") * time_s
    direction, distance = satellite.orbit.place(time_s, turned)
    found = sphere_gradient(direction, distance)
    if oblate := satellite.acts("oblateness"):
        found = found + oblate * oblate_gradient(direction, distance, satellite.orbit.pole)
    return found


def relative_acceleration(
    run: Run, satellite: Satellite, mass: int, tensor: Floats, rate: Floats, time_s: Floats, warm_k: Floats
) -> Floats:
    """A_k without the satellite's own acceleration (3, n): gradient, Coriolis, the motion, forces on the mass."""
    own = satellite.masses[mass]
    x, v, a = (part[mass] for part in motion(run, satellite, time_s))
    growth = np.array([satellite.acts(f"beta[{axis}]") for axis in "xyz"])
    side = 0.5 if mass else -0.5
    place = own.place_m[:, None] + x + side * growth[:, None] * warm_k.mean(axis=0)
    found = -np.einsum("nij,jn->in", tensor, place)
    found += 2.0 * np.cross(rate, v, axis=0) + a + own.force_bias[:, None]
    axis = own.turn.T[:, MOVED_AXIS.get(run.session, 0)]
    along, speed = axis @ x, axis @ v
    found += axis[:, None] * (
        satellite.acts(f"stiffness[{mass + 1}]") * along
        + satellite.acts(f"loss[{mass + 1}]") * speed / (2.0 * np.pi * max(run.frequency_hz, 1e-9))
        + satellite.acts(f"cubic[{mass + 1}]") * along**3
    )
    n = satellite.orbit.rate_rad_s
    for number in (1, 2):
        found[0] += satellite.acts(f"field{number}_cos[{mass + 1}]") * np.cos(number * n * time_s)
        found[0] += satellite.acts(f"field{number}_sin[{mass + 1}]") * np.sin(number * n * time_s)
    since = run.orbits * satellite.orbit.period_s / 2.0
    found[0] += satellite.acts(f"charging[{mass + 1}]") * (time_s - since)
    return found


def read(run: Run, satellite: Satellite, mass: int, acceleration: Floats, time_s: Floats, warm_k: Floats) -> Floats:
    """m_k of the page without noise (3, n), and what acts on the sensor."""
    own = satellite.masses[mass]
    name = f"[{mass + 1}]"
    turned = own.turn @ (acceleration - own.force_bias[:, None]) + own.force_bias[:, None]
    gain = satellite.acts(f"kappa{name}") * warm_k[mass] + satellite.acts(f"per_v{name}") * (
        battery_v(run, satellite, time_s) - 28.0
    )
    found = own.read_bias[:, None] + own.gains @ turned + (1.0 + own.gain_error)[:, None] * turned * gain
    found = found + own.quadratic[:, None] * acceleration**2
    found[0] += satellite.acts(f"K3{name}") * acceleration[0] ** 3
    found[0] += satellite.acts(f"lambda{name}") * warm_k[mass]
    since = time_s - run.orbits * satellite.orbit.period_s / 2.0
    found[0] += satellite.acts(f"rate{name}") * since
    if memory_s := satellite.acts("memory_s"):
        found[0] += satellite.acts(f"left{name}") * since_manoeuvre(run, time_s, memory_s)
    if skew_s := satellite.acts("skew_s"):
        later = time_s + (0.5 - mass) * skew_s
        found = CubicSpline(time_s, found, axis=1)(later)
    ratio = 1.0 if mass else 1.0 + satellite.acts("glitch_ratio")
    return np.asarray(found + ratio * glitches(run, satellite, time_s))


def glitches(run: Run, satellite: Satellite, time_s: Floats) -> Floats:
    """Events of the session, drawn from its own seed: (exp(-t/3 s) - exp(-t/1 s)), seen on all axes."""
    found = np.zeros_like(time_s)
    if not satellite.acts("glitch"):
        return found
    random = np.random.default_rng(int(satellite.acts("glitch_seed")) + round(run.start_s))
    count = random.poisson(satellite.acts("glitch_per_orbit") * run.orbits)
    for _ in range(count):
        began = random.uniform(0.0, run.orbits * satellite.orbit.period_s)
        size = satellite.acts("glitch") * float(np.exp(random.normal(0.0, 0.5)))
        t = time_s[(time_s >= began) & (time_s < began + 60.0)] - began
        found[(time_s >= began) & (time_s < began + 60.0)] += size * (np.exp(-t / 3.0) - np.exp(-t / 1.0))
    return found


def flown(run: Run, satellite: Satellite, noises: Noises | None = None) -> Telemetry:
    """One session: the loops closed on what the sensors read."""
    time_s = run.time_s(satellite.orbit)
    noises = noises or Noises.none(len(time_s))
    angle, rate, acceleration, estimate, turning = attitude(run, satellite, noises, time_s)
    inertial = field_of(satellite, time_s)
    tensor = in_satellite(inertial, angle.T) - inertia(rate, acceleration)
    warm_k = temperatures_k(run, satellite, time_s)
    relative = [relative_acceleration(run, satellite, mass, tensor, rate, time_s, warm_k) for mass in (0, 1)]
    wanted = np.zeros((3, len(time_s)))
    if run.session in SATELLITE_FORCE:
        wanted[{"ad12": 1, "ad13": 2}.get(run.session, 0)] = run.stimulus(time_s)
    weights = {"k2c_1": (0.0, 1.0), "k2c_2": (1.0, 0.0)}.get(run.session, (0.5, 0.5))
    outside = waves(satellite.air, satellite.orbit.rate_rad_s * time_s) + noises.thrust
    drive, taken, command = np.zeros_like(outside), np.zeros_like(outside), np.zeros_like(outside)
    for _ in range(REPEATS):
        measured = np.array(
            [
                read(run, satellite, mass, drive + relative[mass], time_s, warm_k) + noises.masses[mass]
                for mass in (0, 1)
            ]
        )
        shown = np.tensordot(weights, measured, 1)
        acting = outside + (shown - drive) - (satellite.thrusters - np.eye(3)) @ taken - wanted
        answers = np.array([DRAG_FREE.answer(row[None], run.step_s) for row in acting])
        _, taken, command = np.swapaxes(answers, 0, 1)
        drive = outside - satellite.thrusters @ taken
    measured = np.array(
        [read(run, satellite, mass, drive + relative[mass], time_s, warm_k) + noises.masses[mass] for mass in (0, 1)]
    )
    kept = slice(run.settled_samples(), None)
    direction, distance = satellite.orbit.place(time_s)
    told = in_satellite(sphere_gradient(direction, distance), estimate.T)
    return Telemetry(
        measured[..., kept], told[kept], turning[:, kept], estimate[:, kept], command[:, kept], warm_k[:, kept],
        battery_v(run, satellite, time_s)[kept],
    )  # fmt: skip
