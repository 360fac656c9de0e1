"""`rigctl report` of several stores: a page and figures each, by any number of workers; one fails alone."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from distributed import LocalCluster

TABLE = "y_v,x\n" + "".join(f"{1.0 + 2.0 * x + 0.01 * (x * x * 7 % 11):.5f},{x}\n" for x in range(12))


@pytest.fixture
def stores(desk: Any) -> list[Path]:
    bundle, first, second = (desk.directory / name for name in ("bundle", "first.rig.sqlite", "second.rig.sqlite"))
    bundle.mkdir()
    (bundle / "readings.csv").write_text(TABLE)
    (bundle / "recording.toml").write_text(
        "format = 1\nexperiment = 'table'\n[table]\nresponse = 'y_v'\nbaseline = 'b0 + b1 * x'\n"
    )
    assert desk.rigctl("import", bundle, "--store", first).status == 0
    shutil.copy(first, second)
    return [first, second]


def test_two_processes_write_what_one_store_s_report_is(desk: Any, stores: list[Path]) -> None:
    assert desk.rigctl("report", stores[0], "--out", "alone.html").status == 0
    told = desk.rigctl("report", *stores, "--out", "pages", "--workers", 2, "--json")
    assert told.status == 0, told.err
    assert told.err.splitlines()[-1].startswith("2 of 2 reported, ")
    pages = [desk.directory / "pages" / f"{name}.html" for name in ("first", "second")]
    assert told.json == {"written": [str(page) for page in pages], "failed": {}}
    assert pages[0].read_bytes() == (desk.directory / "alone.html").read_bytes()


def test_a_dask_cluster_writes_the_same(desk: Any, stores: list[Path]) -> None:
    assert desk.rigctl("report", stores[0], "--out", "alone.html").status == 0
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        told = desk.rigctl("report", *stores, "--out", "pages", "--scheduler", cluster.scheduler_address)
    assert told.status == 0, told.err
    pages = [desk.directory / "pages" / f"{name}.html" for name in ("first", "second")]
    assert told.out.splitlines() == [str(page) for page in pages]
    assert pages[0].read_bytes() == (desk.directory / "alone.html").read_bytes()


def test_a_store_that_cannot_be_read_keeps_nobody_from_the_others(desk: Any, stores: list[Path]) -> None:
    stores[0].write_text("no store")
    told = desk.rigctl("report", *stores, "--figures", "figures", "--workers", 1)
    assert told.status == 1
    assert told.out.splitlines() == [str(desk.directory / "figures" / "second")]
    assert {path.name for path in (desk.directory / "figures").iterdir()} == {"second"}
    assert told.err.splitlines()[-1].startswith(f"1 of 2 reports not written: {stores[0]}")


def test_reports_that_would_be_one_file_are_refused(desk: Any, stores: list[Path]) -> None:
    (desk.directory / "other").mkdir()
    again = shutil.copy(stores[0], desk.directory / "other" / stores[0].name)
    desk.rigctl("report", stores[0], again, "--out", "pages").refused(
        2, f"{stores[0]} and {again} would be one report"
    )
    (desk.directory / "pages").write_text("a file")
    desk.rigctl("report", *stores, "--out", "pages").refused(2, "pages: no directory for reports can be made there")
    one = desk.rigctl("report", stores[0], "--out", "page.html", "--workers", 2)
    one.refused(2, "one report is written by this process; leave out --workers and --scheduler")
