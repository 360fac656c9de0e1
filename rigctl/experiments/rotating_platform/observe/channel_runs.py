"""The channels of a run: observables, noise, covariance, and what the baseline's parameters multiply."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.integrate import cumulative_trapezoid

from rigctl.analysis.kept import Kept, Packed, Recipe
from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.cells import GEOMETRY, STATE, Cells
from rigctl.experiments.rotating_platform.observe.estimators import OUTPUTS
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, READINGS
from rigctl.experiments.rotating_platform.observe.reducer import Reducer
from rigctl.experiments.rotating_platform.observe.run_noise import (
    Likelihood,
    RunNoise,
    Scatter,
    covariance_within,
    joint_covariance,
    likelihood,
    run_noise,
    white_sizes,
)
from rigctl.experiments.rotating_platform.observe.store_reduction import VERSION, PlatformRun

_NOISE_VERSION = 3
"""Of what is kept: counted up whenever `_likelihood` would give other numbers of the same cells."""

_REWEIGHTED = 5
# Of fewer none can be spared: then the first group stays, though a run may begin without a turn.
_FEWEST_GROUPS = 6
_RANK = 1e-12
_SAME = 1e-3
"""A column of the geometry that differs by less from period to period does so by the encoder's noise."""
_TOLD = 0.1
"""A gain of a tilt, which is 1, is told by a run where its standard error is less."""
_LEAST_LEVEL = 1e-3
"""Of an output's noise over that of the others, each in units of what white noise makes of it."""
_TILTS = {STATE.index("c_z"): GEOMETRY.index("cz_cos"), STATE.index("c_y"): GEOMETRY.index("cy_cos")}
"""Where the tilts commanded stand among `STATE`, and their products with the cosine among `GEOMETRY`."""
_OWN_COMMAND = {"z": 0, "y": 3}
"""Which of the baseline's columns is the tilt commanded along a channel's axis."""


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


def noise_recipe(lines_hz: Sequence[float]) -> Recipe:
    """By which runs with these lines taken off tell their noise."""
    return Recipe("noise rotating-platform", _NOISE_VERSION, (VERSION, *map(float, lines_hz)))


def channel_runs(runs: Sequence[PlatformRun], kept: Kept) -> tuple[list[ChannelRun], dict[str, str]]:
    """All runs in both channels, z first, and by run_id why one is left out.

    What each run tells of its noise is `kept` by `noise_recipe`.
    """
    reduced: list[tuple[PlatformRun, list[Reducer], list[Likelihood]]] = []
    left_out: dict[str, str] = {}
    for run in runs:
        try:
            reducers = [Reducer(run.cells, channel) for channel in CHANNELS]
            told = [
                kept.once(f"{run.run_id} {each.channel}", partial(_told_by, each), Likelihood.unpacked)
                for each in reducers
            ]
        except DataError as error:
            left_out[run.run_id] = f"run {run.run_id}: {error}"
        else:
            reduced.append((run, reducers, told))
    channels: list[ChannelRun] = []
    for number, (run, reducers, told) in enumerate(reduced):
        # A run's own spectrum comes first; those of the other runs of the channel are its prior (decision 022).
        others = [likelihoods for place, (_, _, likelihoods) in enumerate(reduced) if place != number]
        noises = [run_noise(own, [each[i] for each in others], run.cells.period_s) for i, own in enumerate(told)]
        try:
            channels += [channel_run(run, *each) for each in zip(reducers, noises, strict=True)]
        except DataError as error:
            left_out[run.run_id] = f"run {run.run_id}: {error}"
    return channels, left_out


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


def followed_columns(cells: Cells) -> tuple[FloatArray, FloatArray]:
    """What a bias may follow: means and ramps, shape (cells, columns). Such a bias is to be found, and no noise.

    Temperature, the tilts that were commanded and a laboratory's own columns, each where it varies, straight and
    squared; of a tilt its integral too, which a leak makes a bias of.
    """
    state, spread = cells.state, bias_columns(cells)[1][:, 1]
    means: list[FloatArray] = []
    ramps: list[FloatArray] = []
    for number in (*_TILTS, STATE.index("temperature_c"), *range(len(STATE), state.shape[1])):
        column = state[:, number]
        size = float(np.abs(column).max())
        if not np.isfinite(size) or not np.ptp(column) > _SAME * size:
            continue
        about: FloatArray = np.asarray((column - column.mean()) / size)
        ramp = np.zeros_like(about)
        if number in _TILTS:
            # At rest the cosine is the sign of the dwell.
            ramp = cells.ramps[:, _TILTS[number]] * cells.sign / size
        means += [about, about**2]
        ramps += [ramp, 2.0 * about * ramp]
        if number in _TILTS:
            means.append(cumulative_trapezoid(about, cells.time_s, initial=0))
            ramps.append(about * spread)
    shape = (cells.period.size, len(means))
    return np.array(means).T.reshape(shape), np.array(ramps).T.reshape(shape)


def _told_by(reducer: Reducer) -> Packed:
    try:
        return _likelihood(reducer).packed()
    except (DataError, np.linalg.LinAlgError) as error:
        raise DataError(
            f"{READINGS[reducer.channel]} does not tell its noise ({error}): look whether it hangs at one value, "
            "and mark the run invalid"
        ) from error


