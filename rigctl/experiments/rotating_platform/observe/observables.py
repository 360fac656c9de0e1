"""The observables of a recording as one vector: period by period, around the turns, with their covariance."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.cells import AFTER_S, BEFORE, BEFORE_S, GEOMETRY, Cells
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.observe.reducer import Bin, Reducer
from rigctl.experiments.rotating_platform.observe.run_noise import (
    Likelihood,
    RunNoise,
    Scatter,
    covariance_within,
    joint_covariance,
    likelihood,
    run_noise,
)
from rigctl.experiments.rotating_platform.observe.store_reduction import PlatformRun
from rigctl.workbench.study import NoisePool, Observations, Series

OUTPUTS = ("accel mean", "accel slope", "bias mean", "bias slope")
AFTER_TURN, BEFORE_TURN, SPECTRUM = "after turn", "before turn", "spectrum"
COMPONENTS = (*OUTPUTS, AFTER_TURN, BEFORE_TURN, SPECTRUM)
UNITS = ("m/s2", "m/s3", "m/s2", "m/s3", "m/s2", "m/s2", "1")

READ: Mapping[str, str] = {"z": "m_z", "y": "m_y"}
"""How the calibrated reading of a channel is called."""

SERIES = tuple(
    Series(READ[channel], component, unit)
    for channel in CHANNELS
    for component, unit in zip(COMPONENTS, UNITS, strict=True)
)

_STRETCHES = 4
_REWEIGHTED = 5
_FEWEST_GROUPS = 6
_KNOWN_DOF = 1e6


@dataclass(frozen=True)
class ChannelRun:
    """One channel of a run: how it is reduced, its observables, its noise, their covariance's parts."""

    run: PlatformRun
    channel: str
    reducer: Reducer
    value: FloatArray
    noise: RunNoise
    sigma: FloatArray
    factor: FloatArray

    @property
    def outputs(self) -> int:
        """How many of the observables are outputs of periods; the others are bins."""
        return 4 * self.reducer.groups.size


@dataclass(frozen=True)
class Row:
    """What observables go by: a group of periods, or a bin around the turns."""

    run: int
    covariates: Mapping[str, float]
    stretch: int


def channel_runs(runs: Sequence[PlatformRun]) -> tuple[list[ChannelRun], dict[str, str]]:
    """All runs in both channels, z first, and by run_id why one is left out."""
    reducers: list[tuple[PlatformRun, list[Reducer]]] = []
    left_out: dict[str, str] = {}
    for run in runs:
        try:
            reducers.append((run, [Reducer(run.cells, channel) for channel in CHANNELS]))
        except DataError as error:
            left_out[run.run_id] = f"run {run.run_id}: {error}"
    found: list[ChannelRun] = []
    told = {channel: [_likelihood(own[i]) for _, own in reducers] for i, channel in enumerate(CHANNELS)}
    for number, (run, own) in enumerate(reducers):
        for reducer in own:
            likelihoods = told[reducer.channel]
            others = likelihoods[:number] + likelihoods[number + 1 :]
            noise = run_noise(likelihoods[number], others, run.cells.period_s)
            found.append(channel_run(run, reducer, noise))
    return found, left_out


def baseline_columns(cells: Cells, channel: str) -> tuple[FloatArray, FloatArray]:
    """What multiplies tilt_gain, accel_z0, accel_y0, and what c_Y adds: means and ramps, shape (cells, 4)."""
    names = {"z": (("cz_cos", 1), ("cos", 1), ("sin", -1), ("cy_sin", -1))}
    names["y"] = (("cz_sin", 1), ("sin", 1), ("cos", 1), ("cy_cos", 1))
    columns = [GEOMETRY.index(name) for name, _ in names[channel]]
    signs = np.array([sign for _, sign in names[channel]], dtype=np.float64)
    return cells.geometry[:, columns] * signs, cells.ramps[:, columns] * signs


def bias_columns(cells: Cells) -> tuple[FloatArray, FloatArray]:
    """What multiplies bias and rate of a run: means and ramps, shape (cells, 2)."""
    ones = np.ones(cells.period.size)
    within = cells.time_s - 0.5 * cells.periods * cells.period_s
    # Of a time within a cell: sum (u - mean u) t, t = u / (2 f_s).
    spread = cells.count * (cells.count**2 - 1.0) / 3.0 / (2.0 * cells.sample_rate_hz)
    return np.stack([ones, within], axis=1), np.stack([np.zeros_like(ones), spread], axis=1)


