"""How large an effect is in sigma of a scan after everything else is fitted: from the world alone, by differences.

Two noiseless worlds, with and without the effect, differ by its signature; worlds with another null, gain, mounting,
level, roll or resonance span what a fit would absorb of it; a world with noise less the same without it gives the
sigmas. No model takes part, so a wrong model cannot make its own trials easy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from benchmarks.blind_sampler import Design, Perturbation, SampledRun, sample_world
from rigctl.core.arrays import BoolArray, FloatArray
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.mounting import Mounting
from simulators.worlds.rotations import Configuration, rotation

HARMONICS = 3
ACCEL = "accel_v"
EffectTable = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Yardstick:
    """A scan's sigmas (n,) and an orthonormal basis (n, m), whitened, of what a fit absorbs."""

    nature: BenchSettings
    design: Design
    quiet: FloatArray
    sigma: FloatArray
    absorbed: FloatArray

    def sigmas(self, effects: EffectTable, perturbation: Perturbation | None = None) -> tuple[float, float]:
        """How many sigma this is after refit, and the share of it that is left then."""
        world = with_effects(self.nature, effects)
        signature = (_vector(sample_world(world, self.design, perturbation, noisy=False)) - self.quiet) / self.sigma
        left = signature - self.absorbed @ (self.absorbed.T @ signature)
        total = float(np.linalg.norm(signature))
        return float(np.linalg.norm(left)), float(np.linalg.norm(left)) / total if total else 0.0


def yardstick(nature: BenchSettings, design: Design) -> Yardstick:
    """The sigmas and the fit's freedom of a scan in this nature."""
    quiet_runs = sample_world(nature, design, noisy=False)
    quiet = _vector(quiet_runs)
    sigma = _sigmas(_vector(sample_world(nature, design)) - quiet, quiet_runs)
    columns = [*_by_mounting(nature, design, quiet, quiet_runs), *_by_sensor(nature, design, quiet, quiet_runs)]
    whitened = np.stack([column / np.linalg.norm(column) for column in (c / sigma for c in columns)], axis=1)
    basis, values, _ = np.linalg.svd(whitened, full_matrices=False)
    return Yardstick(nature, design, quiet, sigma, basis[:, values > 1e-7 * values[0]])


def with_effects(nature: BenchSettings, effects: EffectTable) -> BenchSettings:
    """The nature with these effects on top of its own."""
    merged = {**nature.effects, **{name: dict(sizes) for name, sizes in effects.items()}}
    return BenchSettings.model_validate({**nature.model_dump(), "effects": merged})


def _by_mounting(
    nature: BenchSettings, design: Design, quiet: FloatArray, runs: Sequence[SampledRun]
) -> list[FloatArray]:
    """A mounting's rotation, null and level."""
    numbers = np.concatenate([np.full(len(_of(run)), run.conditions["mounting"]) for run in runs])
    tweaks: list[Callable[[Mounting], Mounting]] = [_turned(axis) for axis in range(3)] + [_strained]
    columns = []
    for tweak in tweaks:
        change = _vector(sample_world(nature, design, noisy=False, tweak=tweak)) - quiet
        columns += [np.where(numbers == number, change, 0.0) for number in np.unique(numbers)]
    level = _levels(runs)
    return [*columns, *(np.where(numbers == number, level, 0.0) for number in np.unique(numbers))]


def _by_sensor(
    nature: BenchSettings, design: Design, quiet: FloatArray, runs: Sequence[SampledRun]
) -> list[FloatArray]:
    """Gain and resonance of a sensor in a configuration, and the guide's roll."""
    size = [len(_of(run)) for run in runs]
    volts = np.concatenate([_is_accel(run) for run in runs])
    columns = []
    for sensor in sorted({(run.conditions["axis"], run.conditions["configuration"]) for run in runs}):
        own = [(run.conditions["axis"], run.conditions["configuration"]) == sensor for run in runs]
        columns.append(np.where(np.repeat(own, size) & volts, quiet, 0.0))
        member = f"{sensor[0]},{sensor[1]}"
        s2, damping = nature.resonance(*sensor)
        for change in ((1.01, 1.0), (1.0, 1.01)):
            table = {f"inv_w0_squared[{member}]": s2 * change[0], f"damping[{member}]": damping * change[1]}
            base = _resonances(nature)
            world = with_effects(nature, {"resonance": {**base, **table}})
            columns.append(_vector(sample_world(world, design, noisy=False)) - quiet)
    rolling = with_effects(nature, {"roll-gravity": {"rho1": nature.size("roll-gravity", "rho1") + 1e-4}})
    return [*columns, _vector(sample_world(rolling, design, noisy=False)) - quiet]