def _likelihood(reducer: Reducer) -> Likelihood:
    """What a run tells of its noise once everything slow and everything that is fitted has been taken off."""
    cells = reducer.cells
    means, ramps = baseline_columns(cells, reducer.channel)
    bias_means, bias_ramps = bias_columns(cells)
    followed_means, followed_ramps = followed_columns(cells)
    columns = np.column_stack([means, bias_means, followed_means])
    whole = np.column_stack([ramps, bias_ramps, followed_ramps])
    outputs = reducer.series(reducer.readings()[:, None])[:, :, 0]
    fitted = reducer.series(reducer.of(columns, whole))
    # Where a turn leaves something behind, every period has the same of it, but for one that begins without a turn.
    same = np.broadcast_to(np.eye(len(OUTPUTS))[:, None], (*outputs.shape, len(OUTPUTS)))
    design = np.concatenate([fitted, same], axis=2)
    if np.isfinite(outputs[0]).sum() > _FEWEST_GROUPS:
        outputs, design = outputs[:, 1:], design[:, 1:]
    seen = np.isfinite(outputs)
    # All periods have it already, and what was fitted to the rest of such a column would be noise.
    alike = _alike(np.where(seen[:, :, None], design[:, :, : means.shape[1]], np.nan))
    design[:, :, : means.shape[1]][:, :, alike] = 0.0
    size = np.linalg.norm(design[seen], axis=0)
    design = design / np.where(size > 0.0, size, 1.0)
    residuals = outputs
    white = white_sizes(reducer.sampled, reducer.per_group)[:, None]
    # An output in which an external signal is large must not count by its size: by what is left of it.
    for _ in range(_REWEIGHTED):
        level = np.nanstd(residuals, axis=1, keepdims=True) / white
        # Where few periods leave nothing of one it must not outweigh all others.
        level = np.maximum(level, _LEAST_LEVEL * np.median(level))
        scale = white * np.where(level > 0.0, level, 1.0)
        matrix = (design / scale[:, :, None])[seen]
        coefficients, *_ = np.linalg.lstsq(matrix, (outputs / scale)[seen], rcond=_RANK)
        residuals = outputs - design @ coefficients
    residuals = np.where(seen, residuals, 0.0)
    spanned, sizes, ways = np.linalg.svd(matrix, full_matrices=False)
    rank = int((sizes > _RANK * sizes[0]).sum())
    # What of a wave lies in groups that are left out is lost as what lies in the fit.
    unseen = np.flatnonzero(~seen)
    fitted_columns = np.zeros((*outputs.shape, rank + unseen.size))
    fitted_columns[seen, :rank] = spanned[:, :rank]
    fitted_columns.reshape(seen.size, -1)[unseen, rank + np.arange(unseen.size)] = 1.0
    # The command along its own axis alone, and where the outputs tell it: one that differs from what all periods have
    # by an encoder's noise would bring its own noise along.
    command, known = _OWN_COMMAND[reducer.channel], 0.0
    if float(np.linalg.norm(ways[:rank, command] / sizes[:rank])) < _TOLD * size[command]:
        known = float(coefficients[command] / size[command])
    sigma, dof = reducer.bin_scatter(known * columns[:, command], known * whole[:, command])
    return likelihood(
        reducer.sampled,
        reducer.per_group,
        residuals,
        fitted_columns,
        # Of one period: sigma is that of the mean over all of them.
        Scatter(reducer.bin_weights(), sigma**2 * (dof + 1.0), dof),
    )


def _alike(columns: FloatArray) -> BoolArray:
    """Which columns (outputs, groups, columns) are the same in all groups."""
    apart = np.nansum((columns - np.nanmean(columns, axis=1, keepdims=True)) ** 2, axis=(0, 1))
    return np.asarray(apart < _SAME**2 * np.nansum(columns**2, axis=(0, 1)))


def channel_run(run: PlatformRun, reducer: Reducer, noise: RunNoise) -> ChannelRun:
    """A channel of a run with its observables and, from its noise, their covariance; `DataError` for none."""
    covariance = joint_covariance(noise, reducer.sampled, reducer.per_group, reducer.groups.tolist())
    sigma = np.sqrt(np.diag(covariance))
    # Levels and slopes differ by powers of ten: correlations are factorised, sigmas kept apart.
    factor = _factor(covariance / np.outer(sigma, sigma), reducer.channel)
    # A group that has lost periods is noisier; its correlations stay what they are.
    sigma = sigma * np.tile(np.sqrt(reducer.per_group / reducer.members) * reducer.inflation(), 4)
    bins = len(reducer.bins)
    whole = np.zeros((sigma.size + bins, sigma.size + bins))
    whole[: sigma.size, : sigma.size] = factor
    around = covariance_within(noise, run.cells.sample_rate_hz, reducer.bin_weights())
    bin_sigma = np.sqrt(np.diag(around) / reducer.bin_periods())
    if bins:
        size = np.sqrt(np.diag(around))
        whole[sigma.size :, sigma.size :] = _factor(around / np.outer(size, size), reducer.channel)
    return ChannelRun(run, reducer.channel, reducer, reducer.readings(), noise, np.append(sigma, bin_sigma), whole)


def _factor(correlation: FloatArray, channel: str) -> FloatArray:
    """The lower triangle of a correlation matrix; `DataError` for what is none."""
    try:
        factor = np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        factor = np.full_like(correlation, np.nan)
    if not np.isfinite(factor).all():
        raise DataError(
            f"the noise of {READINGS[channel]} is that of no spectrum; look at its samples, or mark the run invalid"
        )
    return np.asarray(factor)
