"""A store's runs and samples as frames of `pandas` and datasets of `xarray`, with units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rigctl.campaign.recording import RunRecord, RunSource
from rigctl.core.errors import DataError
from rigctl.core.extra import needed
from rigctl.core.units import name_and_unit

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

TIME, ROW = "t_s", "row"


def runs_frame(source: RunSource) -> DataFrame:
    """A row for each run of a store or a recording, by run_id: its conditions, whether it is valid and why not.

    Units are in the names of the columns. `ConfigError` without pandas.
    """
    pandas = needed("pandas")
    runs = source.runs()
    rows = [{**_single(run), "valid": run.valid, "reason": run.reason} for run in runs]
    frame: DataFrame = pandas.DataFrame(rows, index=pandas.Index([run.run_id for run in runs], name="run_id"))
    return frame


def run_dataset(source: RunSource, run_id: str) -> Dataset:
    """The samples of one run: a variable for each channel, `units` and `long_name` among its attributes, along the
    coordinate `t_s`, or `row` where nothing is timed (a table: words are variables there too).

    The run's conditions are attributes of the dataset. `ConfigError` without xarray, `DataError` for an unknown run.
    """
    xarray = needed("xarray")
    run = source.run(run_id)
    if run is None:
        raise DataError(f"no run {run_id!r} in this recording; see the index of `runs_frame`")
    columns, channels = source.samples(run_id), source.header.channels
    # An interrupted run's columns may differ in length.
    count = min(map(len, columns.values()))
    along = TIME if TIME in columns else ROW
    words = {name: value for name, value in run.conditions.items() if isinstance(value, list) and len(value) == count}

    def described(name: str) -> dict[str, str]:
        plain, unit = name_and_unit(name)
        known = channels.get(name)
        told = {"units": known.unit if known else unit, "long_name": plain.replace("_", " ")}
        return {**told, "kind": known.kind} if known and known.kind else told

    given: dict[str, Any] = {**columns, **words}
    variables = {name: (along, values[:count], described(name)) for name, values in given.items()}
    attributes = {"run_id": run.run_id, "valid": int(run.valid), "experiment": source.header.experiment}
    dataset: Dataset = xarray.Dataset(variables, attrs={**_single(run), **attributes})
    return dataset


def _single(run: RunRecord) -> dict[str, Any]:
    """Conditions that are one value for the whole run."""
    return {name: value for name, value in run.conditions.items() if not isinstance(value, list)}
