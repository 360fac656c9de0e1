"""Trials on the second world of the shaken accelerometer: plan, noise and hidden effects drawn at random."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.foreign.response_world import G_M_S2, Design, Floats, Sensor, accel_v, head_m, motion_m

KNOWN: dict[str, tuple[str, ...]] = {
    "guide-pitch": ("pi1",),
    "direction-asymmetry": ("epsilon",),
    "cubic": ("K3",),
    "time-skew": ("skew_s",),
    "lag": ("lag_s",),
    "resonance": ("inv_w0_squared", "damping"),
    "thermal-gain": ("kT",),
    "gain-drift": ("gain_rate",),
}
UNKNOWN = {"humidity-gain": ("gain_per_percent",), "resonating-part": ("part",)}
NEVER_NEGATIVE = {"lag_s", "inv_w0_squared", "damping"}
TRIAL_STEP = {
    "pi1": 1e-7, "epsilon": 1e-6, "K3": 1e-6, "skew_s": 1e-8, "lag_s": 1e-8, "kT": 1e-6, "gain_rate": 1e-10,
    "inv_w0_squared": 1e-9, "damping": 1e-8, "gain_per_percent": 1e-7, "part": 1e-6,
}  # fmt: skip
"""Changes small enough to be linear, in the parameters' units."""
HEADS = 2


@dataclass(frozen=True)
class Noise:
    """White, of every sample."""

    accel_v: float
    laser_m: float
    stage_m: float = 2e-9


@dataclass(frozen=True)
class Trial:
    """What is hidden: the effects by name, their size in sigma, and the parameters that the world was given."""

    design: Design
    sensor: Sensor
    noise: Noise
    hidden: dict[str, float]

    @property
    def parameters(self) -> dict[str, float]:
        return dict(self.sensor.effects)


def drawn_design(random: np.random.Generator) -> Design:
    """Five or six frequencies at three accelerations in both directions, shuffled; travel is 20 mm."""
    grid = np.array([0.5, 0.8, 1.25, 2.0, 3.15, 5.0, 8.0, 12.5, 20.0])
    frequencies = random.choice(grid, int(random.integers(5, 7)), replace=False)
    plan = [(f, a, d) for f in frequencies for a in (0.3, 1.0, 4.0) for d in (1.0, -1.0)]
    frequency, acceleration, direction = np.array(plan)[random.permutation(len(plan))].T
    count = len(plan)
    start = np.cumsum(random.uniform(40.0, 150.0, count))
    return Design(
        frequency_hz=frequency,
        amplitude_m=np.round(np.minimum(acceleration / (2.0 * np.pi * frequency) ** 2, 20e-3), 9),
        direction=direction,
        temperature_c=np.round(
            21.0 + np.sin(start / 900.0 + random.uniform(0.0, 6.0)) + random.normal(0.0, 0.3, count), 2
        ),
        humidity_percent=np.round(random.uniform(35.0, 55.0, count), 1),
        start_s=np.round(start, 1),
        phase_rad=random.uniform(0.0, 2.0 * np.pi, count),
        duration_s=float(random.choice([12.0, 16.0, 20.0])),
        rate_hz=float(random.choice([100.0, 200.0])),
    )


def in_sigma(design: Design, sensor: Sensor, noise: Noise) -> Floats:
    """Both parts of every run's output over its acceleration, divided by their standard deviation."""
    phase = 2.0 * np.pi * design.frequency_hz[:, None] * design.time_s + design.phase_rad[:, None]
    acceleration = (2.0 * np.pi * design.frequency_hz) ** 2 * design.amplitude_m
    wave = np.exp(-1j * (phase + 0.5 * np.pi))
    response = 2.0 * np.mean(accel_v(design, sensor) * wave, axis=1) / (design.direction * acceleration)
    per_amplitude = np.sqrt(2.0 / len(design.time_s))
    of_output = noise.accel_v * per_amplitude / acceleration
    of_motion = sensor.gain * noise.laser_m * per_amplitude / np.sqrt(HEADS) / design.amplitude_m
    white = response / np.hypot(of_output, of_motion)
    return np.concatenate([white.real, white.imag])


def size_of(design: Design, sensor: Sensor, noise: Noise, effects: dict[str, float]) -> float:
    """The effects' visible size: their change of the responses, in sigma, after the gain has been fitted again."""
    flat = in_sigma(design, sensor, noise)
    change = in_sigma(design, sensor.with_effects(effects), noise) - flat
    return float(np.linalg.norm(change - flat * (flat @ change) / (flat @ flat)))


