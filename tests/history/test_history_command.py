"""`rigctl history` over a directory of stores: the good ones beside each other, the others a line each."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed import LocalCluster

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.campaign.recording import Header
from rigctl.campaign.session import locks
from rigctl.campaign.store.store import Store
from rigctl.history import catalogue

Make = Callable[..., Path]

SERIAL = "LC-7"


@pytest.fixture
def cell(desk: Any) -> Make:
    """Makes the store of a calibration of a cell, response = b0 + b1 x with noise 0.01."""

    def make(name: str, year: int | None, b1: float = 2.0, serial: str = SERIAL, unit: str = "v") -> Path:
        bundle, rng = desk.directory / "bundles" / name, np.random.default_rng([year or 0, len(name)])
        bundle.mkdir(parents=True)
        x = np.linspace(0.0, 10.0, 20)
        rows = zip(x.tolist(), (1.0 + b1 * x + 0.01 * rng.normal(size=20)).tolist(), strict=True)
        (bundle / "readings.csv").write_text(f"x,y_{unit}\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
        (bundle / "recording.toml").write_text(
            "format = 1\nexperiment = 'table'\n"
            + (f"started = {year}-03-01T10:00:00Z\n" if year else "")
            + f"[table]\nresponse = 'y_{unit}'\nbaseline = 'b0 + b1 * x'\n"
            + (f"[item]\nserial = '{serial}'\nname = 'cell'\n" if serial else "")
        )
        store = desk.directory / "lab" / f"{name}.rig.sqlite"
        store.parent.mkdir(parents=True, exist_ok=True)
        import_bundle(bundle, store).close()
        return store

    return make


@pytest.fixture(autouse=True)
def _one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit here takes no time beside what another process takes to start."""
    monkeypatch.setattr("os.cpu_count", lambda: 1)


@pytest.fixture
def lab(cell: Make) -> Path:
    """Four calibrations of one cell that agree."""
    made = [cell(f"cell-{year}", year) for year in (2020, 2021, 2022, 2023)]
    return made[-1].parent


def _quantity(document: Any, name: str) -> Any:
    (item,) = document["items"]
    return next(each for each in item["quantities"] if each["name"] == name)


def test_two_processes_find_what_this_one_finds(desk: Any, lab: Path, tmp_path: Path) -> None:
    shutil.copytree(lab, tmp_path / "elsewhere" / "lab")
    here = desk.rigctl("history", lab, "--json")
    there = desk.rigctl("history", tmp_path / "elsewhere" / "lab", "--workers", 2, "--json")
    assert there.err.splitlines()[-1].startswith("4 of 4 worked out, ")
    assert there.out.replace(str(tmp_path / "elsewhere" / "lab"), str(lab)) == here.out


def test_a_dask_cluster_finds_what_this_one_finds(desk: Any, lab: Path, tmp_path: Path) -> None:
    shutil.copytree(lab, tmp_path / "elsewhere" / "lab")
    here = desk.rigctl("history", lab, "--json")
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        address = cluster.scheduler_address
        there = desk.rigctl("history", tmp_path / "elsewhere" / "lab", "--scheduler", address, "--json")
    assert there.status == 0, there.err
    assert there.out.replace(str(tmp_path / "elsewhere" / "lab"), str(lab)) == here.out


