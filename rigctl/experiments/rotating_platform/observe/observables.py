"""The observables of a recording as one vector: period by period, around the turns, with their covariance."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from rigctl.campaign.layout import COMMON_FIELDS
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.cells import AFTER_S, BEFORE, BEFORE_S, STATE
from rigctl.experiments.rotating_platform.observe.channel_runs import ChannelRun
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.experiments.rotating_platform.observe.reducer import Bin
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

TURN_CYCLES = tuple(range(3, 10))
"""After so many turns something may be as it was: what counts turns and begins anew (of two, stops and directions
tell)."""

_STRETCHES = 4
# The highest peak of noise follows a known law: nothing about its spread is estimated.
_KNOWN_DOF = 1e6


@dataclass(frozen=True)
class Row:
    """What observables go by: a group of periods, or a bin around the turns."""

    run: int
    covariates: Mapping[str, float]
    stretch: int


def stacked(
    channels: Sequence[ChannelRun], imagined: Collection[str] = (), peaks: Mapping[str, float] | None = None
) -> Observations:
    """The vector of all observables of recorded runs, their spectra, then `imagined` runs; `DataError` without any.

    An imagined run is one row of covariates. `peaks`, by run and channel, are the highest of a spectrum, in sigma.
    """
    if not channels:
        raise DataError("no valid run could be reduced: there is nothing to fit")
    rows: list[Row] = []
    place: dict[tuple[str, str, int], int] = {}
    runs = list(dict.fromkeys(each.run.run_id for each in channels))
    series_of: list[int] = []
    run_of: list[int] = []
    pool_of: list[int] = []
    pools: list[NoisePool] = []
    value: list[FloatArray] = []
    sigma: list[FloatArray] = []
    factors: list[tuple[IntArray, FloatArray]] = []
    turned = turns_before(channels)

    def take(each: ChannelRun, own_rows: list[int]) -> None:
        first = len(COMPONENTS) * CHANNELS.index(each.channel)
        # Outputs of a run are correlated with each other and from period to period; runs are not.
        factors.append((np.arange(len(run_of), len(run_of) + len(own_rows)), each.factor))
        series_of.extend(first + output for output in range(4) for _ in each.reducer.groups)
        series_of.extend(first + 4 + (one.number == BEFORE) for one in each.reducer.bins)
        pool_of.extend([len(pools)] * len(own_rows))
        pools.append(NoisePool(f"{each.run.run_id} {READ[each.channel]}", each.noise.dof, of_these=True))
        run_of.extend(own_rows)
        value.append(each.value)
        sigma.append(each.sigma)

    for each in (one for one in channels if one.run.run_id not in imagined):
        take(each, _rows_of(runs.index(each.run.run_id), each, turned[each.run.run_id], rows, place))
    for channel, (number, run_id) in product(CHANNELS, enumerate(runs)):
        if number == 0:
            pools.append(NoisePool(f"{READ[channel]} spectrum", _KNOWN_DOF))
        if (peak := (peaks or {}).get(f"{run_id} {channel}")) is not None:
            series_of.append(len(COMPONENTS) * CHANNELS.index(channel) + COMPONENTS.index(SPECTRUM))
            pool_of.append(len(pools) - 1)
            run_of.append(_whole_run(number, rows))
            value.append(np.array([peak]))
            # A normal deviate already.
            sigma.append(np.ones(1))
    for each in (one for one in channels if one.run.run_id in imagined):
        key = (each.run.run_id, "whole", 0)
        if key not in place:
            place[key] = len(rows)
            rows.append(_group_row(runs.index(each.run.run_id), each, 0, turned[each.run.run_id]))
        take(each, [place[key]] * each.value.size)
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
        # Runs are held out; of a single run its stretches.
        block_of=np.array([row.stretch if alone else row.run for row in rows]),
        covariates=_covariates(rows),
        factors=tuple(factors),
    )


def _rows_of(
    number: int, each: ChannelRun, turned: int, rows: list[Row], place: dict[tuple[str, str, int], int]
) -> list[int]:
    """The row of each observable; those that the other channel has made already are shared."""
    rows_of_run: list[int] = []
    for group in each.reducer.groups.tolist():
        key = (each.run.run_id, "group", group)
        if key not in place:
            place[key] = len(rows)
            rows.append(_group_row(number, each, group, turned))
        rows_of_run.append(place[key])
    rows_of_run *= 4
    for one in each.reducer.bins:
        key = (each.run.run_id, "bin", 2 * one.number + (one.sign < 0))
        if key not in place:
            place[key] = len(rows)
            rows.append(_bin_row(number, each, one))
        rows_of_run.append(place[key])
    return rows_of_run


def _whole_run(number: int, rows: list[Row]) -> int:
    """A row of a whole run, at its first: a spectrum is of no turn."""
    first = next(row for row in rows if row.run == number)
    # The count of turns belongs to groups of periods.
    known = {name: value for name, value in first.covariates.items() if not name.startswith("turns")}
    rows.append(replace(first, covariates=known))
    return len(rows) - 1


def turns_before(channels: Sequence[ChannelRun]) -> dict[str, int]:
    """By run_id, how many turns the recorded runs before it have made."""
    runs = {each.run.run_id: each.run for each in channels}
    in_time = sorted(runs.values(), key=lambda run: known_start_s(run.conditions))
    made = np.cumsum([0, *(int(run.cells.turn_number.max()) for run in in_time)])
    return {run.run_id: int(turns) for run, turns in zip(in_time, made.tolist(), strict=False)}


def known_start_s(conditions: Mapping[str, Any]) -> float:
    """When a run began in its recording's time [s]; 0 where that is not known."""
    start_s = _start_s(conditions)
    return start_s if math.isfinite(start_s) else 0.0


