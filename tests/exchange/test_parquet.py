"""The table of a store, and as Parquet: every number with its unit and its uncertainty."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, DataError
from rigctl.exchange.parquet import write_parquet
from rigctl.exchange.store_table import Column, StoreTable, store_table
from rigctl.workbench.study import NoisePool, Observations, Series
from tests.exchange.conftest import HEADER

OBSERVED = Observations(
    run_ids=("1⁄2 <i>", "1⁄2 <i>"),
    series=(Series("accel_v", "DC", "V"), Series("accel_v", "nu", "V")),
    pools=(NoisePool("weights", 0.0), NoisePool("nu", 40.0)),
    value=np.array([1 / 3, 2.0, 3.0]),
    sigma=np.array([0.1, 0.2, 0.3]),
    series_of=np.array([0, 1, 1]),
    run_of=np.array([0, 0, 1]),
    pool_of=np.array([0, 1, 1]),
    group_of=np.zeros(3, dtype=int),
    block_of=np.zeros(2, dtype=int),
    covariates={"temperature_c": np.array([20.0, 21.0]), "theta_deg": np.zeros(2), "who": np.array([1.0, np.nan])},
    levels={"who": ("ann", "bob")},
)


def columns_of(store: Store, observed: Observations | None) -> dict[str, Column]:
    def model(_: Any) -> Any:
        if observed is None:
            raise DataError("too few runs")
        return SimpleNamespace(observations=observed)

    bench: Any = SimpleNamespace(store=store, study=SimpleNamespace(model=model))
    table = store_table(bench)
    assert table.without_data == ("" if observed else "too few runs")
    return {column.name: column for column in table.columns}


def test_a_run_has_a_row_for_each_set_of_its_data_and_one_without_any(store: Store) -> None:
    columns = columns_of(store, OBSERVED)
    assert columns["run_id"].values == ["1⁄2 <i>", "1⁄2 <i>", "2"]
    np.testing.assert_array_equal(columns["valid"].values, [True, True, False])
    np.testing.assert_array_equal(columns["theta_deg"].values, [1 / 3, 1 / 3, 0.5])
    np.testing.assert_array_equal(columns["accel_v nu"].values, [2.0, 3.0, np.nan])
    np.testing.assert_array_equal(columns["accel_v nu"].u, [0.2, 0.3, np.nan])
    # Relative weights are no uncertainties.
    assert columns["accel_v DC"].u is None
    np.testing.assert_array_equal(columns["temperature_c"].values, [20.0, 21.0, np.nan])
    assert columns["who"].values == ["bob", None, None]
    assert (columns["temperature_c"].unit, columns["accel_v nu"].unit) == ("degC", "V")


def test_without_a_study_there_are_the_settings(store: Store) -> None:
    columns = columns_of(store, None)
    assert columns["reason"].values == ["", "a door"]
    assert "accel_v nu" not in columns


def test_conditions_are_numbers_only_where_all_are(store: Store) -> None:
    columns = columns_of(store, None)
    np.testing.assert_array_equal(columns["mounting"].values, [1.0, np.nan])
    assert columns["on"].values == ["true", None]
    assert columns["spots"].values == ['["a", 2]', None]
    assert columns["note"].values == ["a\0b", None]


def test_parquet_has_units_and_the_names_of_uncertainties(store: Store, tmp_path: Path) -> None:
    table = StoreTable(tuple(columns_of(store, OBSERVED).values()))
    write_parquet(table, HEADER, tmp_path / "runs.parquet")
    read = pq.read_table(tmp_path / "runs.parquet")
    field = read.schema.field("accel_v nu")
    assert field.metadata == {b"units": b"V", b"uncertainty": b"u_accel_v nu"}
    assert read.schema.field("u_accel_v nu").metadata[b"units"] == b"V"
    assert read["accel_v DC"][0].as_py() == 1 / 3
    assert read["u_accel_v nu"].to_pylist() == [0.2, 0.3, None]
    assert read["valid"].to_pylist() == [True, True, False]
    assert read.schema.metadata[b"title"].decode() == HEADER.title
    assert json.loads(read.schema.metadata[b"header"])["rig_toml"] == HEADER.rig_toml
    frame = read.to_pandas()
    assert frame[frame.valid].groupby("run_id")["accel_v nu"].mean().tolist() == [2.5]


def test_an_uncertainty_takes_no_name_that_there_is(tmp_path: Path) -> None:
    measured = Column("y", np.array([1.0]), "V", np.array([0.1]))
    table = StoreTable((measured, Column("u_y", np.array([7.0]))))
    write_parquet(table, Header("table"), tmp_path / "t.parquet")
    read = pq.read_table(tmp_path / "t.parquet")
    assert read.to_pydict() == {"y": [1.0], "u_y_": [0.1], "u_y": [7.0]}
    assert read.schema.field("y").metadata[b"uncertainty"] == b"u_y_"


def test_readings_have_the_column_of_uncertainties_that_was_recorded(tmp_path: Path) -> None:
    spec = {"response": "y_v", "baseline": "a", "sigma": "sd"}
    with Store.create(tmp_path / "t.rig.sqlite", Header("table", extra={"table": spec})) as store:
        with store.begin_run("readings", "", {"day": ["Mon", "Tue"]}, "readings") as writer:
            writer.append({"y_v": np.array([1.0, 2.0]), "sd": np.array([0.1, 0.2])})
            writer.finish()
        write_parquet(store_table(SimpleNamespace(store=store)), store.header, tmp_path / "t.parquet")  # type: ignore[arg-type]
    read = pq.read_table(tmp_path / "t.parquet")
    assert read.to_pydict() == {"y_v": [1.0, 2.0], "sd": [0.1, 0.2], "day": ["Mon", "Tue"]}
    assert read.schema.field("y_v").metadata == {b"units": b"V", b"uncertainty": b"sd"}


def test_a_store_without_runs_has_the_columns_of_any(tmp_path: Path) -> None:
    with Store.create(tmp_path / "e.rig.sqlite", HEADER) as store:
        table = store_table(SimpleNamespace(store=store))  # type: ignore[arg-type]
        assert table.without_data == "it has no runs"
        write_parquet(table, HEADER, tmp_path / "e.parquet")
    read = pq.read_table(tmp_path / "e.parquet")
    assert (read.num_rows, read.column_names) == (0, ["run_id", "step", "valid", "reason"])


def test_without_pyarrow_it_says_what_brings_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def absent(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ConfigError, match=r"pyarrow is not installed; pip install 'rigctl\[files\]' brings it"):
        write_parquet(StoreTable(()), HEADER, tmp_path / "t.parquet")
    assert not list(tmp_path.iterdir())
