"""One blind trial of the sensing axis: a bench, its noise and the effects that act on it, drawn at random.

Sizes are set in sigma of what the recording can show: the noise's spectrum is known here, and what the baseline's
parameters can imitate is projected out of the effect's change of the harmonics.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tests.foreign.isa_bundle import Noise
from tests.foreign.isa_world import AXES, Bench, Design, Floats, Readings, readings, seat

KNOWN: dict[str, tuple[str, ...]] = {
    "roll-gravity": ("rho1",),
    "pitch-gravity": ("pi1",),
    "resonance": (
        "inv_w0_squared[pendulum]",
        "damping[pendulum]",
        "inv_w0_squared[flag]",
        "damping[flag]",
    ),
    "quadratic": ("K2",),
    "time-skew": ("tau",),
    "thermal-bias": ("bT",),
    "thermal-gain": ("kT",),
    "cable-hysteresis": ("h",),
    "encoder-eccentricity": ("e1", "e2"),
    "axis-tilt": ("eps_cos", "eps_sin"),
    "yaw": ("psi1",),
    "laser-cosine": ("dt",),
    "laser-nonlinearity": ("q",),
    "bias-drift": ("bias_rate",),
    "gain-drift": ("gain_rate",),
    "null-drift": ("null_rate",),
    "mains-pickup": ("line_v",),
}
UNKNOWN = {"humidity-gain": ("gain_per_percent",), "cubic": ("K3",)}
TRIAL_STEP = {
    "rho1": 1e-6, "pi1": 1e-6, "K2": 1e-4, "tau": 1e-5, "bT": 1e-5, "kT": 1e-6, "h": 1e-7, "e1": 1e-6, "e2": 1e-6,
    "eps_cos": 1e-7, "eps_sin": 1e-7, "psi1": 1e-4, "dt": 1e-5, "q": 1e-2, "bias_rate": 1e-8, "gain_rate": 1e-9,
    "null_rate": 1e-12, "gain_per_percent": 1e-7, "K3": 1e-4,
}  # fmt: skip
"""Changes small enough to be linear, in the parameters' units."""
MOST_TILT_RAD = 0.1
"""Nobody mounts a head 6 degrees off and does not see it; a beam without tilt sees nothing of less."""


@dataclass(frozen=True)
class Trial:
    """What is hidden: the effects by name, their size in sigma, and the parameters that the world was given."""

    design: Design
    bench: Bench
    noise: Noise
    hidden: dict[str, float]

    @property
    def parameters(self) -> dict[str, float]:
        return dict(self.bench.effects)


