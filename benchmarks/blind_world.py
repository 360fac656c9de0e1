"""Blind trials: natures drawn by seed with hidden effects of known size, recorded as bundles that do not tell.

`draw` says what is hidden and how large it is in sigma of the scan; `record` writes the bundle another laboratory
would send, and the truth beside it in a file of its own.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.blind_noise import with_noise
from benchmarks.blind_sampler import Design, Perturbation, SampledRun, columns_of, on_still_ground, sample_world
from benchmarks.blind_sizes import with_effects, yardstick
from rigctl.campaign.bundle.bundle import write_bundle
from rigctl.campaign.recording import ChannelInfo, Header, ImportReport, LaserInfo, Recording, RunRecord
from simulators.keyed_random import generator
from simulators.worlds.bench_settings import BenchSettings, isa_twin

Kind = Literal["none", "one", "two", "three", "unknown"]
KINDS: tuple[Kind, ...] = ("none", "one", "two", "three", "unknown")
HIDDEN = {"none": 0, "one": 1, "two": 2, "three": 3, "unknown": 0}

UNITS: dict[str, dict[str, float]] = {
    "pitch-gravity": {"pi1": 1e-4},
    "bench-recoil": {"c": 1e-7},
    "quadratic": {"K2": 1e-3},
    "time-skew": {"tau": 1e-4},
    "thermal-bias": {"bT": 1e-4},
    "thermal-gain": {"kT": 1e-4},
    "cable-hysteresis": {"h": 1e-6},
    "encoder-eccentricity": {"e1": 1e-5, "e2": 1e-5},
    "axis-tilt": {"eps_cos": 1e-6, "eps_sin": 1e-6},
    "yaw": {"psi1": 1e-4},
    "yaw-lever": {"lever_cos": 1e-5, "lever_sin": 1e-5},
    "laser-cosine": {"dt[laser_1_mm]": 1e-5},
    "laser-nonlinearity": {"q[laser_1_mm]": 1e-4},
    "laser-crosstalk": {"chi": 1e-5},
    "bias-drift": {"rate": 1e-8},
    "gain-drift": {"rate": 1e-8},
    "null-drift": {"rate": 1e-9},
}
"""Each effect of the catalogue in a direction of its parameters; the size drawn multiplies it.

`roll-gravity` and `resonance` are in every nature and known; `mains-pickup` changes no harmonic and is drawn by the
level of its line.
"""

ABSORBED = ("bench-recoil", "yaw-lever", "laser-crosstalk", "time-skew")
"""Never drawn unless asked for: null, gain, mounting and (time-skew) the sensor's damping imitate them."""

LINE = "mains-pickup"
LINE_UNIT_V = 1e-6
LINE_HZ = (20.0, 45.0)
LINE_NOISE_V_RTHZ = 4e-6
"""The meter's noise, and what far above its resonance the sensor lets through of the ground's."""


def _friction(run: SampledRun) -> Any:
    return run.gain_v_per_m_s2 * np.sign(np.gradient(run.columns["stage_x_mm"])) * 1e-6


def _gain_cos_2theta(run: SampledRun) -> Any:
    volts = run.columns["accel_v"]
    return 1e-4 * math.cos(2.0 * math.radians(run.conditions["theta_deg"])) * (volts - volts.mean())


def _gain_by_frequency(run: SampledRun) -> Any:
    volts = run.columns["accel_v"]
    return 1e-4 * float(run.conditions["frequency_hz"]) * (volts - volts.mean())


def _gain_by_pressure(run: SampledRun) -> Any:
    volts = run.columns["accel_v"]
    return 1e-4 * (float(run.conditions["pressure_hpa"]) - 1013.0) * (volts - volts.mean())


def _cubic_quadrature(run: SampledRun) -> Any:
    w = 2.0 * math.pi * float(run.conditions["frequency_hz"])
    speed_m_s = 1e-3 * np.gradient(run.columns["stage_x_mm"], run.columns["t_s"])
    return run.gain_v_per_m_s2 * 1e-5 * w**2 * speed_m_s


