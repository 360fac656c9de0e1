"""One blind trial of the satellite: what flies, its noise and the effects that act on it, drawn at random.

Sizes are set in sigma of what the recording can show (``satellite_size``). An effect that would have to be much
larger than the page calls typical to be seen is no hidden effect, and another takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.foreign.satellite_bundle import Colour, Habits, Noise
from tests.foreign.satellite_orbit import Orbit
from tests.foreign.satellite_size import Sight
from tests.foreign.satellite_world import Mass, Run, Satellite

Random = np.random.Generator

KNOWN: dict[str, tuple[str, ...]] = {
    "thermal-bias": ("lambda",),
    "thermal-gain": ("kappa",),
    "thermal-off-centring": ("beta",),
    "wire-stiffness": ("stiffness", "loss"),
    "cubic-stiffness": ("cubic",),
    "charge": ("charging",),
    "magnetic": ("field1_cos", "field1_sin", "field2_cos", "field2_sin"),
    "glitches": ("glitch",),
    "sensor-skew": ("skew_s",),
    "gravity-j2": ("oblateness",),
    "orbit-precession": ("precession",),
    "cubic-electrode": ("K3",),
    "bias-drift": ("rate",),
}
"""Effects of the page that a recording can show, with their parameters in this world."""
UNKNOWN = {"eclipse-gain": ("per_v",), "manoeuvre-bias": ("left",)}
MOST = {
    "lambda": 1e-7, "kappa": 1e-2, "beta": 1e-4, "stiffness": 2.5e-2, "cubic": 1e8, "charging": 1e-14,
    "field1_cos": 1e-11, "field2_cos": 1e-11, "skew_s": 2.0, "oblateness": 5.0, "precession": 4e-6, "K3": 1e12,
    "rate": 1e-14, "per_v": 1e-2, "left": 1e-9,
}  # fmt: skip
"""Beyond that an effect is none that a mission would overlook."""
HALVED = {"lambda", "kappa", "charging", "rate", "field1_cos", "field1_sin", "field2_cos", "field2_sin"}
TEMPERATURE = {"thermal-bias", "thermal-gain", "thermal-off-centring"}
LEAST_SIGMA, MOST_SIGMA = 6.0, 20.0


@dataclass(frozen=True)
class Trial:
    """What is hidden: the effects by name, their size in sigma, and the parameters that the world was given."""

    runs: list[Run]
    satellite: Satellite
    noise: Noise
    habits: Habits
    hidden: dict[str, float]

    @property
    def parameters(self) -> dict[str, float]:
        """The world's; of those that each sensor has its own of, half the sum (c) and half the difference (d)."""
        acts = self.satellite.acts
        found = dict(self.satellite.effects)
        for stem in sorted({name.partition("[")[0] for name in found} & HALVED):
            first, second = acts(f"{stem}[1]"), acts(f"{stem}[2]")
            found |= {f"{stem}[c]": (first + second) / 2.0, f"{stem}[d]": (first - second) / 2.0}
        return found


def stimulus_cycles(session: str, orbits: int, random: Random) -> int:
    """Whole cycles in the session, near the page's frequencies and on no multiple of the orbit's."""
    per_orbit = {"ac12": 18.3, "ac13": 18.3, "k2c_1": 53.5, "k2c_2": 53.5}.get(session, 7.3)
    cycles = round(orbits * per_orbit * random.uniform(0.95, 1.05))
    return cycles if cycles % orbits not in (0,) else cycles + 1


def drawn_runs(random: Random, orbit: Orbit, alike: bool) -> list[Run]:
    """All ten sessions in random order, some twice; lengths, rates and phases drawn."""
    sessions = ["dx+dz", "dy", "ac12", "ac13", "ad11", "ad12", "ad13", "k2d", "k2c_1", "k2c_2"]
    sessions += [str(name) for name in random.choice(["dx+dz", "ad11", "k2d", "dy"], 2, replace=False)]
    step_s = float(random.choice([2.5, 3.0, 4.0, 5.0]))
    found, start_s = [], 0.0
    for session in random.permutation(sessions):
        orbits = int(random.choice([6, 7, 9])) + 3 * (session in ("ac12", "ac13"))
        cycles = stimulus_cycles(session, orbits, random) if session != "dx+dz" else 0
        size = {"dy": 1e-2, "ac12": 9e-6, "ac13": 9e-6, "k2c_1": 9e-6, "k2c_2": 9e-6, "dx+dz": 0.0}.get(session, 5e-8)
        levels = random.normal(0.0, 0.3, 2)
        gaps = np.cumsum(random.uniform(0.8, 4.0, 20)) * orbit.period_s - 0.5 * orbit.period_s
        run = Run(
            session=str(session),
            orbits=orbits,
            step_s=step_s,
            frequency_hz=cycles / (orbits * orbit.period_s),
            amplitude=size * float(random.uniform(0.8, 1.2)),
            phase_rad=float(random.uniform(-np.pi, np.pi)) if cycles and random.random() < 0.5 else 0.0,
            start_s=start_s,
            offset_k=(float(levels[0]), float(levels[0] if alike else levels[1])),
            manoeuvres_s=(-900.0, *(float(gap) for gap in gaps if gap < orbits * orbit.period_s)),
        )
        found.append(run)
        start_s += orbit.period_s * float(orbits + random.integers(1, 6))
    return found


