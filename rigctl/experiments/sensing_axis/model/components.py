"""A recording's amplitudes as the workbench's vectors: series, noise pools, blocks, covariates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from rigctl.experiments.sensing_axis.model.parameters import by_configuration, by_mounting
from rigctl.experiments.sensing_axis.model.prediction import Observer
from rigctl.experiments.sensing_axis.model.templates import templates
from rigctl.experiments.sensing_axis.observe.observables import HARMONICS, Amplitudes, RunObservables
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL
from rigctl.workbench.study import NoisePool, Observations, Series

BLOCKS_OF_TIME = 5
"""Stretches of a recording that are held out in turn, where mountings are too few for that."""

_SET_APART = 0.01
# With two, each would be predicted from a single other one.
_MIN_MOUNTINGS = 3

_LINES = tuple(
    f"{'' if h == 1 else f'{h} '}nu {part}" for h in range(1, HARMONICS + 1) for part in ("in-phase", "quadrature")
)

COMPONENTS = {"accelerometer": ("DC", *_LINES), "laser": _LINES}
"""What is observed of each kind of channel: a head's zero is arbitrary."""


def series_of(heads: Sequence[str]) -> tuple[Series, ...]:
    """All series of a recording: those of the accelerometer, then of each head."""
    accel = [Series(ACCEL, component, "V") for component in COMPONENTS["accelerometer"]]
    return (*accel, *(Series(head, component, "m") for head in heads for component in COMPONENTS["laser"]))


@dataclass(frozen=True)
class Stacked:
    """Observations and where they are among all runs and series: `present` (runs, series)."""

    observations: Observations
    present: BoolArray


def stacked(runs: Sequence[RunObservables], heads: Sequence[str]) -> Stacked:
    """Everything that was measured of `runs`, run by run."""
    series = series_of(heads)
    value, sigma, dof = (np.array(rows) for rows in zip(*(_row(run, heads) for run in runs), strict=True))
    # Relative weights only: most of a mean's noise lies below 1/T, where no run's spectrum reaches.
    sigma[:, 0] = _pooled_mean_sigma(runs)
    present = np.isfinite(value) & np.isfinite(sigma) & (sigma > 0.0)
    run_of, series_index = (np.asarray(each, dtype=np.intp) for each in np.nonzero(present))
    pools, pool_of = _pools(runs, series, run_of, series_index, dof[present])
    axes = list(dict.fromkeys(run.axis for run in runs))
    covariates = _covariates(runs)
    return Stacked(
        Observations(
            run_ids=tuple(run.run_id for run in runs),
            series=series,
            pools=pools,
            value=value[present],
            sigma=sigma[present],
            series_of=series_index,
            run_of=run_of,
            pool_of=pool_of,
            # Another axis is another sensor: its drift has nothing to do with this one's.
            group_of=np.array([axes.index(run.axis) for run in runs], dtype=np.intp)[run_of],
            block_of=_blocks(runs),
            covariates=covariates,
            angle="theta_deg",
            frequency="frequency_hz",
            templates=templates(runs, covariates, present),
        ),
        present,
    )


def _with_mean(amplitudes: ComplexArray) -> FloatArray:
    # A mean is real.
    return np.delete(_real_parts(amplitudes, 0), 1, axis=1)


def _lines(amplitudes: ComplexArray) -> FloatArray:
    return _real_parts(amplitudes, 1)


def _real_parts(amplitudes: ComplexArray, first: int) -> FloatArray:
    """In phase and quadrature of each harmonic from the `first` on, side by side, (runs, 2 harmonics)."""
    return np.ascontiguousarray(amplitudes[:, first:]).view(np.float64)


observed = Observer(_with_mean, _lines)
"""A prediction in all series, shape (runs, series)."""


def _row(run: RunObservables, heads: Sequence[str]) -> tuple[list[float], list[float], list[float]]:
    accel = run.accel_v
    # Of the mean no degrees of freedom: its sigma is a relative weight.
    values, sigmas, dofs = [float(accel.value[0].real)], [float(accel.sigma[0])], [0.0]
    for channel in (accel, *(run.lasers_m.get(head) for head in heads)):
        for h in range(1, HARMONICS + 1):
            values += _pair(channel, h)
            sigmas += [float(channel.sigma[h]) if channel else np.nan] * 2
            dofs += [float(channel.dof[h]) if channel else np.nan] * 2
    return values, sigmas, dofs