def _pressure_hpa(number: int) -> float:
    return round(1013.0 + 5.0 * float(generator("pressure", number).standard_normal()), 2)


def _pressure_bias(run: SampledRun) -> Any:
    return np.full_like(run.columns["t_s"], 1e-5 * (float(run.conditions["pressure_hpa"]) - 1013.0))


UNKNOWN: dict[str, Perturbation] = {
    "angle-4theta": Perturbation(angle_rad=lambda theta: 1e-6 * math.sin(4.0 * theta)),
    "gain-cos-2theta": Perturbation(volts=_gain_cos_2theta),
    "gain-by-frequency": Perturbation(volts=_gain_by_frequency),
    "quadrature-w3": Perturbation(volts=_cubic_quadrature),
    "pressure-bias": Perturbation(volts=_pressure_bias, columns={"pressure_hpa": _pressure_hpa}),
    "gain-by-pressure": Perturbation(volts=_gain_by_pressure, columns={"pressure_hpa": _pressure_hpa}),
    "friction": Perturbation(volts=_friction),
}
"""Physics that no catalogue has, each in a unit; the size drawn multiplies it."""

IMITATED = {"angle-4theta": "laser-cosine", "gain-by-frequency": "pitch-gravity"}
"""Not drawn unless asked for: on these runs the catalogue has the same thing by another name, and no analysis can
call it unknown. Where a side head sees its face, at 20 and 30 deg, an error of four times the angle is the head's own
scale (correlation 0.99); beside a free gain and a free resonance three frequencies leave one degree of freedom, which
a gain that goes with w and gravity's 1/w^2 share."""


@dataclass(frozen=True)
class Foreign:
    """How another laboratory's recording differs from ours.

    `colour` replaces the ground's noise by one of `blind_noise.SHAPES`, at the same level beyond `knee_hz`. `gaps` is
    the share of runs with a hole in the middle, `lengths` the range by which run lengths vary, `missing` the columns
    of runs.csv or of the runs that are left out, `extra` covariates of no importance.
    """

    colour: str | None = None
    knee_hz: float = 0.05
    gaps: float = 0.0
    lengths: tuple[float, float] = (1.0, 1.0)
    missing: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()


@dataclass(frozen=True)
class Truth:
    """What is hidden: parameters in SI by effect, sizes in sigma, the share no fit absorbs, nature's own numbers."""

    seed: int
    kind: Kind
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    unknown: str | None = None
    unknown_scale: float = 0.0
    sigma: dict[str, float] = field(default_factory=dict)
    keep: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Trial:
    """One blind trial: nature with its secrets, and what is measured in it."""

    nature: BenchSettings
    design: Design
    truth: Truth


def draw(
    seed: int,
    kind: Kind,
    design: Design | None = None,
    *,
    sigma: float | tuple[float, float] = (6.0, 20.0),
    among: Sequence[str] | None = None,
) -> Trial:
    """What is hidden in trial `seed`: the same seed gives the same.

    `sigma` is the size after refit, or the range it is drawn from; `among` says which effects may be drawn, by
    default all that a fit does not absorb.
    """
    rng = generator(seed, "blind", kind)
    measured = replace(design or Design(), order_seed=seed)
    nature = _nuisances(rng, seed)
    lengths = unit_sizes(design or Design())
    candidates = list(among or (name for name in (*UNITS, LINE) if name not in ABSORBED))
    hidden = [str(name) for name in rng.choice(candidates, size=HIDDEN[kind], replace=False)] if HIDDEN[kind] else []
    foreign = [name for name in among or UNKNOWN if name in UNKNOWN and (among or name not in IMITATED)]
    unknown = str(rng.choice(foreign)) if kind == "unknown" else None
    drawn = {name: _size(rng, sigma) for name in (*hidden, *([unknown] if unknown else []))}
    signs = {name: float(rng.choice([-1.0, 1.0])) for name in drawn}
    scales = {name: signs[name] * _scale(name, size / lengths[name][0]) for name, size in drawn.items()}
    effects = {name: _scaled(name, scales[name], rng) for name in hidden}
    truth = Truth(
        seed=seed,
        kind=kind,
        effects=effects,
        unknown=unknown,
        unknown_scale=scales[unknown] if unknown else 0.0,
        sigma=drawn,
        keep={name: lengths[name][1] for name in drawn},
    )
    return Trial(with_effects(nature, effects), measured, truth)