def stacked(
    channels: Sequence[ChannelRun], imagined: Collection[str] = (), peaks: Mapping[str, float] | None = None
) -> Observations:
    """The vector of all observables, then those of the spectra; `DataError` when there is none.

    An `imagined` run is one row of covariates. `peaks`, by run and channel, are the highest of a spectrum, in sigma.
    """
    if not channels:
        raise DataError("no valid run could be reduced: there is nothing to fit")
    rows: list[Row] = []
    place: dict[tuple[str, str, int], int] = {}
    runs = list(dict.fromkeys(each.run.run_id for each in channels))
    series_of, run_of, pool_of = [], [], []
    pools: list[NoisePool] = []
    factors: list[tuple[IntArray, FloatArray]] = []
    at = 0
    for each in channels:
        number = runs.index(each.run.run_id)
        if each.run.run_id in imagined:
            key = (each.run.run_id, "whole", 0)
            if key not in place:
                place[key] = len(rows)
                rows.append(_group_row(number, each, 0))
            own_rows = [place[key]] * each.value.size
        else:
            own_rows = _rows_of(number, each, rows, place)
        first = len(COMPONENTS) * CHANNELS.index(each.channel)
        own_series = [first + output for output in range(4) for _ in each.reducer.groups]
        own_series += [first + 4 + (one.number == BEFORE) for one in each.reducer.bins]
        name = f"{each.run.run_id} {READ[each.channel]}"
        pools.append(NoisePool(name, each.noise.dof))
        run_of += own_rows
        series_of += own_series
        pool_of += [len(pools) - 1] * len(own_rows)
        factors.append((np.arange(at, at + len(own_rows)), each.factor))
        at += len(own_rows)
    sigma = [each.sigma for each in channels]
    value = [each.value for each in channels]
    for channel in CHANNELS:
        pools.append(NoisePool(f"{READ[channel]} spectrum", _KNOWN_DOF))
        for number, run_id in enumerate(runs):
            peak = (peaks or {}).get(f"{run_id} {channel}")
            if peak is None:
                continue
            series_of.append(len(COMPONENTS) * CHANNELS.index(channel) + COMPONENTS.index(SPECTRUM))
            pool_of.append(len(pools) - 1)
            run_of.append(next(i for i, row in enumerate(rows) if row.run == number))
            value.append(np.array([peak]))
            sigma.append(np.ones(1))
    alone = len(runs) == 1
    return Observations(
        run_ids=tuple(runs[row.run] for row in rows),
        series=SERIES,
        pools=tuple(pools),
        value=np.concatenate(value),
        sigma=np.concatenate(sigma),
        series_of=np.array(series_of),
        run_of=np.array(run_of),
        pool_of=np.array(pool_of),
        group_of=np.zeros(len(series_of), dtype=np.intp),
        block_of=np.array([row.stretch if alone else row.run for row in rows]),
        covariates=_covariates(rows),
        factors=tuple(factors),
    )


def _rows_of(number: int, each: ChannelRun, rows: list[Row], place: dict[tuple[str, str, int], int]) -> list[int]:
    """The row of each observable; those that the other channel has made already are shared."""
    own: list[int] = []
    for group in each.reducer.groups.tolist():
        key = (each.run.run_id, "group", group)
        if key not in place:
            place[key] = len(rows)
            rows.append(_group_row(number, each, group))
        own.append(place[key])
    own *= 4
    for one in each.reducer.bins:
        key = (each.run.run_id, "bin", 2 * one.number + (one.sign < 0))
        if key not in place:
            place[key] = len(rows)
            rows.append(_bin_row(number, each, one))
        own.append(place[key])
    return own


def _likelihood(reducer: Reducer) -> Likelihood:
    """What a run tells of its noise once everything slow and everything that is fitted has been taken off."""
    cells = reducer.cells
    means, ramps = baseline_columns(cells, reducer.channel)
    bias_means, bias_ramps = bias_columns(cells)
    warmer = cells.state[:, 2] - np.nanmean(cells.state[:, 2]) if np.isfinite(cells.state[:, 2]).all() else None
    slow = [] if warmer is None or not np.ptp(warmer) > 0.0 else [warmer, warmer**2]
    columns = np.column_stack([means, bias_means, *slow])
    whole = np.column_stack([ramps, bias_ramps, *(np.zeros_like(each) for each in slow)])
    given = reducer.series(reducer.readings()[:, None])[:, :, 0]
    fitted = reducer.series(reducer.of(columns, whole))
    # Where a turn leaves something behind, every period has the same of it, but for one that begins without a turn.
    same = np.broadcast_to(np.eye(len(OUTPUTS))[:, None], (*given.shape, len(OUTPUTS)))
    design = np.concatenate([fitted, same], axis=2)
    if given.shape[1] > _FEWEST_GROUPS:
        given, design = given[:, 1:], design[:, 1:]
    seen = np.isfinite(given)
    size = np.linalg.norm(design[seen], axis=0)
    design = design / np.where(size > 0.0, size, 1.0)
    left = given
    # An output in which an external signal is large must not count by its size: by what is left of it.
    for _ in range(_REWEIGHTED):
        scale = np.nanstd(left, axis=1, keepdims=True)
        scale = np.where(scale > 0.0, scale, 1.0)
        matrix = (design / scale[:, :, None])[seen]
        found, *_ = np.linalg.lstsq(matrix, (given / scale)[seen], rcond=1e-12)
        left = given - design @ found
    left = np.where(seen, left, 0.0)
    rank = int(np.linalg.matrix_rank(design[seen]))
    sigma, dof = reducer.bin_scatter()
    return likelihood(
        reducer.sampled,
        reducer.per_group,
        left,
        rank if rank < np.count_nonzero(seen) else left.size,
        Scatter(reducer.bin_weights(), sigma**2 * (dof + 1.0), dof),
    )