def drawn_design(random: np.random.Generator) -> Design:
    """Near the null at three frequencies, some runs at a smaller amplitude, some at wide angles; shuffled."""
    frequencies = np.sort(random.choice([0.27, 0.33, 0.4, 0.5, 0.6, 0.66], 3, replace=False))
    angles = np.radians([-1.4, -0.5, 0.6, 1.3])
    near = [(angle, frequency, 5e-3, True) for angle in angles for frequency in frequencies]
    small = [(angle, frequencies[2], 3e-3, True) for angle in (angles[0], angles[3])]
    wide_deg = (-140.0, -75.0, 60.0, 155.0)
    wide = [(np.radians(angle), frequencies[number % 3], 5e-3, False) for number, angle in enumerate(wide_deg)]
    one = [(*run, mounting) for mounting in (1, 2) for run in near + small + wide]
    order = np.concatenate([random.permutation(len(one) // 2), len(one) // 2 + random.permutation(len(one) // 2)])
    theta, frequency, amplitude, lasers, mounting = (np.array(column)[order] for column in zip(*one, strict=True))
    count = len(one)
    start = np.cumsum(random.uniform(60.0, 150.0, count)) + np.where(mounting == 2, 3600.0, 0.0)
    warm = 21.0 + 1.2 * np.sin(start / 2500.0 + random.uniform(0.0, 6.0)) + random.normal(0.0, 0.4, count)
    return Design(
        axis=str(random.choice(list(AXES))),
        flag=mounting == 2,
        mounting=mounting,
        theta_rad=theta,
        approach=random.choice([-1.0, 1.0], count),
        frequency_hz=frequency,
        amplitude_m=amplitude,
        temperature_c=np.round(warm, 2),
        humidity_percent=np.round(random.uniform(35.0, 55.0, count), 1),
        start_s=np.round(start, 1),
        lasers=lasers.astype(bool),
        duration_s=float(random.choice([21.0, 26.0, 30.0])),
        rate_hz=float(random.choice([20.0, 25.0, 40.0])),
    )


def drawn_bench(random: np.random.Generator, design: Design) -> Bench:
    """An axis up to 0.6 deg from the cube's, two mountings, levelled until the static level is below a volt."""
    axis = np.array([1.0, random.normal(0.0, 4e-3), random.normal(0.0, 4e-3)])
    bench = Bench(
        axis_ijk=axis / np.linalg.norm(axis),
        delta_rad=random.normal(0.0, 2e-3, (2, 3)),
        gain={False: random.uniform(50.0, 70.0), True: random.uniform(85.0, 110.0)},
        level_v=random.normal(0.0, 0.1, 2),
        phase_rad=random.uniform(0.0, 2.0 * np.pi, design.runs),
    )
    delta = bench.delta_rad.copy()
    for number in (0, 1):
        upright = seat(design, bench)[design.mounting == number + 1][0] @ bench.axis_ijk
        delta[number, 0] -= upright[2] + random.normal(0.0, 2e-4)
    return replace(bench, delta_rad=delta)


def drawn_noise(random: np.random.Generator) -> Noise:
    return Noise(
        white_v=random.uniform(2e-4, 6e-4),
        flicker_v_rthz=random.uniform(0.5e-4, 2e-4),
        exponent=random.uniform(0.8, 1.7),
        bump_v_rthz=float(random.choice([0.0, 2e-4])),
        drifting_v=random.uniform(2e-4, 1e-3),
    )


def harmonics(design: Design, signals: Floats) -> Floats:
    """Constant, and in phase and quadrature at nu, 2 nu and 3 nu, of signals (k, runs, samples); (k, runs, 7)."""
    drive = 2.0 * np.pi * design.frequency_hz[:, None] * design.time_s
    found = []
    for phase, values in zip(drive, signals.swapaxes(0, 1), strict=True):
        basis = [np.ones_like(phase), *(shape(n * phase) for n in (1, 2, 3) for shape in (np.sin, np.cos))]
        found.append(np.linalg.lstsq(np.column_stack(basis), values.T, rcond=None)[0])
    return np.array(found).transpose(2, 0, 1)


def in_sigma(design: Design, noise: Noise, given: Readings) -> Floats:
    """Everything observable of a recording, each divided by its standard deviation."""
    nu = design.frequency_hz[:, None] * np.array([1, 1, 2, 2, 3, 3])
    at_harmonics = np.sqrt(noise.density(nu, design.rate_hz) / design.duration_s)
    constant = np.full((design.runs, 1), 1.2 * noise.drifting_v)
    accel, *heads = harmonics(design, np.stack([given.accel_v, *given.laser_m]))
    of_head = noise.laser_m * np.sqrt(2.0 / (design.rate_hz * design.duration_s))
    seen = [(head[design.lasers, 1:] / of_head).ravel() for head in heads]
    return np.concatenate([(accel / np.hstack([constant, at_harmonics])).ravel(), *seen])


class Sight:
    """What a recording on a bench without effects can show; what the baseline can imitate is found once."""

    def __init__(self, design: Design, bench: Bench, noise: Noise) -> None:
        self._design, self._bench, self._noise = design, bench, noise

    def size(self, effects: dict[str, float]) -> float:
        """The effects' visible size: their change of the observables, in sigma, after the baseline has refitted."""
        change = self._seen(self._bench.with_effects(effects)) - self._start
        return float(np.linalg.norm(change - self._imitated @ (self._imitated.T @ change)))

    def _seen(self, bench: Bench) -> Floats:
        return in_sigma(self._design, self._noise, readings(self._design, bench))

    @cached_property
    def _start(self) -> Floats:
        return self._seen(self._bench)

    @cached_property
    def _imitated(self) -> Floats:
        """What the baseline fits can do to the observables, as a basis: axis, mountings, gains and levels."""
        bench = self._bench
        changed: list[tuple[Bench, float]] = []
        for number in (1, 2):
            changed.append((replace(bench, axis_ijk=bench.axis_ijk + 1e-6 * np.eye(3)[number]), 1e-6))
        for place in np.ndindex(2, 3):
            delta = bench.delta_rad.copy()
            delta[place] += 1e-6
            changed.append((replace(bench, delta_rad=delta), 1e-6))
        for flag in (False, True):
            changed.append((replace(bench, gain={**bench.gain, flag: bench.gain[flag] * (1.0 + 1e-6)}), 1e-6))
            level = bench.level_v.copy()
            level[int(flag)] += 1e-5
            changed.append((replace(bench, level_v=level), 1e-5))
        columns = np.column_stack([(self._seen(other) - self._start) / step for other, step in changed])
        return np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]


def drawn_effect(
    random: np.random.Generator, name: str, design: Design, noise: Noise, sight: Sight, size_sigma: float
) -> dict[str, float]:
    """The effect's parameters at the size wanted: its direction drawn, its length scaled."""
    if name == "mains-pickup":
        line_hz = float(random.uniform(2.5, 0.45 * design.rate_hz))
        density = float(noise.density(np.array([line_hz]), design.rate_hz)[0])
        per_run = np.sqrt(density / design.duration_s)
        return {"line_v": 3.0 * size_sigma * float(per_run) / np.sqrt(design.runs), "line_hz": line_hz}
    if name == "resonance":
        flag, quality = random.uniform(3.0, 4.5) * 2.0 * np.pi, random.uniform(5.0, 20.0)
        squared = {"flag": flag**2, "pendulum": flag**2 + G_OVER_LENGTH}
        inverse = {f"inv_w0_squared[{where}]": 1.0 / value for where, value in squared.items()}
        return inverse | {f"damping[{where}]": 1.0 / (np.sqrt(value) * quality) for where, value in squared.items()}
    head = int(random.integers(1, 4))
    names = [f"{part}[{head}]" if name.startswith("laser") else part for part in (KNOWN | UNKNOWN)[name]]
    direction = random.choice([-1.0, 1.0], len(names)) * random.uniform(0.6, 1.0, len(names))
    unit = {part: TRIAL_STEP[part.partition("[")[0]] * float(way) for part, way in zip(names, direction, strict=True)}
    scale = size_sigma / sight.size(unit)
    return {part: value * scale for part, value in unit.items()}


G_OVER_LENGTH = 9.803 / 0.030


def drawn(seed: int) -> Trial:
    """A trial: none, one or two known effects, or one that is in no catalogue, of 8 to 20 sigma each."""
    random = np.random.default_rng([20261122, seed])
    design = drawn_design(random)
    bench, noise = drawn_bench(random, design), drawn_noise(random)
    sight = Sight(design, bench, noise)
    kind = random.choice(["none", "one", "two", "unknown"], p=[0.1, 0.55, 0.15, 0.2])
    count = {"none": 0, "one": 1, "two": 2, "unknown": 1}[str(kind)]
    family = sorted(UNKNOWN if kind == "unknown" else KNOWN)
    names = [str(name) for name in random.choice(family, count, replace=False)]
    hidden: dict[str, float] = {}
    effects: dict[str, float] = {}
    while names:
        name = names.pop(0)
        size = float(random.uniform(8.0, 20.0))
        parameters = drawn_effect(random, name, design, noise, sight, size)
        if any(abs(value) > MOST_TILT_RAD for part, value in parameters.items() if part.startswith("dt")):
            names.append(str(random.choice(sorted({*family} - {name, *names, *hidden}))))
            continue
        hidden[name] = size if name == "mains-pickup" else sight.size(parameters)
        effects |= parameters
    return Trial(design, bench.with_effects(effects), noise, hidden)