def _pair(channel: Amplitudes | None, harmonic: int) -> list[float]:
    if channel is None:
        return [np.nan, np.nan]
    value = complex(channel.value[harmonic])
    if channel.clock is not None and harmonic == 1:
        # What turns the fundamental has become the offset of the channel's clock.
        return [value.real, np.nan]
    return [value.real, value.imag]


def _pooled_mean_sigma(runs: Sequence[RunObservables]) -> FloatArray:
    """Relative sigma of each run's mean, from all runs of its axis, configuration and length: one run's own spectrum
    tells it with few degrees of freedom, and weights that scatter with the noise would bias the fit."""
    keys = [(run.axis, run.configuration, round(run.duration_s)) for run in runs]
    variance = np.array([float(run.accel_v.sigma[0]) ** 2 for run in runs])
    mean = {key: np.mean([v for k, v in zip(keys, variance, strict=True) if k == key]) for key in set(keys)}
    return np.sqrt([mean[key] for key in keys])


def _pools(
    runs: Sequence[RunObservables],
    series: Sequence[Series],
    run_of: IntArray,
    series_index: IntArray,
    dof: FloatArray,
) -> tuple[tuple[NoisePool, ...], IntArray]:
    """One pool for all means, ordered in time where that is known, and one per axis, configuration and series."""
    timed = all(np.isfinite(run.start_s) for run in runs)
    names: dict[str, list[float]] = {}
    index = []
    for run, which, known in zip(run_of, series_index, dof, strict=True):
        component = series[which]
        name = "DC" if component.component == "DC" else f"{by_configuration(runs[run])} {component.name}"
        names.setdefault(name, []).append(known)
        index.append(list(names).index(name))
    # Without times nothing tells which runs are neighbours: their means count as independent.
    order = "start_s" if timed else None
    pools = tuple(
        NoisePool(name, 0.0, order) if name == "DC" else NoisePool(name, float(np.mean(known)))
        for name, known in names.items()
    )
    return pools, np.array(index, dtype=np.intp)


def _blocks(runs: Sequence[RunObservables]) -> IntArray:
    """Mountings where there are a few of them, else stretches of time, as long as each other in runs."""
    mountings = list(dict.fromkeys(by_mounting(run) for run in runs))
    if len(mountings) >= _MIN_MOUNTINGS:
        return np.array([mountings.index(by_mounting(run)) for run in runs], dtype=np.intp)
    start = np.array([run.start_s for run in runs])
    order = np.argsort(start, kind="stable") if np.isfinite(start).all() else np.arange(len(runs))
    blocks = np.empty(len(runs), dtype=np.intp)
    blocks[order] = np.arange(len(runs)) * min(BLOCKS_OF_TIME, len(runs)) // len(runs)
    return blocks


def _covariates(runs: Sequence[RunObservables]) -> dict[str, FloatArray]:
    # Counted anew in the order of runs, which is that of time: any other numbers mean the same.
    mountings = list(dict.fromkeys(run.mounting for run in runs))
    columns = {
        "theta_deg": [float(np.degrees(run.theta_rad)) for run in runs],
        "frequency_hz": [run.frequency_hz for run in runs],
        "amplitude_mm": [1e3 * run.amplitude_m for run in runs],
        "temperature_c": [run.temperature_c for run in runs],
        "start_s": [run.start_s for run in runs],
        # Zero: nobody wrote from which side.
        "approach": [run.approach if run.approach else np.nan for run in runs],
        "mounting": [1.0 + mountings.index(run.mounting) for run in runs],
    }
    if np.ptp(columns["amplitude_mm"]) < _SET_APART * np.max(columns["amplitude_mm"]):
        del columns["amplitude_mm"]  # the stage's own error is no condition
    for name in sorted({name for run in runs for name in run.extra} - set(columns)):
        columns[name] = [run.extra.get(name, np.nan) for run in runs]
    return {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