def test_calibrations_that_agree_and_one_that_does_not(desk: Any, lab: Path, cell: Make) -> None:
    agreeing = desk.rigctl("history", lab, "--json")
    assert agreeing.status == 0
    document = agreeing.json
    assert document["warnings"] == []
    assert (document["stores"], document["not_listed"]) == (4, [])
    slope = _quantity(document, "b1")
    assert [each["date"] for each in slope["values"]] == [f"{year}-03-01" for year in (2020, 2021, 2022, 2023)]
    # The same numbers as those that are printed by the command for one store.
    fit = desk.rigctl("result", lab / "cell-2022.rig.sqlite", "--json").json["parameters"]["b1"]
    assert slope["values"][2]["value"] == pytest.approx(fit["value"], rel=1e-12)
    assert slope["values"][2]["standard_uncertainty"] == pytest.approx(fit["sigma"], rel=1e-9)
    assert slope["consistency"]["consistent"]

    off = cell("cell-2024", 2024, b1=2.05)
    page, figures = desk.directory / "h.html", desk.directory / "figures"
    warned = desk.rigctl("history", lab, "--out", page, "--figures", figures)
    assert warned.status == 1
    last = warned.err.splitlines()[-1]
    assert f"{SERIAL}: b1 of 2024-03-01 ({off}) disagrees with the 4 former calibrations" in last
    assert " sigma (p = " in last
    assert "b0" not in last
    assert "LC-7 (cell), table, y_v = b0 + b1 * x: 5 calibrations" in warned.out
    assert page.read_text().count("<svg") == 2
    assert last.split(": ", 1)[1] in page.read_text().replace("&#x27;", "'")
    rows = (figures / "LC-7_table_b1.csv").read_text().splitlines()
    assert rows[0] == "store,started,value,standard_uncertainty,independent,placed,reference"
    assert len(rows) == 6
    assert desk.rigctl("history", lab, "--json").json["warnings"][0] in last


def test_readings_in_another_unit_stand_apart(desk: Any) -> None:
    rng = np.random.default_rng(5)
    x = np.linspace(0.0, 10.0, 20)
    for year, unit, b1 in ((2020, "V", 2.0), (2021, "mV", 2000.0), (2022, "V", 2.0), (2023, "V", 2.2)):
        bundle, factor = desk.directory / f"bundle-{year}", 1000.0 if unit == "mV" else 1.0
        bundle.mkdir()
        y = b1 * x + 0.01 * factor * rng.normal(size=20)
        (bundle / "readings.csv").write_text(
            "x,out\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(x.tolist(), y.tolist(), strict=True))
        )
        (bundle / "recording.toml").write_text(
            f"format = 1\nexperiment = 'table'\nstarted = {year}-03-01T10:00:00Z\n"
            "[table]\nresponse = 'out'\nbaseline = 'b0 + b1 * x'\n"
            f"[item]\nserial = '{SERIAL}'\n[channels.out]\nunit = '{unit}'\n"
        )
        store = desk.directory / "lab" / f"{year}.rig.sqlite"
        store.parent.mkdir(exist_ok=True)
        import_bundle(bundle, store).close()
    warned = desk.rigctl("history", desk.directory / "lab")
    # Among those in volts the newest is off by a tenth, which a slope a thousand times as large had hidden.
    assert warned.status == 1
    assert "b1 of 2023-03-01" in warned.err
    assert "out = b0 + b1 * x, out in V: 3 calibrations" in warned.out
    assert "out = b0 + b1 * x, out in mV: 1 calibration" in warned.out


