import json

import h5py
import numpy as np
import pytest

from rigctl.campaign.bundle.hdf5 import write_hdf5
from rigctl.campaign.recording import ChannelInfo, Header, LaserInfo
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError

HEADER = Header(
    "sensing-axis",
    title="nuit à ±2°",
    started="2026-11-21T01:00:00Z",
    rig_toml="[rig]\n" + "# long\n" * 20_000,
    seed=3,
    constants={"g_m_s2": 9.803},
    channels={"accel_v": ChannelInfo("V", "accelerometer", full_scale=10.0)},
    lasers={"laser_1_mm": LaserInfo("x", 5.0)},
    extra={"big": 2**70},
)


@pytest.fixture
def store(tmp_path):
    with Store.create(tmp_path / "s.rig.sqlite", HEADER) as store:
        conditions = {"axis": "X", "theta_deg": 1 / 3, "mounting": 1, "note": "a\0b", "spots": ["a", 2], "n": 2**70}
        with store.begin_run("X 1", "phase 1", conditions) as writer:
            writer.append({"t_s": np.arange(5.0), "accel_v": np.array([0.1, np.nan, -0.0, 1e-320, 1e300])})
            writer.append({"odd/name": np.ones(5)})
            writer.finish(valid=False, reason="door")
        store.begin_run("X 2", "phase 1", {"axis": "X"}).append({"t_s": np.arange(2.0)})
        store.add_event("note", {"text": "°"}, 2.5)
        store.add_document("fit", {"chi2": 1.25})
        store.set_identity("dmm", {"serial": "MY1"})
        store.set_status({"state": "done"})
        yield store


def test_hdf5_carries_everything(store, tmp_path):
    write_hdf5(store, tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5") as file:
        assert file.attrs["experiment"] == "sensing-axis"
        assert file.attrs["title"] == HEADER.title
        header = json.loads(file["header"][()])
        assert (header["rig_toml"], header["seed"]) == (HEADER.rig_toml, 3)
        assert file["constants"].attrs["g_m_s2"] == 9.803
        assert file["channels/accel_v"].attrs["full_scale"] == 10.0
        assert file["lasers/laser_1_mm"].attrs["face"] == "x"
        run = file["runs/1"]
        assert run.attrs["theta_deg"] == 1 / 3
        assert (run.attrs["axis"], run.attrs["mounting"], run.attrs["key"]) == ("X", 1, "X 1")
        assert (bool(run.attrs["valid"]), run.attrs["reason"], run.attrs["step"]) == (False, "door", "phase 1")
        assert json.loads(run.attrs["spots"]) == ["a", 2]
        assert json.loads(run.attrs["note"]) == "a\0b"
        assert json.loads(run.attrs["n"]) == 2**70
        assert list(run) == ["t_s", "accel_v", "odd∕name"]
        assert run["accel_v"].attrs["unit"] == "V"
        assert run["accel_v"][()].tobytes() == store.samples("1")["accel_v"].tobytes()
        assert file["interrupted_runs/2"].attrs["state"] == "acquiring"
        np.testing.assert_array_equal(file["interrupted_runs/2/t_s"], [0, 1])
        (event,) = map(json.loads, file["events"])
        assert (event["kind"], event["rig_time_s"], event["data"]) == ("note", 2.5, {"text": "°"})
        (document,) = map(json.loads, file["documents"])
        assert document["data"] == {"chi2": 1.25}
        assert json.loads(file["identities"][()]) == {"dmm": {"serial": "MY1"}}
        assert json.loads(file["status"][()]) == {"state": "done"}


def test_empty_campaign_is_a_file_too(tmp_path):
    with Store.create(tmp_path / "s.rig.sqlite", Header("table")) as store:
        write_hdf5(store, tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5") as file:
        assert len(file["runs"]) == len(file["events"]) == 0


def test_existing_file_is_left_alone(store, tmp_path):
    (tmp_path / "s.h5").write_text("mine")
    with pytest.raises(DataError, match=r"s\.h5: exists already; name another file"):
        write_hdf5(store, tmp_path / "s.h5")
    assert (tmp_path / "s.h5").read_text() == "mine"


def test_unwritable_place_is_named(store, tmp_path):
    with pytest.raises(DataError, match=r"no/s\.h5: cannot be written"):
        write_hdf5(store, tmp_path / "no/s.h5")
