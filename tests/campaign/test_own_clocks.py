"""Channels on clocks of their own, in bundles and in stores: nothing is lost, nothing else is taken for one."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle, read_bundle, salvage_bundle, write_bundle
from rigctl.campaign.bundle.hdf5 import write_hdf5
from rigctl.campaign.bundle.sample_file import npz_bytes
from rigctl.campaign.recording import ChannelInfo, Header, own_clocks
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError

OWN_S = 0.013 + 0.0101 * np.arange(390)


@pytest.fixture
def own(sensing: Any) -> Any:
    """The night's bundle, laser_2 on a clock of its own in two of its runs."""
    sensing.toml = sensing.toml.replace(
        "[lasers.laser_1_mm]", '[channels.laser_2_mm]\nclock = "own"\nclock_u_s = 0.01\n\n[lasers.laser_1_mm]'
    )
    for run_id in "123":
        header, *rows = sensing.tables[f"runs/{run_id}.csv"]
        sensing.tables[f"runs/{run_id}.csv"] = [header[:-1], *(row[:-1] for row in rows)]
    for run_id in "12":
        values = np.round(np.random.default_rng(int(run_id)).normal(size=OWN_S.size), 4)
        sensing.columns(f"runs/{run_id}.laser_2_mm.csv", t_s=OWN_S, laser_2_mm=values)
    return sensing


def test_a_channel_of_its_own_clock_has_its_own_times(own: Any) -> None:
    recording = read_bundle(own.write())
    assert recording.header.channels["laser_2_mm"] == ChannelInfo("mm", clock="own", clock_u_s=0.01)
    assert own_clocks(recording.header) == ("laser_2_mm",)
    samples = recording.samples("1")
    assert list(samples) == ["t_s", "stage_x_mm", "accel_v", "laser_1_mm", "laser_2_mm", "laser_2_mm.t_s"]
    np.testing.assert_array_equal(samples["laser_2_mm.t_s"], OWN_S, strict=True)
    assert samples["laser_2_mm"].shape == OWN_S.shape
    assert "laser_2_mm" not in recording.samples("3")
    assert not [warning for warning in recording.report.warnings if "laser_2" in warning]


@pytest.mark.parametrize("form", ["csv", "npz"])
def test_bundle_to_store_to_bundle_loses_nothing_of_it(own: Any, tmp_path: Path, form: str) -> None:
    if form == "npz":
        table = own.tables.pop("runs/1.laser_2_mm.csv")
        columns = dict(zip(table[0], np.array(table[1:], dtype=np.float64).T, strict=True))
        own.raw["runs/1.laser_2_mm.npz"] = npz_bytes(columns)
    first = read_bundle(own.write())
    with import_bundle(own.path, tmp_path / "s.rig.sqlite") as store:
        write_bundle(store, tmp_path / "again")
        write_hdf5(store, tmp_path / "all.h5")
    again = read_bundle(tmp_path / "again")
    assert again.header == first.header
    for run_id in "123":
        mine, theirs = first.samples(run_id), again.samples(run_id)
        assert list(mine) == list(theirs)
        for name, column in mine.items():
            np.testing.assert_array_equal(column, theirs[name], strict=True)
    with h5py.File(tmp_path / "all.h5") as file:
        np.testing.assert_array_equal(file["runs/1/laser_2_mm.t_s"], OWN_S)


def test_a_store_whose_header_was_lost_still_gives_a_bundle_that_says_it(own: Any, tmp_path: Path) -> None:
    path = tmp_path / "s.rig.sqlite"
    import_bundle(own.write(), path).close()
    with sqlite3.connect(path) as connection:
        connection.execute("DELETE FROM header")
    salvage_bundle(path, tmp_path / "saved")
    saved = read_bundle(tmp_path / "saved")
    assert own_clocks(saved.header) == ("laser_2_mm",)
    assert saved.samples("1")["laser_2_mm.t_s"].shape == OWN_S.shape


def test_a_run_cut_off_before_its_own_clocks_were_read_is_saved_without_them(own: Any, tmp_path: Path) -> None:
    path = tmp_path / "s.rig.sqlite"
    import_bundle(own.write(), path).close()
    with Store.open(path) as store:
        conditions = store.runs()[0].conditions
        with store.begin_run("late", "scan", conditions, "late") as writer:
            writer.append({"t_s": np.arange(400) * 0.01, "accel_v": np.zeros(400)})
    salvage_bundle(path, tmp_path / "saved")
    assert not list((tmp_path / "saved" / "runs").glob("late.laser*"))
    assert "laser_2_mm" not in read_bundle(tmp_path / "saved").samples("late")