def _group_row(number: int, each: ChannelRun, group: int, turned: int) -> Row:
    """Of a group of periods; `turned` is how many turns there were before the run."""
    cells, reducer = each.run.cells, each.reducer
    first = group * reducer.per_group
    last = min(first + reducer.per_group, cells.periods)
    in_group = (cells.period >= first) & (cells.period < last)
    share = cells.count[in_group] / cells.count[in_group].sum()
    turns = turned + cells.turn_number[in_group]
    middle_s = 0.5 * (first + last) * cells.period_s
    covariates = {
        "time_s": _start_s(each.run.conditions) + middle_s,
        "within_run_s": middle_s - 0.5 * cells.periods * cells.period_s,
        **_state(each, share @ cells.state[in_group]),
        "turns": float(share @ turns),
        **{f"turns_modulo_{cycle}": float(share @ (turns % cycle)) for cycle in TURN_CYCLES},
        **own_columns(each.run.conditions),
        **_own_samples(each, share @ cells.state[in_group]),
    }
    return Row(number, covariates, (_STRETCHES * first) // max(cells.periods, 1))


def _bin_row(number: int, each: ChannelRun, one: Bin) -> Row:
    cells = each.run.cells
    in_bin = (cells.bin == one.number) & (cells.sign == one.sign)
    covariates = {
        "time_s": _start_s(each.run.conditions) + 0.5 * cells.periods * cells.period_s,
        **_state(each, cells.state[in_bin].mean(axis=0)),
        "since_turn_s": AFTER_S[one.number] if one.number != BEFORE else -BEFORE_S,
        "stop": float(one.sign),
        **own_columns(each.run.conditions),
        **_own_samples(each, cells.state[in_bin].mean(axis=0)),
    }
    return Row(number, covariates, 0)


def _state(each: ChannelRun, state: FloatArray) -> dict[str, float]:
    """Commands, temperature and modulation of a row whose cells have this mean `Cells.state`."""
    return {
        "c_z_m_s2": float(state[0]),
        "c_y_m_s2": float(state[1]),
        "temperature_c": _temperature(each.run.conditions, float(state[2])),
        "modulation_frequency_hz": 1.0 / each.run.cells.period_s,
    }


def _own_samples(each: ChannelRun, state: FloatArray) -> dict[str, float]:
    """A laboratory's own columns of the samples, of a row whose cells have this mean `Cells.state`."""
    return dict(zip(each.run.cells.own, state[len(STATE) :].tolist(), strict=True))


_FORMAT_COLUMNS = {
    *COMMON_FIELDS,
    *(
        "pattern",
        "modulation_period_s",
        "sample_rate_hz",
        "external",
        "v_z_v",
        "v_y_v",
        "external_period_s",
        "g_sign",
    ),
    *("guard_s", "lead_s", "rotation_s", "external_period_asked_s", "periods"),
}


def own_columns(conditions: Mapping[str, Any]) -> dict[str, float]:
    """A laboratory's own columns of runs.csv that are numbers."""
    return {
        name: float(value)
        for name, value in conditions.items()
        if name not in _FORMAT_COLUMNS and isinstance(value, int | float) and not isinstance(value, bool)
    }


def _start_s(conditions: Mapping[str, Any]) -> float:
    return float(conditions.get("start_s", math.nan))


def _temperature(conditions: Mapping[str, Any], sampled: float) -> float:
    return sampled if math.isfinite(sampled) else float(conditions.get("temperature_c", math.nan))


def _covariates(rows: Sequence[Row]) -> dict[str, FloatArray]:
    names = list(dict.fromkeys(name for row in rows for name in row.covariates))
    return {name: np.array([row.covariates.get(name, math.nan) for row in rows]) for name in names}
