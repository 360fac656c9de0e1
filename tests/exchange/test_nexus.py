"""A store as a NeXus file: every sample bit for bit, with unit and uncertainty, found by the rules of NeXus."""

from __future__ import annotations

import hashlib
import json
import re
import resource
import sqlite3
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray

from rigctl.analysis.measurement_result import MeasurementResult, Quantity, Source
from rigctl.campaign.bundle.hdf5 import write_hdf5
from rigctl.campaign.recording import ChannelInfo, Header
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DamagedStore, DataError
from rigctl.exchange.nexus.file import write_nexus
from rigctl.exchange.nexus.groups import Names
from rigctl.exchange.store_table import Column, StoreTable
from rigctl.exchange.streams import BLOCK
from tests.exchange.conftest import OWN_S, VOLTS

TABLE = StoreTable(
    (
        Column("run_id", ["a", None]),
        Column("theta_deg", np.array([0.1, 0.2]), "deg"),
        Column("valid", np.array([True, False])),
        Column("nu in-phase", np.array([1.0, np.nan]), "V", np.array([0.5, np.nan])),
    )
)
RESULT = MeasurementResult(
    (Quantity("axis Y, x", 0.25, "1"), Quantity("axis Y; x", 3.0, "arcsec")),
    (Source("noise", "A", np.array([[0.04, 0.01], [0.01, 0.09]]), 7.0),),
    "by hand",
)


@pytest.fixture
def written(store: Store, tmp_path: Path) -> Path:
    path = tmp_path / "s.nxs"
    write_nexus(store, TABLE, RESULT, path)
    return path


def text(node: h5py.Dataset) -> str:
    return str(node[()].decode())


def test_default_leads_from_the_root_to_the_samples_of_a_valid_run(written: Path) -> None:
    with h5py.File(written) as file:
        entry = file[file.attrs["default"]]
        data = entry[entry.attrs["default"]]
        assert [node.attrs["NX_class"] for node in (file, entry, data)] == ["NXroot", "NXentry", "NXdata"]
        assert text(entry["entry_identifier"]) == "1⁄2 <i>"
        assert (data.attrs["signal"], list(data.attrs["axes"])) == ("accel_v", ["t_s"])
        assert data["accel_v"][()].tobytes() == VOLTS.tobytes()
        assert (data["accel_v"].attrs["units"], data["t_s"].attrs["units"]) == ("V", "s")
        assert data["accel_v"].attrs["sha256"] == hashlib.sha256(VOLTS.tobytes()).hexdigest()
        assert data["accel_v_errors"][()].tolist() == [4e-4] * 5
        assert data["accel_v_errors"].id.get_storage_size() == 0
        assert data["a_b__V_"].attrs["long_name"] == "a/b [V]"


def test_a_channel_on_its_own_clock_has_its_own_times(written: Path) -> None:
    with h5py.File(written) as file:
        data = file["run_1_2__i_/data_laser_1_mm"]
        assert list(data.attrs["axes"]) == ["laser_1_mm_t_s"]
        assert data["laser_1_mm_t_s"][()].tolist() == OWN_S.tolist()
        assert data["laser_1_mm_t_s_errors"][()].tolist() == [0.02, 0.02]
        assert "laser_1_mm" not in file["run_1_2__i_/data"]


def test_a_run_has_its_settings_its_times_and_its_mark(written: Path) -> None:
    with h5py.File(written) as file:
        run, marked, cut_off = file["run_1_2__i_"], file["run_2"], file["run_3"]
        settings = run["settings"]
        assert (settings["theta_deg"][()], settings["theta_deg"].attrs["units"]) == (1 / 3, "deg")
        assert (settings["mounting"][()], settings["on"][()]) == (1, 1)
        assert (text(settings["note"]), json.loads(text(settings["n"]))) == ("a␀b", 2**70)
        assert json.loads(text(settings["spots"])) == ["a", 2]
        began, ended = (np.datetime64(text(run[name]).removesuffix("+00:00")) for name in ("start_time", "end_time"))
        assert ended - began == np.timedelta64(5, "s")
        record = marked["record"]
        assert (record["valid"][()], text(record["reason"]), text(record["key"])) == (0, "a door", "second")
        assert (text(cut_off["record/state"]), cut_off["record/valid"][()]) == ("interrupted", 0)
        assert cut_off["data/accel_v"][()].tolist() == [7.0]
        events = [json.loads(line) for line in text(file["campaign/events/data"]).splitlines()]
        assert [event["data"]["reason"] for event in events if event["kind"] == "mark"] == ["a door"]


def test_the_campaign_has_its_files_instruments_item_and_result(written: Path) -> None:
    with h5py.File(written) as file:
        campaign = file["campaign"]
        rig = campaign["configuration/rig"]
        assert text(rig["data"]) == '[rig]\nname = "x"\n'
        assert text(rig["checksum"]) == hashlib.sha256(rig["data"][()]).hexdigest()
        assert campaign["configuration/constants/g_m_s2"].attrs["units"] == "m/s2"
        assert text(campaign["instrument/dmm/serial_number"]) == "MY1"
        assert text(campaign["instrument/accel_v/type"]) == "accelerometer"
        assert text(file["run_2/sample/fabrication/vendor"]) == "us"
        quantities = campaign["result/quantities"]
        assert (quantities["axis_Y__x"][()], quantities["axis_Y__x_2"][()]) == (0.25, 3.0)
        assert quantities["axis_Y__x_2"].attrs["units"] == "arcsec"
        assert quantities["axis_Y__x_2_errors"][()] == pytest.approx(0.3)
        assert campaign["result/uncertainty/covariance"][()].tolist() == [[0.04, 0.01], [0.01, 0.09]]