def drawn_mass(random: Random, common: dict[str, np.ndarray], sign: float) -> Mass:
    """Half sums given, half differences drawn within the page's bounds."""
    return Mass(
        gain_error=common["gain"] + sign * common["gain_d"],
        coupling=common["coupling"] + sign * random.uniform(-1e-4, 1e-4, 3) / 2.0,
        rotation_rad=common["turn"] + sign * common["turn_d"],
        quadratic=common["quadratic"] + sign * common["quadratic_d"],
        read_bias=common["read"] + random.uniform(-1e-8, 1e-8, 3),
        force_bias=common["force"] + sign * random.uniform(-1.4e-8, 1.4e-8, 3),
        place_m=common["centre"] - sign * common["off_centring"] / 2.0,
    )


def drawn_satellite(random: Random, orbit: Orbit) -> Satellite:
    bounds = {
        "gain": 1e-2, "gain_d": 1e-2, "coupling": 1e-4, "turn": 2.5e-3, "turn_d": 1.5e-3, "quadratic": 1.4e4,
        "quadratic_d": 1.4e4, "read": 2e-8, "force": 1e-8, "centre": 2e-3, "off_centring": 2e-5,
    }  # fmt: skip
    common = {name: random.uniform(-bound, bound, 3) for name, bound in bounds.items()}
    air = np.array([
        [2e-8, 2e-8, 0.0, 0.0, 5e-9], [-1e-8, 0.0, 5e-9, 2e-9, 0.0], [3e-8, 0.0, -2e-8, 5e-9, 0.0],
    ])  # fmt: skip
    torque = np.array([
        [1e-7, 3e-8, 0.0, 1e-8, 0.0], [-1e-7, 0.0, 3e-8, 0.0, 2e-8], [5e-8, 3e-8, 0.0, 3e-8, 0.0],
    ])  # fmt: skip
    orbital = np.zeros((2, 5))
    orbital[:, 1:3] = random.normal(0.0, 1e-3, 2)
    orbital[:, 3:] = random.normal(0.0, 3e-4, 2)
    return Satellite(
        orbit=orbit,
        masses=(drawn_mass(random, common, 1.0), drawn_mass(random, common, -1.0)),
        thrusters=np.eye(3) + random.uniform(-0.02, 0.02, (3, 3)),
        tracker_bias_rad=random.normal(0.0, 1e-4, 3),
        turn_bias_rad_s2=random.uniform(-1e-6, 1e-6, 3),
        air=air * random.uniform(0.7, 1.3, air.shape),
        torque=torque * random.uniform(0.7, 1.3, torque.shape),
        orbital_k=orbital,
    )


def drawn_noise(random: Random) -> Noise:
    def colour() -> Colour:
        return Colour(1.2e-12 * random.uniform(0.7, 1.5), random.uniform(1e-4, 1.5e-3), random.uniform(0.8, 1.3))

    return Noise(
        x=(colour(), colour()),
        across=5e-12 * random.uniform(0.6, 1.5),
        thrust=3e-9 * random.uniform(0.5, 1.5),
        torque=4e-8 * random.uniform(0.5, 1.5),
        tracker=1.7e-5 * random.uniform(0.5, 1.5),
        turning=1e-9 * random.uniform(0.5, 1.5),
    )


def per_mass(random: Random, stems: tuple[str, ...]) -> dict[str, float]:
    """Amplitudes of one mass or of both, of about one size."""
    masses = [("1",), ("2",), ("1", "2")][int(random.integers(3))]
    return {
        f"{stem}[{mass}]": MOST[stem] * 1e-4 * float(random.choice([-1.0, 1.0]) * random.uniform(0.5, 1.0))
        for mass in masses
        for stem in stems
    }