def sample(trial: Trial, foreign: Foreign | None = None) -> Recording:
    """The trial's recording, in memory: nothing in it tells what is hidden."""
    odd = foreign or Foreign()
    perturbation = _perturbation(trial.truth)
    if odd.colour is None:
        runs = sample_world(trial.nature, trial.design, perturbation)
    else:
        silent = on_still_ground(trial.nature)
        runs = sample_world(silent, trial.design, perturbation, noisy=True)
        level_v_rthz = trial.nature.ground.asd_m_s2_rthz * max(run.gain_v_per_m_s2 for run in runs)
        runs = with_noise(runs, odd.colour, asd_v_rthz=level_v_rthz, knee_hz=odd.knee_hz, seed=trial.truth.seed)
    rng = generator(trial.truth.seed, "foreign")
    runs = [_as_found_elsewhere(run, odd, rng) for run in runs]
    return _recording(trial.nature, runs)


def record(trial: Trial, directory: Path, foreign: Foreign | None = None) -> Path:
    """Write the trial's bundle to `directory`, the truth beside it to `directory`.truth.json; returns the latter."""
    write_bundle(sample(trial, foreign), directory)
    beside = directory.with_name(directory.name + ".truth.json")
    beside.write_text(json.dumps(asdict(trial.truth), indent=1), encoding="utf-8")
    return beside


def unit_sizes(design: Design, cache: Path = Path("out/blind-sizes")) -> dict[str, tuple[float, float]]:
    """Sigma after refit of one unit of each effect in this design, and its kept share; worked out once and kept."""
    key = repr((design, _nominal().model_dump(), UNITS, sorted(UNKNOWN), LINE_NOISE_V_RTHZ))
    path = cache / f"{hashlib.sha256(key.encode()).hexdigest()[:16]}.json"
    if path.exists():
        return {name: (each[0], each[1]) for name, each in json.loads(path.read_text()).items()}
    measure = yardstick(_nominal(), design)
    found = {name: measure.sigmas({name: unit}) for name, unit in UNITS.items()}
    found |= {name: measure.sigmas({}, unit) for name, unit in UNKNOWN.items()}
    runs = sum(len(points) for _, points in design.points)
    # Its phase is each run's own: what shows is the sum of the runs' powers; noise scatters it by 2 sqrt(runs).
    power = runs * design.dwell_s * (LINE_UNIT_V / LINE_NOISE_V_RTHZ) ** 2
    found[LINE] = (power / (2.0 * math.sqrt(runs)), 1.0)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found))
    return found


def _scale(name: str, ratio: float) -> float:
    """By how much to multiply a unit: a line's size in sigma goes with its power."""
    return math.sqrt(ratio) if name == LINE else ratio


def _nominal() -> BenchSettings:
    return _nature(isa_twin(0), daily_k=3.0, seed=0)


def _nature(base: BenchSettings, *, seed: int, daily_k: float, **changes: Any) -> BenchSettings:
    temperature = base.temperature.model_copy(update={"daily_k": daily_k})
    return BenchSettings.model_validate(
        {**base.model_dump(), "seed": seed, "temperature": temperature.model_dump(), **changes}
    )


