"""One blind trial of the rotating platform: a bench, its noise and the effects that act on it, drawn at random.

Sizes are set in sigma of what the recording can show (``platform_size``), or are those that the page calls typical
where these can be seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.foreign.platform_bundle import Habits, Noise
from tests.foreign.platform_size import Sight, kept_sign
from tests.foreign.platform_world import CHANNELS, Platform, Run, readings

Random = np.random.Generator

KNOWN: dict[str, tuple[str, ...]] = {
    "off-centre": ("r_cos", "r_sin"),
    "recovery": ("e",),
    "recovery-signed": ("e_signed",),
    "thermal-bias": ("b1",),
    "gain-drift": ("k1",),
    "line": ("line",),
    "cross-axis": ("kx",),
    "quadratic": ("K2",),
    "gain-asymmetry": ("e_abs",),
    "clock-skew": ("r_cos", "r_sin"),
    "filter-ringing": ("r_cos", "r_sin"),
    "tide": ("tide_cos", "tide_sin"),
}
"""Effects of the page that a recording can show, with the parameters that each channel has of it."""
UNKNOWN = {"supply-gain": ("per_v",), "creeping-bias": ("creep",)}
TYPICAL = {
    "r_cos": 0.05, "r_sin": 0.05, "e": 1e-6, "e_signed": 1e-6, "b1": 1e-5, "k1": 1e-4 / 3600.0, "line": 1e-6,
    "kx": 1e-2, "K2": 3e-5, "e_abs": 1e-4, "tide_cos": 1e-6, "tide_sin": 1e-6, "per_v": 1e-3, "creep": 1e-6,
}  # fmt: skip
MOST_M_S2 = 2e-3
"""What must change a reading by more to be seen is no hidden effect."""
LINE_SIZE = 2.5
"""A line has an amplitude and a phase in every run, and its frequency is searched: that takes more sigma."""


@dataclass(frozen=True)
class Trial:
    """What is hidden: the effects by name, their size in sigma, and the parameters that the world was given."""

    runs: list[Run]
    bench: Platform
    noise: Noise
    habits: Habits
    hidden: dict[str, float]

    @property
    def parameters(self) -> dict[str, float]:
        return dict(self.bench.effects)


def drawn_runs(random: Random) -> list[Run]:
    """Ten to fourteen runs of three patterns and two periods, at levels in random order; one of a sine at times."""
    rate_hz = float(random.choice([4.0, 5.0, 8.0, 10.0]))
    turning_s = float(random.choice([12.0, 16.0, 20.0]))
    count = int(random.integers(10, 15))
    levels = random.permutation(np.resize([0.0, 0.5, 1.0, 1.5, -0.75], count))
    tilted = random.random() < 0.5
    found, start_s = [], float(round(random.uniform(0.0, 3e4)))
    for number in range(count):
        period_s = float(random.choice([60.0, 120.0, 300.0], p=[0.6, 0.25, 0.15]))
        run = Run(
            pattern=str(random.choice(["a", "b", "c", "c_tm"], p=[0.15, 0.25, 0.4, 0.2])),
            period_s=period_s,
            periods={60.0: int(random.integers(8, 13)), 120.0: 5, 300.0: 3}[period_s],
            rate_hz=rate_hz,
            turning_s=turning_s,
            external="constant",
            v_z=float(levels[number]),
            external_period_s=0.0,
            v_y=float(random.choice([-0.5, 0.0, 0.8])) if tilted else 0.0,
            start_s=start_s,
        )
        found.append(run)
        start_s += float(round(run.duration_s + random.choice([60.0, 400.0, 5000.0], p=[0.5, 0.3, 0.2])))
    if random.random() < 0.4:
        found[-1] = replace(found[-1], external="sine", v_z=1.0, external_period_s=1500.0)
    return found


def drawn_bench(random: Random) -> Platform:
    """Scale factors some per cent off; the Y servo's error is the chain's: the page has no gain of the Y command."""
    error = {channel: float(random.normal(0.0, 0.02)) for channel in CHANNELS}
    return Platform(
        assumed_gain_v={"z": 910.0, "y": 870.0},
        assumed_servo_gain_v={"z": 790.0, "y": 780.0},
        gain_error=error,
        servo_gain_error={"z": float(random.normal(0.0, 0.02)), "y": error["y"]},
        rest_m_s2={channel: float(random.normal(0.0, 3e-4)) for channel in CHANNELS},
        bias_m_s2={channel: float(random.normal(0.0, 1e-3)) for channel in CHANNELS},
        forward=bool(random.random() < 0.3),
        law=str(random.choice(["cycloid", "quintic"])),
        temperature={
            "offset_c": float(random.normal(0.0, 0.5)),
            "cycle_c": float(random.uniform(0.3, 0.8)),
            "cycle_s": float(random.uniform(800.0, 2400.0)),
            "day_c": float(random.uniform(0.0, 1.5)),
            "phase": float(random.uniform(0.0, 6.0)),
            "day_phase": float(random.uniform(0.0, 6.0)),
        },
        supply_seed=int(random.integers(1_000_000)),
    )


def drawn_noise(random: Random) -> Noise:
    return Noise(
        white=4.45e-11 * random.uniform(0.3, 1.5),
        flicker=1.26e-13 * random.uniform(0.3, 1.5),
        exponent=random.uniform(1.2, 1.8),
        pendulum=random.uniform(1e-8, 3e-8),
        angle_rad=random.uniform(1e-7, 5e-6),
    )


def spread(random: Random, stems: tuple[str, ...]) -> dict[str, float]:
    """Amplitudes of one channel or of both, in the proportion drawn, at about the typical size."""
    channels = [("z",), ("y",), ("z", "y")][int(random.integers(3))]
    names = [f"{stem}[{channel}]" for channel in channels for stem in stems]
    ways = random.choice([-1.0, 1.0], len(names)) * random.uniform(0.5, 1.0, len(names))
    return {name: TYPICAL[name[:-3]] * float(way) for name, way in zip(names, ways, strict=True)}


def fixed(random: Random, name: str, rate_hz: float) -> dict[str, float]:
    """What is not an amplitude: times, frequencies, switches."""
    drawn_of: dict[str, Callable[[], dict[str, float]]] = {
        "recovery": lambda: {"T_r": float(np.exp(random.uniform(np.log(3.0), np.log(40.0))))},
        "recovery-signed": lambda: {"T_r": float(np.exp(random.uniform(np.log(3.0), np.log(40.0))))},
        "line": lambda: {"line_hz": float(random.uniform(0.08, 0.45) * rate_hz)},
        "clock-skew": lambda: {"delay_s": float(random.uniform(0.15, 0.6) * 4.0 / rate_hz)},
        "filter-ringing": lambda: {"filter": 1.0},
        "creeping-bias": lambda: {"creep_turns": float(random.integers(5, 10))},
    }
    return drawn_of.get(name, dict)()


def prepared(random: Random, names: list[str], bench: Platform) -> Platform:
    """A centrifugal force in an unspoilt record takes a flag that ends early."""
    if "off-centre" in names:
        return replace(bench, mask_short_s=float(random.uniform(0.25, 0.6)))
    return bench


def line_sigma(runs: list[Run], noise: Noise, effects: dict[str, float]) -> float:
    """A line's size in the samples of all runs, in sigma."""
    f = effects["line_hz"]
    density = noise.white + noise.flicker / f**noise.exponent
    seconds = sum(run.duration_s - run.periods * run.turning_s for run in runs)
    amplitudes = [value for name, value in effects.items() if name.startswith("line[")]
    return float(np.sqrt(sum(value**2 for value in amplitudes) * seconds / (2.0 * density)))


