"""The samples of a run as CSV: bit for bit, with units and the noise of each sample."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.recording import ChannelInfo, Header
from rigctl.campaign.store.store import Store
from rigctl.core.errors import DataError
from rigctl.exchange.stream_csv import write_stream_csv
from rigctl.exchange.streams import BLOCK
from tests.exchange.conftest import VOLTS


def read(path: Path) -> dict[str, list[float]]:
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    return {name: [float(row[place]) for row in rows] for place, name in enumerate(header)}


def test_samples_come_back_bit_for_bit_with_their_noise(store: Store, tmp_path: Path) -> None:
    left_out = write_stream_csv(store, "1⁄2 <i>", tmp_path / "s.csv")
    columns = read(tmp_path / "s.csv")
    assert list(columns) == ["t_s", "accel_v", "u_accel_v", "a/b [V]"]
    assert np.array(columns["accel_v"]).tobytes() == VOLTS.tobytes()
    assert columns["u_accel_v"] == [4e-4] * 5
    assert [stream.channel for stream in left_out] == ["laser_1_mm"]


def test_a_unit_that_the_name_does_not_tell_stands_behind_it(tmp_path: Path) -> None:
    header = Header("table", channels={"m1, x": ChannelInfo("m/s2", noise_rms=1e-12), "t_s": ChannelInfo("s")})
    count = BLOCK + 5
    with Store.create(tmp_path / "s.rig.sqlite", header) as store:
        with store.begin_run("k", "", {}, "only") as writer:
            writer.append({"t_s": np.arange(count) / 8.0, "m1, x": np.arange(count) / 3.0})
            writer.finish()
        assert write_stream_csv(store, None, tmp_path / "s.csv") == ()
    columns = read(tmp_path / "s.csv")
    assert list(columns) == ["t_s", "m1, x [m/s2]", "u_m1, x [m/s2]"]
    assert columns["m1, x [m/s2]"] == (np.arange(count) / 3.0).tolist()


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (None, r"2 runs in it \(1⁄2 <i>, 2\); name one with --run"),
        ("7", "no run 7; the nearest are"),
    ],
)
def test_which_run_is_asked_for(store: Store, tmp_path: Path, run: str | None, message: str) -> None:
    with pytest.raises(DataError, match=message):
        write_stream_csv(store, run, tmp_path / "s.csv")
    assert not list(tmp_path.glob("*s.csv*"))


def test_without_a_run_there_is_nothing_to_write(tmp_path: Path) -> None:
    with Store.create(tmp_path / "e.rig.sqlite", Header("table")) as store:
        with pytest.raises(DataError, match="no finished run in it, so no samples"):
            write_stream_csv(store, None, tmp_path / "s.csv")
        with store.begin_run("k", "", {}, "1") as writer:
            writer.finish()
        with pytest.raises(DataError, match="run 1 has no samples on the rig's clock"):
            write_stream_csv(store, "1", tmp_path / "s.csv")