def drawn_effect(
    random: np.random.Generator, name: str, design: Design, sensor: Sensor, noise: Noise, size_sigma: float
) -> dict[str, float]:
    """The effect's parameters at the size wanted: its direction drawn, its length scaled."""
    names = (KNOWN | UNKNOWN)[name]
    signs = [1.0 if part in NEVER_NEGATIVE else random.choice([-1.0, 1.0]) for part in names]
    unit = {part: TRIAL_STEP[part] * sign * random.uniform(0.6, 1.0) for part, sign in zip(names, signs, strict=True)}
    # Between the drive's frequencies: near one of them, and far from the rest.
    place = {"part_rad_s": 2.2 * np.pi * float(np.sort(design.frequency_hz)[len(design.frequency_hz) // 2])}
    fixed = place if name == "resonating-part" else {}
    scale = size_sigma / size_of(design, sensor, noise, unit | fixed)
    return {part: float(value * scale) for part, value in unit.items()} | fixed


def drawn(seed: int) -> Trial:
    """A trial: none, one or two known effects, or one that is in no catalogue, of 8 to 20 sigma each."""
    random = np.random.default_rng([20261130, seed])
    design = drawn_design(random)
    sensor = Sensor(gain=random.uniform(0.5, 2.0), zero_v=random.normal(0.0, 0.05))
    noise = Noise(accel_v=random.uniform(1e-4, 1e-3), laser_m=random.uniform(5e-8, 3e-7))
    kind = random.choice(["none", "one", "two", "unknown"], p=[0.1, 0.55, 0.15, 0.2])
    count = {"none": 0, "one": 1, "two": 2, "unknown": 1}[str(kind)]
    family = sorted(UNKNOWN if kind == "unknown" else KNOWN)
    hidden: dict[str, float] = {}
    effects: dict[str, float] = {}
    for name in map(str, random.choice(family, count, replace=False)):
        given = drawn_effect(random, name, design, sensor, noise, float(random.uniform(8.0, 20.0)))
        hidden[name] = size_of(design, sensor, noise, given)
        effects |= given
    return Trial(design, sensor.with_effects(effects), noise, hidden)


def write(trial: Trial, seed: int, bundle: Path) -> None:
    """The bundle: what a laboratory would hand over, with gaps, and nothing of the truth."""
    design, noise = trial.design, trial.noise
    random = np.random.default_rng([30112026, seed])
    shape = (len(design.frequency_hz), len(design.time_s))
    output = accel_v(design, trial.sensor) + random.normal(0.0, noise.accel_v, shape)
    stage = motion_m(design) + random.normal(0.0, noise.stage_m, shape)
    heads = [
        head_m(design) + random.normal(0.0, noise.laser_m, shape) + random.normal(0.0, 1e-3) for _ in range(HEADS)
    ]
    for head in heads:
        head[random.random(shape) < 2e-3] = np.nan
    (bundle / "runs").mkdir(parents=True)
    (bundle / "recording.toml").write_text(recording_toml())
    with (bundle / "runs.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        names = ["run_id", "mounting", "direction", "frequency_hz", "amplitude_mm", "temperature_c"]
        rows.writerow([*names, "humidity_percent", "start_s"])
        for run in range(shape[0]):
            columns = {"t_s": design.time_s, "stage_x_mm": 1e3 * stage[run], "accel_v": output[run]}
            columns |= {f"laser_{number}_mm": 1e3 * head[run] for number, head in enumerate(heads, start=1)}
            np.savez(bundle / "runs" / f"r{run + 1:02d}.npz", **columns)
            rows.writerow([
                f"r{run + 1:02d}", 1 if design.direction[run] > 0.0 else 2, int(design.direction[run]),
                design.frequency_hz[run], round(1e3 * design.amplitude_m[run], 6), design.temperature_c[run],
                design.humidity_percent[run], design.start_s[run],
            ])  # fmt: skip


def recording_toml() -> str:
    lines = ["format = 1", 'experiment = "frequency-response"', 'title = "a shaker elsewhere"', "", "[constants]"]
    lines += [f"g_m_s2 = {G_M_S2}", "", "[channels.accel_v]", 'unit = "V"', 'kind = "accelerometer"']
    for head in range(1, HEADS + 1):
        lines += [f"[channels.laser_{head}_mm]", 'unit = "mm"', 'kind = "displacement"']
        lines += [f"[lasers.laser_{head}_mm]", "tilt_deg = 5.0"]
    return "\n".join([*lines, ""])