def _resonances(nature: BenchSettings) -> dict[str, float]:
    found: dict[str, float] = {}
    for axis in nature.sensors:
        for configuration in get_args(Configuration):
            s2, damping = nature.resonance(axis, configuration)
            found |= {f"inv_w0_squared[{axis},{configuration}]": s2, f"damping[{axis},{configuration}]": damping}
    return found


def _turned(axis: int) -> Callable[[Mounting], Mounting]:
    turn = rotation(1e-5 * np.eye(3)[axis])
    return lambda mounting: replace(mounting, table_from_cube=turn @ mounting.table_from_cube)


def _strained(mounting: Mounting) -> Mounting:
    """The sensing axis moved in the cube, horizontally on the turntable: another null for the same cube."""
    along = mounting.table_from_cube.T @ np.array([1.0, 0.0, 0.0])
    moved = mounting.sensing_axis_cube + 1e-5 * along
    return replace(mounting, sensing_axis_cube=moved / np.linalg.norm(moved))


def _sigmas(noise: FloatArray, runs: Sequence[SampledRun]) -> FloatArray:
    """rms of the noise over all runs of a sensor at a frequency, for each of a run's numbers."""
    kinds: dict[tuple[object, ...], list[int]] = {}
    place = 0
    for run in runs:
        where = (run.conditions["axis"], run.conditions["configuration"], run.conditions["frequency_hz"])
        for name, component in _of(run):
            kinds.setdefault((*where, name, component), []).append(place)
            place += 1
    sigma = np.empty(len(noise))
    for places in kinds.values():
        sigma[places] = np.sqrt(np.mean(noise[places] ** 2))
    return sigma


def _of(run: SampledRun) -> list[tuple[str, str]]:
    """The numbers a run gives, by channel and component; a head's zero is arbitrary."""
    components = [f"{part} {h}" for h in range(1, HARMONICS + 1) for part in ("in", "out")]
    heads = sorted(name for name in run.columns if name.startswith("laser_"))
    return [(ACCEL, "mean"), *((ACCEL, c) for c in components), *((head, c) for head in heads for c in components)]


def _is_accel(run: SampledRun) -> BoolArray:
    return np.array([name == ACCEL and component != "mean" for name, component in _of(run)])


def _levels(runs: Sequence[SampledRun]) -> FloatArray:
    return np.array([float(component == "mean") for run in runs for _, component in _of(run)])


def _vector(runs: Sequence[SampledRun]) -> FloatArray:
    """All numbers of all runs: harmonics referred to the encoder's phase, by plain linear least squares."""
    found = []
    for run in runs:
        w = 2.0 * np.pi * float(run.conditions["frequency_hz"])
        t_s, x = run.columns["t_s"], run.columns["stage_x_mm"]
        basis = np.stack(
            [np.ones_like(t_s)] + [f(h * w * t_s) for h in range(1, HARMONICS + 1) for f in (np.cos, np.sin)], axis=1
        )
        heads = sorted(name for name in run.columns if name.startswith("laser_"))
        columns = np.stack([x, run.columns[ACCEL], *(run.columns[name] for name in heads)], axis=1)
        fitted, *_ = np.linalg.lstsq(basis, columns, rcond=None)
        amplitudes = fitted[1::2] - 1j * fitted[2::2]
        turn = np.conj(amplitudes[0, 0] / abs(amplitudes[0, 0])) ** np.arange(1, HARMONICS + 1)
        referred = amplitudes[:, 1:] * turn[:, None]
        parts = np.stack([referred.real, referred.imag], axis=1).reshape(2 * HARMONICS, -1)
        found += [fitted[:1, 1], parts[:, 0], *(parts[:, i] for i in range(1, parts.shape[1]))]
    return np.concatenate(found)