def channel_run(run: PlatformRun, reducer: Reducer, noise: RunNoise) -> ChannelRun:
    """A channel of a run with its observables and, from its noise, their covariance."""
    covariance = joint_covariance(noise, reducer.sampled, reducer.per_group, reducer.groups.tolist())
    sigma = np.sqrt(np.diag(covariance))
    factor = np.linalg.cholesky(covariance / np.outer(sigma, sigma))
    sigma = sigma * np.tile(np.sqrt(reducer.per_group / reducer.members) * reducer.inflation(), 4)
    bins = len(reducer.bins)
    whole = np.zeros((sigma.size + bins, sigma.size + bins))
    whole[: sigma.size, : sigma.size] = factor
    around = covariance_within(noise, run.cells.sample_rate_hz, reducer.bin_weights())
    bin_sigma = np.sqrt(np.diag(around) / reducer.bin_periods())
    if bins:
        size = np.sqrt(np.diag(around))
        whole[sigma.size :, sigma.size :] = np.linalg.cholesky(around / np.outer(size, size))
    return ChannelRun(run, reducer.channel, reducer, reducer.readings(), noise, np.append(sigma, bin_sigma), whole)


def _group_row(number: int, each: ChannelRun, group: int) -> Row:
    cells, reducer = each.run.cells, each.reducer
    first = group * reducer.per_group
    last = min(first + reducer.per_group, cells.periods)
    own = (cells.period >= first) & (cells.period < last)
    share = cells.count[own] / cells.count[own].sum()
    middle_s = 0.5 * (first + last) * cells.period_s
    covariates = {
        "time_s": _start_s(each.run.conditions) + middle_s,
        "within_run_s": middle_s - 0.5 * cells.periods * cells.period_s,
        "c_z_m_s2": float(share @ cells.state[own, 0]),
        "c_y_m_s2": float(share @ cells.state[own, 1]),
        "temperature_c": _temperature(each.run.conditions, float(share @ cells.state[own, 2])),
        "modulation_frequency_hz": 1.0 / cells.period_s,
        "since_turn_s": math.nan,
        "stop": math.nan,
        **_own_columns(each.run.conditions),
    }
    return Row(number, covariates, (_STRETCHES * first) // max(cells.periods, 1))


def _bin_row(number: int, each: ChannelRun, one: Bin) -> Row:
    cells = each.run.cells
    own = (cells.bin == one.number) & (cells.sign == one.sign)
    after = AFTER_S[one.number] if one.number != BEFORE else -BEFORE_S
    covariates = {
        "time_s": _start_s(each.run.conditions) + 0.5 * cells.periods * cells.period_s,
        "within_run_s": math.nan,
        "c_z_m_s2": float(cells.state[own, 0].mean()),
        "c_y_m_s2": float(cells.state[own, 1].mean()),
        "temperature_c": _temperature(each.run.conditions, float(cells.state[own, 2].mean())),
        "modulation_frequency_hz": 1.0 / cells.period_s,
        "since_turn_s": after,
        "stop": float(one.sign),
        **_own_columns(each.run.conditions),
    }
    return Row(number, covariates, 0)


_KNOWN = (
    "pattern",
    "modulation_period_s",
    "sample_rate_hz",
    "external",
    "v_z_v",
    "external_period_s",
    "g_sign",
    "temperature_c",
    "start_s",
    "guard_s",
    "lead_s",
    "rotation_s",
    "external_period_asked_s",
    "v_y_v",
    "periods",
)


def own_columns(conditions: Mapping[str, Any]) -> dict[str, float]:
    """A laboratory's own columns of runs.csv that are numbers."""
    return _own_columns(conditions)


def _own_columns(conditions: Mapping[str, Any]) -> dict[str, float]:
    return {
        name: float(value)
        for name, value in conditions.items()
        if name not in _KNOWN and isinstance(value, int | float) and not isinstance(value, bool)
    }


def _start_s(conditions: Mapping[str, Any]) -> float:
    return float(conditions.get("start_s", math.nan))


def _temperature(conditions: Mapping[str, Any], sampled: float) -> float:
    return sampled if math.isfinite(sampled) else float(conditions.get("temperature_c", math.nan))


def _covariates(rows: Sequence[Row]) -> dict[str, FloatArray]:
    names = list(dict.fromkeys(name for row in rows for name in row.covariates))
    return {name: np.array([row.covariates.get(name, math.nan) for row in rows]) for name in names}