def _nuisances(rng: np.random.Generator, seed: int) -> BenchSettings:
    """Gains, resonances, axes, roll, ground and room, all of them as uncertain as in life."""
    base = isa_twin(seed)
    sensors = {}
    for name, sensor in base.sensors.items():
        dumped = sensor.model_dump()
        gain, resonance = 1.0 + 0.005 * rng.standard_normal(), 1.0 + 0.005 * rng.standard_normal()
        for configuration in ("pendulum", "flag"):
            dumped[configuration]["gain_v_per_m_s2"] *= gain
            dumped[configuration]["frequency_hz"] *= resonance
            dumped[configuration]["q"] = float(rng.uniform(8.0, 12.0))
        dumped["true_axis"] = tuple(np.array(sensor.true_axis) + 1e-3 * rng.standard_normal(3))
        sensors[name] = dumped
    return _nature(
        base,
        seed=seed,
        daily_k=float(rng.uniform(2.0, 4.0)),
        sensors=sensors,
        effects={"roll-gravity": {"rho1": float(rng.uniform(0.5, 1.5) * 9.7e-5)}},
        ground={**base.ground.model_dump(), "asd_m_s2_rthz": 1e-6},
    )


def _size(rng: np.random.Generator, sigma: float | tuple[float, float]) -> float:
    return float(sigma) if isinstance(sigma, int | float) else float(rng.uniform(*sigma))


def _scaled(name: str, scale: float, rng: np.random.Generator) -> dict[str, float]:
    if name == LINE:
        return {"amplitude": LINE_UNIT_V * abs(scale), "frequency": float(rng.uniform(*LINE_HZ))}
    return {parameter: scale * unit for parameter, unit in UNITS[name].items()}


def _perturbation(truth: Truth) -> Perturbation | None:
    if truth.unknown is None:
        return None
    unit, scale = UNKNOWN[truth.unknown], truth.unknown_scale
    volts = unit.volts
    return Perturbation(
        angle_rad=lambda theta: scale * unit.angle_rad(theta),
        volts=None if volts is None else lambda run: scale * volts(run),
        columns=unit.columns,
    )


def _as_found_elsewhere(run: SampledRun, odd: Foreign, rng: np.random.Generator) -> SampledRun:
    count = len(run.columns["t_s"])
    period = float(run.columns["t_s"][1]) * float(run.conditions["frequency_hz"])
    keep = np.arange(count) < max(count * rng.uniform(*odd.lengths), 3.0 / period)
    if rng.uniform() < odd.gaps:
        keep &= ~((np.arange(count) > 0.45 * keep.sum()) & (np.arange(count) < 0.5 * keep.sum()))
    columns = {name: values[keep] for name, values in run.columns.items() if name not in odd.missing}
    conditions = {name: value for name, value in run.conditions.items() if name not in odd.missing}
    conditions |= {name: round(float(rng.standard_normal()), 3) for name in odd.extra}
    return replace(run, columns=columns, conditions=conditions)


def _recording(nature: BenchSettings, runs: Sequence[SampledRun]) -> Recording:
    heads = sorted(name for name in columns_of(runs) if name.startswith("laser_"))
    kinds: Mapping[str, str] = {"stage_x_mm": "position", "accel_v": "accelerometer"}
    header = Header(
        "sensing-axis",
        title="blind trial",
        constants={"g_m_s2": nature.g_m_s2, "gain_v_per_m_s2": 100.0},
        channels={
            name: ChannelInfo(
                unit="V" if name == "accel_v" else "mm",
                kind=kinds.get(name, "displacement"),
                full_scale=nature.range_v if name == "accel_v" else None,
            )
            for name in ("accel_v", "stage_x_mm", *heads)
        },
        lasers={name: LaserInfo(tilt_deg=nature.lasers[name].tilt_deg) for name in heads},
    )
    records = [RunRecord(str(run.number), str(run.number), "", run.conditions) for run in runs]
    columns = {str(run.number): run.columns for run in runs}
    return Recording(header, tuple(records), columns, ImportReport(len(records)))