def sized(sight: Sight, noise: Noise, name: str, effects: dict[str, float]) -> float:
    if name == "line":
        return line_sigma(sight.runs, noise, effects) / LINE_SIZE
    return sight.size(effects)


def drawn_effect(random: Random, name: str, sight: Sight, noise: Noise) -> dict[str, float]:
    """The effect's parameters: every fourth time of typical size if that is seen, else scaled to 8 to 20 sigma."""
    kept = fixed(random, name, sight.runs[0].rate_hz)
    unit = spread(random, (KNOWN | UNKNOWN)[name])
    size = sized(sight, noise, name, unit | kept)
    wanted = float(random.uniform(8.0, 20.0))
    scale = 1.0 if random.random() < 0.25 and size >= wanted else wanted / size
    return {part: value * scale for part, value in unit.items()} | kept


def too_large(sight: Sight, effects: dict[str, float]) -> bool:
    """Whether an effect of this size would be seen by the eye in the samples that count."""
    with_it = sight.bench.with_effects(effects)
    for run in sight.runs:
        kept = kept_sign(run, sight.bench) != 0.0
        before, after = readings(run, sight.bench), readings(run, with_it)
        if any(np.abs(after[channel] - before[channel])[kept].max() > MOST_M_S2 for channel in CHANNELS):
            return True
    return False


def drawn(seed: int) -> Trial:
    """A trial: none, one or two known effects, or one that is in no catalogue, of 8 sigma or more each."""
    random = np.random.default_rng([20261123, seed])
    runs, bench, noise = drawn_runs(random), drawn_bench(random), drawn_noise(random)
    kind = str(random.choice(["none", "one", "two", "unknown"], p=[0.1, 0.55, 0.15, 0.2]))
    count = {"none": 0, "one": 1, "two": 2, "unknown": 1}[kind]
    family = sorted(UNKNOWN if kind == "unknown" else KNOWN)
    names = [str(name) for name in random.choice(family, count, replace=False)]
    bench = prepared(random, names, bench)
    sight = Sight(runs, bench, noise)
    effects: dict[str, float] = {}
    hidden: dict[str, float] = {}
    while names:
        name = names.pop(0)
        parameters = drawn_effect(random, name, sight, noise)
        if set(parameters) & set(effects) or too_large(sight, parameters):
            others = sorted(set(family) - {name, "off-centre", *names, *hidden})
            names.append(str(random.choice(others)))
            continue
        hidden[name] = sized(sight, noise, name, parameters)
        effects |= parameters
    warm = "thermal-bias" in hidden or bool(random.random() < 0.5)
    habits = Habits(
        wrapped_angle=bench.forward and bool(random.random() < 0.5),
        with_temperature=warm,
        with_biases=bool(random.random() < 0.5),
        dropped=float(random.choice([0.0, 0.0, 0.01])),
    )
    return Trial(runs, bench.with_effects(effects), noise, habits, hidden)
