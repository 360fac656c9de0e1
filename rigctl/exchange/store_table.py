"""A store as one table: what was set, what was measured, and how well that is known.

The rows are runs with what they were reduced to; where one run gives several sets of data (the cells of a platform's
run) each is a row. A `table` recording gives its readings.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.campaign.recording import READINGS, RunRecord
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import UNFIT
from rigctl.core.experiments import of_readings
from rigctl.core.units import unit_of_column
from rigctl.exchange.streams import unit_of
from rigctl.workbench.study import Observations
from rigctl.workbench.workbench import Workbench

_INTEGERS = range(-(2**63), 2**63)

Values = np.ndarray[Any, Any] | list[str | None]
"""Numbers, or texts with None where there is none."""


@dataclass(frozen=True)
class Column:
    """A column with a value for each row, in `unit`; `u` are their standard uncertainties, NaN where not known.

    `u_name` is the column that these are read from, where the recording has one.
    """

    name: str
    values: Values
    unit: str = ""
    u: FloatArray | None = None
    u_name: str = ""


@dataclass(frozen=True)
class StoreTable:
    """The columns of a store, of one length, each name once; `without_data`: why nothing measured is among them."""

    columns: tuple[Column, ...]
    without_data: str = ""


def store_table(workbench: Workbench) -> StoreTable:
    """The table of a store; `DamagedStore`."""
    store = workbench.store
    runs = store.runs()
    if of_readings(store.header.experiment) and any(run.run_id == READINGS for run in runs):
        return StoreTable(tuple(_readings(store)))
    observations, why = _observations(workbench) if runs else (None, "it has no runs")
    return StoreTable(tuple(_of_runs(runs, observations)), why)


def _readings(store: Store) -> Iterator[Column]:
    header, spec = store.header, store.header.table
    samples = store.samples(READINGS)
    (run,) = (run for run in store.runs() if run.run_id == READINGS)
    for name, values in samples.items():
        known = spec is not None and name == spec.response and spec.sigma in samples
        u_name = str(spec.sigma) if spec is not None and known else ""
        yield Column(name, values, unit_of(header.channels, name), samples[u_name] if known else None, u_name)
    for name, words in run.conditions.items():
        if isinstance(words, list):
            yield Column(name, [str(word) for word in words])


def _observations(workbench: Workbench) -> tuple[Observations | None, str]:
    try:
        # What was measured is the same for every version of the model.
        return workbench.study.model(()).observations, ""
    except UNFIT as error:
        return None, str(error)


def _of_runs(runs: Sequence[RunRecord], data: Observations | None) -> Iterator[Column]:
    rows = list(_rows(runs, data))
    records = [run for run, _ in rows]
    yield Column("run_id", [run.run_id for run in records])
    yield Column("step", [run.step for run in records])
    yield Column("valid", np.array([run.valid for run in records], dtype=bool))
    yield Column("reason", [run.reason for run in records])
    names = dict.fromkeys(name for run in runs for name in run.conditions)
    taken = {"run_id", "step", "valid", "reason"}
    for name in (name for name in names if name not in taken):
        yield Column(name, _typed([run.conditions.get(name) for run in records]), unit_of_column(name))
    if data is not None:
        yield from _measured(data, [place for _, place in rows], taken | names.keys())


def _rows(runs: Iterable[RunRecord], data: Observations | None) -> Iterator[tuple[RunRecord, int | None]]:
    """Each run with the places of its data, or with None where it has none."""
    places: dict[str, list[int]] = {}
    for place, run_id in enumerate(data.run_ids if data is not None else ()):
        places.setdefault(run_id, []).append(place)
    for run in runs:
        yield from ((run, place) for place in places.get(run.run_id) or (None,))


def _measured(data: Observations, places: Sequence[int | None], taken: Iterable[str]) -> Iterator[Column]:
    """What is known of the data beside their runs' conditions, and the data themselves with their uncertainty."""
    known, used = [place is not None for place in places], set(taken)
    at = np.array([place for place in places if place is not None], dtype=int)

    def spread(column: FloatArray) -> FloatArray:
        spread = np.full(len(places), np.nan)
        spread[known] = column[at]
        return spread

    for name, column in data.covariates.items():
        if name in used:
            continue
        used.add(name)
        if levels := data.levels.get(name):
            words = [None if np.isnan(value) else levels[int(value)] for value in spread(column)]
            yield Column(name, words)
        else:
            yield Column(name, spread(column), unit_of_column(name))
    # A pool without degrees of freedom has relative weights: nothing that could be called an uncertainty.
    is_u = np.array([pool.dof > 0.0 or pool.stated for pool in data.pools], dtype=bool)
    for number, series in enumerate(data.series):
        of_series = data.series_of == number
        value, u = np.full((2, len(data.run_ids)), np.nan)
        value[data.run_of[of_series]] = data.value[of_series]
        u[data.run_of[of_series]] = np.where(is_u[data.pool_of[of_series]], data.sigma[of_series], np.nan)
        name = _free(series.name.strip(), used)
        used.add(name)
        yield Column(name, spread(value), series.unit, None if np.isnan(u).all() else spread(u))


def _free(name: str, used: set[str]) -> str:
    """A name that no column has yet: a condition may be called like what was measured."""
    return name if name not in used else _free(f"{name} (measured)", used)


def _typed(values: Sequence[Any]) -> Values:
    """The conditions of one name: numbers where all are, NaN for none, else texts."""
    given = [value for value in values if value is not None]
    if given and all(isinstance(value, bool) for value in given) and len(given) == len(values):
        return np.array(values, dtype=bool)
    if given and all(isinstance(value, int | float) and not isinstance(value, bool) for value in given):
        whole = len(given) == len(values) and all(isinstance(value, int) and value in _INTEGERS for value in given)
        return np.array([np.nan if value is None else value for value in values], dtype=np.int64 if whole else float)
    return [None if value is None else value if isinstance(value, str) else json.dumps(value) for value in values]


def uncertainty_names(columns: Mapping[str, Column]) -> dict[str, str]:
    """By column the name of that with its standard uncertainties: as recorded, or `u_NAME`, which no other has."""
    names: dict[str, str] = {}
    for name, column in columns.items():
        if column.u is not None:
            free = f"u_{name}"
            while free in columns or free in names.values():
                free += "_"
            names[name] = column.u_name or free
    return names