def test_the_table_is_plotted_by_what_was_measured(written: Path) -> None:
    with h5py.File(written) as file:
        table = file["campaign/table"]
        assert (file["campaign"].attrs["default"], table.attrs["signal"]) == ("table", "nu_in_phase")
        assert table["nu_in_phase_errors"][0] == 0.5
        assert table["run_id"].asstr()[()].tolist() == ["a", ""]


def test_xarray_takes_the_times_for_a_coordinate(written: Path) -> None:
    with xarray.open_dataset(written, group="run_1_2__i_/data", engine="h5netcdf") as data:
        assert dict(data.sizes) == {"t_s": 5}
        assert data.accel_v.sel(t_s=4.0) == 1e300
        assert data.accel_v.attrs["units"] == "V"


def test_every_name_is_one_of_nexus(written: Path) -> None:
    names: list[str] = []
    with h5py.File(written) as file:
        file.visit(names.append)
        assert len(names) > 100
        for name in names:
            assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name.rpartition("/")[2]), name


def test_names_that_become_alike_are_told_apart() -> None:
    names = Names(["taken"])
    assert [names.of(each) for each in ("a/b", "a b", "1", "", "taken", "a_b_errors")] == [
        "a_b",
        "a_b_2",
        "_1",
        "_",
        "taken_2",
        "a_b_errors_2",
    ]


def test_a_long_run_goes_by_in_blocks(tmp_path: Path) -> None:
    count = 2 * BLOCK + 17
    t_s, volts = np.arange(count) / 1000.0, np.sin(np.arange(count))
    with Store.create(tmp_path / "s.rig.sqlite", Header("sensing-axis")) as store:
        with store.begin_run("long", "", {}, "1") as writer:
            for first in range(0, count, 1000):
                writer.append({"t_s": t_s[first : first + 1000]})
            for first in range(0, count, 90_001):
                writer.append({"accel_v": volts[first : first + 90_001]})
            writer.finish()
        write_nexus(store, StoreTable(()), None, tmp_path / "s.nxs")
    with h5py.File(tmp_path / "s.nxs") as file:
        data = file["run_1/data"]
        assert data["accel_v"].chunks == (BLOCK,)
        assert data["accel_v"].fletcher32
        np.testing.assert_array_equal(data["t_s"], t_s, strict=True)
        np.testing.assert_array_equal(data["accel_v"], volts, strict=True)


def test_a_store_without_runs_is_a_file_too(tmp_path: Path) -> None:
    with Store.create(tmp_path / "s.rig.sqlite", Header("table", channels={"v": ChannelInfo("V")})) as store:
        write_nexus(store, StoreTable(()), None, tmp_path / "s.nxs")
    with h5py.File(tmp_path / "s.nxs") as file:
        assert (list(file), file.attrs["default"]) == (["campaign"], "campaign")


def test_damage_ends_it_and_leaves_nothing_until_the_run_is_marked_invalid(store: Store, tmp_path: Path) -> None:
    with sqlite3.connect(store.path) as connection:
        connection.execute(
            "UPDATE samples SET data = zeroblob(length(data)) WHERE id = (SELECT MIN(id) FROM samples)"
        )
    path = tmp_path / "s.nxs"
    with pytest.raises(DamagedStore, match=r"the samples of run 1⁄2 <i> are not as they were written"):
        write_nexus(store, TABLE, RESULT, path)
    assert not list(tmp_path.glob("*.nxs*")) + list(tmp_path.glob(".*.nxs*"))
    store.mark("1⁄2 <i>", False, "damaged")
    write_nexus(store, TABLE, RESULT, path)
    with h5py.File(path) as file:
        assert "data" not in file["run_1_2__i_"]
        assert "not as they were written" in text(file["run_1_2__i_/record/samples_left_out"])


@pytest.mark.parametrize("hdf5_export", [False, True])
def test_a_full_disk_is_one_line_and_leaves_nothing(
    store: Store, tmp_path: Path, capfd: pytest.CaptureFixture[str], hdf5_export: bool
) -> None:
    path, before = tmp_path / "s.nxs", sorted(tmp_path.iterdir())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(DataError, match=r"s\.nxs: cannot be written \(File too large\); check the directory and"):
            write_hdf5(store, path) if hdf5_export else write_nexus(store, TABLE, RESULT, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert sorted(tmp_path.iterdir()) == before
    # HDF5 has a word on every object that it could not write.
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mine.nxs", "mine.nxs: exists already; name another file"),
        ("no/s.nxs", r"no/s.nxs: cannot be written \(No such file or directory\); check the directory"),
        ("mine.nxs/s.nxs", r"s.nxs: cannot be written \(Not a directory\)"),
        ("n" * 260 + ".nxs", r"cannot be written \(File name too long\)"),
    ],
)
def test_a_place_where_no_file_can_be_is_named(store: Store, tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "mine.nxs").write_text("mine")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(DataError, match=message):
        write_nexus(store, TABLE, RESULT, tmp_path / name)
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "mine.nxs").read_text() == "mine"