def direction(random: Random, name: str) -> dict[str, float]:
    """The effect's amplitudes before they are sized."""
    if name == "thermal-off-centring":
        return {f"beta[{axis}]": 1e-7 * float(random.normal()) for axis in "xyz"}
    if name == "wire-stiffness":
        quality = float(np.exp(random.uniform(np.log(50.0), np.log(1000.0))))
        found = per_mass(random, ("stiffness",))
        positive = {key: abs(value) for key, value in found.items()}
        return positive | {key.replace("stiffness", "loss"): value / quality for key, value in positive.items()}
    if name == "magnetic":
        orbital = per_mass(random, ("field1_cos", "field2_cos"))
        return orbital | {key.replace("cos", "sin"): value * float(random.normal()) for key, value in orbital.items()}
    single = {"sensor-skew": "skew_s", "gravity-j2": "oblateness", "orbit-precession": "precession"}
    if name in single:
        sign = 1.0 if name == "gravity-j2" else float(random.choice([-1.0, 1.0]))
        return {single[name]: sign * 1e-3 * MOST[single[name]]}
    return per_mass(random, {**KNOWN, **UNKNOWN}[name])


def drawn_effect(random: Random, name: str, sight: Sight) -> tuple[dict[str, float], float]:
    """The effect's parameters and its size in sigma."""
    wanted = float(random.uniform(LEAST_SIGMA, MOST_SIGMA))
    if name == "glitches":
        ratio = float(random.choice([-1.0, 1.0]) * random.uniform(0.03, 0.1))
        size = wanted / sight.event_size(1.0, ratio)
        rest = {"glitch_ratio": ratio, "glitch_per_orbit": float(random.uniform(1.0, 6.0))}
        return {"glitch": size, "glitch_seed": float(random.integers(1_000_000)), **rest}, wanted
    amplitudes = direction(random, name)
    fixed = {"memory_s": float(random.uniform(600.0, 4000.0))} if name == "manoeuvre-bias" else {}
    scale = wanted / sight.size(amplitudes | fixed)
    found = {key: value * scale for key, value in amplitudes.items()} | fixed
    return found, wanted


def too_large(effects: dict[str, float]) -> bool:
    return any(abs(value) > MOST.get(key.partition("[")[0], np.inf) for key, value in effects.items())


def drawn(seed: int) -> Trial:
    """A trial: nothing, one or two effects of the page, or one that is in no catalogue."""
    random = np.random.default_rng([20261124, seed])
    orbit = Orbit(
        period_s=float(random.choice([5880.0, 5940.0, 6000.0])),
        eccentricity=float(random.uniform(1e-3, 5e-3)),
        inclination_rad=float(np.radians(random.uniform(97.0, 99.0))),
        perigee_argument_rad=float(random.uniform(0.0, 2.0 * np.pi)),
    )
    thermometers = int(random.choice([1, 2]))
    runs = drawn_runs(random, orbit, alike=thermometers == 1)
    satellite, noise = drawn_satellite(random, orbit), drawn_noise(random)
    kind = str(random.choice(["none", "one", "two", "unknown"], p=[0.1, 0.55, 0.15, 0.2]))
    count = {"none": 0, "one": 1, "two": 2, "unknown": 1}[kind]
    family = sorted(UNKNOWN if kind == "unknown" else KNOWN)
    names = [str(name) for name in random.choice(family, count, replace=False)]
    sight = Sight(runs, satellite, noise)
    effects: dict[str, float] = {}
    hidden: dict[str, float] = {}
    while names:
        name = names.pop(0)
        parameters, size = drawn_effect(random, name, sight)
        if too_large(parameters):
            names.append(str(random.choice(sorted(set(family) - {name, *names, *hidden}))))
            continue
        hidden[name] = size
        effects |= parameters
    unmeasured = not TEMPERATURE & set(hidden) and bool(random.random() < 0.3)
    habits = Habits(
        thermometers=0 if unmeasured else thermometers,
        thermometer_k=1e-5,
        lost=float(random.choice([0.0, 0.0, 0.002, 0.01])),
    )
    return Trial(runs, satellite.with_effects(effects), noise, habits, hidden)


def without_thermometers(trial: Trial) -> Trial:
    """The same recording, nobody having written down a temperature."""
    return replace(trial, habits=replace(trial.habits, thermometers=0))