def test_results_are_worked_out_once_and_again_with_another_model(
    desk: Any, lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted: list[str] = []
    work = catalogue.worked_out

    def counted(path: Path, plugins: Any) -> Any:
        fitted.append(path.name)
        return work(path, plugins)

    monkeypatch.setattr(catalogue, "worked_out", counted)
    first = desk.rigctl("history", lab, "--json")
    assert len(fitted) == 4
    assert "4 results of 4 to be worked out" in first.err
    again = desk.rigctl("history", lab, "--json")
    assert len(fitted) == 4
    assert again.json == first.json
    assert again.err == ""
    assert desk.rigctl("model", "add", lab / "cell-2021.rig.sqlite", "power2[x]").status == 0
    changed = desk.rigctl("history", lab, "--json").json
    assert fitted[4:] == ["cell-2021.rig.sqlite"]
    # Its parameters mean something else now: they are not compared with the others.
    assert [(each["model"], len(each["calibrations"])) for each in changed["items"]] == [
        ("y_v = b0 + b1 * x", 3),
        ("y_v = b0 + b1 * x, power2[x]", 1),
    ]


def test_stores_that_are_no_calibration_are_a_line_each(desk: Any, lab: Path, cell: Make) -> None:
    good = lab / "cell-2020.rig.sqlite"
    (lab / "deep" / "er").mkdir(parents=True)
    shutil.copy(good, lab / "deep" / "er" / "copy.rig.sqlite")
    (lab / "text.rig.sqlite").write_text("no store")
    (lab / "empty.rig.sqlite").write_bytes(b"")
    damaged = bytearray(good.read_bytes())
    damaged[4096:8192] = b"\xff" * 4096
    (lab / "damaged.rig.sqlite").write_bytes(damaged)
    shutil.copy(good, lab / "newer.rig.sqlite")
    with closing(sqlite3.connect(lab / "newer.rig.sqlite")) as connection:
        connection.execute("PRAGMA user_version = 99")
        connection.commit()
    cell("nameless", 2020, serial="")
    cell("undated", None)
    half = {"state": "running", "step": "", "runs_planned": 10, "eta_s": 1.0}
    for name in ("half", "busy"):
        with Store.create(
            lab / f"{name}.rig.sqlite", Header("sensing-axis", extra={"item": {"serial": "FM"}})
        ) as store:
            store.set_status(half)
    Store.create(lab / "foreign.rig.sqlite", Header("levitation", extra={"item": 7})).close()
    (lab / "folder.rig.sqlite").mkdir()
    with locks.held(locks.store_lock(lab / "busy.rig.sqlite"), "in use"):
        told = desk.rigctl("history", lab, "--json")
    assert told.status == 0
    reasons = {Path(each["store"]).name.split(".")[0]: each["reason"] for each in told.json["not_listed"]}
    assert reasons.keys() == {
        *("copy", "text", "empty", "damaged", "newer", "nameless", "undated", "half", "busy", "foreign"),
    }
    for name, said in {
        "text": "not a campaign store",
        "empty": "not a campaign store",
        "damaged": "damaged",
        "newer": "store schema 99 is newer",
        "nameless": "says no serial number",
        "undated": "does not say when",
        "half": "interrupted: 0 of 10 runs",
        "busy": "running: 0 of 10 runs",
        "copy": f"the same calibration as {good}",
        "foreign": "calibrated item cannot be read",
    }.items():
        assert said in reasons[name]
        assert "\n" not in reasons[name]
    assert "Traceback" not in told.err
    (item,) = told.json["items"]
    assert len(item["calibrations"]) == 4


def test_what_cannot_be_listed_at_all_is_one_line(desk: Any, lab: Path) -> None:
    empty = desk.directory / "nothing"
    desk.rigctl("history", empty).refused(2, f"{empty}: no such directory")
    empty.mkdir()
    desk.rigctl("history", empty).refused(2, f"{empty}: no stores (*.rig.sqlite)")
    desk.rigctl("history", lab, "--serial", "LC-8").refused(2, "serial number 'LC-8'", f"there are {SERIAL}")
    desk.rigctl("history", lab, "--out", empty / "no" / "h.html").refused(2, "there is no directory")
    (empty / "x.rig.sqlite").write_text("")
    none = desk.rigctl("history", empty, "--json")
    assert none.status == 2
    assert none.out == ""
    assert len(none.err.splitlines()) == 2


def test_one_item_of_several_is_listed_without_fitting_the_others(desk: Any, lab: Path, cell: Make) -> None:
    cell("other", 2021, serial="LC-9")
    told = desk.rigctl("history", lab, "--serial", "LC-9", "--json")
    assert "1 result of 1" in told.err
    (item,) = told.json["items"]
    assert (item["serial"], item["item"]["name"], len(item["calibrations"])) == ("LC-9", "cell", 1)
    (quantity, _) = item["quantities"]
    assert (quantity["consistency"], quantity["drift"], quantity["untested"]) == (None, None, "one calibration")
    assert json.dumps(item)