def spoil(own: Any, what: str) -> None:
    if what == "a clock of another kind":
        own.toml = own.toml.replace('clock = "own"', 'clock = "rig"')
    elif what == "an uncertainty of nothing":
        own.toml = own.toml.replace("clock_u_s = 0.01", "clock_u_s = 0.0")
    elif what == "another column":
        own.columns("runs/1.laser_2_mm.csv", t_s=OWN_S, laser_2_mm=OWN_S, laser_3_mm=OWN_S)
    elif what == "times that go back":
        own.columns("runs/1.laser_2_mm.csv", t_s=OWN_S[::-1], laser_2_mm=OWN_S)
    elif what == "too short":
        own.columns("runs/1.laser_2_mm.csv", t_s=OWN_S[:50], laser_2_mm=OWN_S[:50])
    elif what == "among the others":
        t_s = np.arange(400) * 0.01
        own.columns("runs/1.csv", t_s=t_s, stage_x_mm=t_s, accel_v=t_s, laser_2_mm=t_s)
    elif what == "two files":
        own.raw["runs/1.laser_2_mm.npz"] = npz_bytes({"t_s": OWN_S, "laser_2_mm": OWN_S})
    else:
        own.set("runs.csv", 3, "run_id", "1.laser_2_mm")


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("a clock of another kind", "channels.laser_2_mm.clock is 'rig'; write \"own\""),
        ("an uncertainty of nothing", "clock_u_s is not positive"),
        ("another column", "laser_3_mm; write t_s and laser_2_mm"),
        ("times that go back", "time does not go on"),
        ("too short", "0.505 s is too short: one period takes 2 s"),
        ("among the others", "move it with its times to runs/1.laser_2_mm.csv"),
        ("two files", "has both runs/1.laser_2_mm.csv and runs/1.laser_2_mm.npz"),
        ("a run of that name", "give it another run_id"),
    ],
)
def test_what_cannot_be_a_channel_of_its_own_clock_is_refused(own: Any, refusal: Any, what: str, words: str) -> None:
    spoil(own, what)
    assert words in refusal(own.write())


def test_other_experiments_have_one_clock(platform: Any, refusal: Any) -> None:
    platform.toml += '[channels.q_b_v]\nclock = "own"\n'
    assert "channels.q_b_v" in refusal(platform.write())


def test_gaps_and_saturation_of_it_are_told_and_cost_no_run(own: Any) -> None:
    own.toml = own.toml.replace('clock = "own"', 'clock = "own"\nfull_scale = 3.0')
    gap = np.where(np.arange(OWN_S.size) < 100, OWN_S, OWN_S + 0.5)
    own.columns("runs/1.laser_2_mm.csv", t_s=gap, laser_2_mm=np.where(OWN_S > 3.0, 3.0, np.nan))
    recording = read_bundle(own.write())
    assert recording.runs()[0].valid
    told = [warning for warning in recording.report.warnings if "1.laser_2_mm.csv" in warning]
    assert [each.split(": ", 1)[1].split(",")[0] for each in told] == [
        "1 gap in t_s",
        f"laser_2_mm: {int((OWN_S <= 3.0).sum())} of {OWN_S.size} samples missing",
        f"laser_2_mm: {int((OWN_S > 3.0).sum())} of {OWN_S.size} samples saturated (full scale 3 mm)",
    ]


def test_a_store_wants_each_channel_as_long_as_its_times(tmp_path: Path) -> None:
    columns = {"t_s": np.zeros(4), "a": np.zeros(4), "b": np.zeros(3), "b.t_s": np.zeros(3)}
    with Store.create(tmp_path / "s.rig.sqlite", Header("sensing-axis")) as store:
        with store.begin_run("one", "scan", {}) as writer:
            writer.append(columns)
            writer.finish()
        for name, length in (("b", 4), ("a", 3)):
            with store.begin_run(f"odd {name}", "scan", {}) as writer:
                writer.append({**columns, name: np.zeros(length)})
                with pytest.raises(DataError, match=f"differ in length .*{name} {length}"):
                    writer.finish()
        assert len(store.samples(store.runs()[0].run_id)["b"]) == 3
