"""From samples to observables: one sine fit per run, noise pooled over the runs of an axis in a configuration."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.errors import DataError
from rigctl.experiments.sensing_axis.chain import ComplexArray, FloatArray
from rigctl.experiments.sensing_axis.observables import HARMONICS, Amplitudes, RunObservables
from rigctl.signals.noise import Spectrum, pooled_psd, spectrum
from rigctl.signals.sine_fit import HarmonicBasis, refine_frequency

STAGE, ACCEL = "stage_x_mm", "accel_v"
LASER_PREFIX = "laser_"
MM = 1e-3
NOISE_DOF = 40.0
"""Degrees of freedom sought for the noise at a line: known to 22 %, from a band of 0.1 Hz in a minute's record."""

_MIN_KEPT_SAMPLES = 0.5


@dataclass(frozen=True)
class ReducedChannel:
    """Referred amplitudes of one channel (index 0 the mean) and the spectrum of what the sine fit left."""

    value: ComplexArray
    noise: Spectrum


@dataclass(frozen=True)
class ReducedRun:
    """One run after its sine fit; sigmas need the other runs too."""

    run_id: str
    conditions: Mapping[str, Any]
    frequency_hz: float
    duration_s: float
    motion_m: ComplexArray
    channels: Mapping[str, ReducedChannel]


def reduce_run(run_id: str, conditions: Mapping[str, Any], samples: Mapping[str, FloatArray]) -> ReducedRun:
    """Fit the drive's harmonics to every channel of one run.

    Raises `DataError`, naming the run, when the record cannot be fitted.
    """
    try:
        stage = refine_frequency(samples["t_s"], MM * samples[STAGE], float(conditions["frequency_hz"]))
        reference = complex(stage.fit.amplitudes[0])
        channels = {ACCEL: _channel(stage.basis, samples[ACCEL], reference)}
    except DataError as error:
        raise DataError(f"run {run_id}: {error}") from error
    for name, column in samples.items():
        if name.startswith(LASER_PREFIX):
            laser = _laser(stage.basis, MM * column, reference)
            if laser is not None:
                channels[name] = laser
    order = np.arange(1, HARMONICS + 1)
    referred = stage.fit.amplitudes_referred_to(reference)
    return ReducedRun(
        run_id,
        dict(conditions),
        stage.frequency_hz,
        stage.basis.duration_s,
        referred * (-1j) ** order,
        channels,
    )


def observables(runs: Sequence[ReducedRun], *, harmonics: int = HARMONICS) -> list[RunObservables]:
    """Observables of all runs, in their order, with the noise of each axis and configuration pooled:
    beside a bump of the ground's noise the runs driven at other frequencies tell it best.

    Sigmas are worked out up to `harmonics` and NaN beyond: a null search needs the first only.
    """
    pools: dict[tuple[Any, ...], dict[str, list[Spectrum]]] = {}
    for run in runs:
        pool = pools.setdefault(_pool(run), {})
        for name, channel in run.channels.items():
            pool.setdefault(name, []).append(channel.noise)
    spectra = {key: {name: pooled_psd(parts) for name, parts in pool.items()} for key, pool in pools.items()}
    levels: dict[tuple[Any, ...], float] = {}

    def density(run: ReducedRun, name: str, frequency_hz: float) -> float:
        key = (*_pool(run), name, round(frequency_hz, 4))
        if key not in levels:
            levels[key] = spectra[_pool(run)][name].level(frequency_hz, target_dof=NOISE_DOF).psd
        return levels[key]

    return [_observed(run, density, harmonics) for run in runs]


def noise_density(runs: Iterable[ReducedRun], frequency_hz: float) -> float:
    """One-sided density of the accelerometer's output noise at a frequency, pooled over runs [V^2/Hz]."""
    return pooled_psd(run.channels[ACCEL].noise for run in runs).level(frequency_hz, target_dof=NOISE_DOF).psd


def _observed(run: ReducedRun, density: Callable[[ReducedRun, str, float], float], harmonics: int) -> RunObservables:
    def amplitudes(name: str) -> Amplitudes:
        channel = run.channels[name]
        mean = channel.noise.dc_noise(run.duration_s).variance
        lines = np.full(HARMONICS, np.nan)
        for h in range(1, harmonics + 1):
            lines[h - 1] = density(run, name, h * run.frequency_hz) / run.duration_s
        return Amplitudes(channel.value, np.sqrt([mean, *lines]))

    given = run.conditions
    return RunObservables(
        run_id=run.run_id,
        axis=str(given["axis"]),
        configuration=str(given["configuration"]),
        mounting=int(given["mounting"]),
        theta_rad=math.radians(float(given["theta_deg"])),
        approach=float(given.get("approach") or 0.0),
        frequency_hz=run.frequency_hz,
        temperature_c=_number(given.get("temperature_c")),
        start_s=_number(given.get("start_s")),
        duration_s=run.duration_s,
        motion_m=run.motion_m,
        accel_v=amplitudes(ACCEL),
        lasers_m={name: amplitudes(name) for name in run.channels if name != ACCEL},
        faces={head: str(given[key]) for head in run.channels if given.get(key := face_column(head))},
    )


def face_column(head: str) -> str:
    """The column of runs.csv that says which face a head looks at: laser_1_mm -> laser_1_face."""
    return f"{head.removesuffix('_mm')}_face"


def _channel(basis: HarmonicBasis, column: FloatArray, reference: complex) -> ReducedChannel:
    fit = basis.fit(column)
    value = np.concatenate([[complex(fit.dc)], fit.amplitudes_referred_to(reference)])
    return ReducedChannel(value, spectrum(fit.residuals, basis))


def _laser(basis: HarmonicBasis, column: FloatArray, reference: complex) -> ReducedChannel | None:
    """A head's channel, without the samples that lost their target; None when too few are left."""
    seen = np.isfinite(column)
    if seen.all():
        return _channel(basis, column, reference)
    if seen.mean() < _MIN_KEPT_SAMPLES:
        return None
    try:
        kept = HarmonicBasis(basis.t_s[seen], basis.frequency_hz, basis.harmonics)
    except DataError:
        return None
    return _channel(kept, column[seen], reference)


def _pool(run: ReducedRun) -> tuple[Any, ...]:
    return tuple(run.conditions[name] for name in ("axis", "configuration"))


def _number(value: Any) -> float:
    return math.nan if value in (None, "") else float(value)
