"""A Tiled server, filled by bluesky's `TiledWriter` with the documents of a store, and of a scan of our devices."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bluesky import RunEngine
from bluesky.callbacks.tiled_writer import TiledWriter
from bluesky.plans import scan
from tiled.client import from_uri
from tiled.server import SimpleTiledServer

from rigctl import Rig, Store
from rigctl.bluesky import devices_of, documents
from rigctl.campaign.bundle.bundle import import_bundle

BUNDLE = Path(__file__).parents[2] / "examples" / "pontius"


@pytest.fixture
def tiled(tmp_path: Path) -> Iterator[Any]:
    with SimpleTiledServer(tmp_path / "tiled") as server:
        client = from_uri(server.uri)
        yield client
        client.context.http_client.close()


def test_a_campaign_in_tiled_has_the_numbers_of_its_store(tiled: Any, tmp_path: Path) -> None:
    path = tmp_path / "x.rig.sqlite"
    with import_bundle(BUNDLE, path) as store:
        for run_id, angle_deg in {"a": 0.5, "b": -0.5}.items():
            with store.begin_run(run_id, "", {"theta_deg": angle_deg}, run_id) as run:
                run.stream({"t_s": np.arange(200) / 100.0, "accel_v": angle_deg * np.arange(200)})
                run.finish({})
    writer = TiledWriter(tiled)
    for name, document in documents(path):
        writer(name, document)
    (campaign,) = tiled.values()
    assert campaign.metadata["stop"]["exit_status"] == "success"
    with Store.open(path, readonly=True) as store:
        assert campaign.metadata["start"]["title"] == store.header.title
        for run in store.runs():
            rows = {name: rows_of(campaign, name, run.run_id) for name in ("runs", "samples")}
            assert rows["runs"]["run_id"].tolist() == [run.run_id]
            for column, values in store.samples(run.run_id).items():
                np.testing.assert_array_equal(rows["samples"][column], values)


def rows_of(campaign: Any, prefix: str, run_id: str) -> Any:
    """A run's rows, a frame, in the one stream of this kind that has them."""
    frames = [stream.read().to_dataframe() for name, stream in campaign.items() if name.startswith(prefix)]
    (rows,) = (frame[frame.run_id == run_id] for frame in frames if run_id in set(frame.run_id))
    return rows


def test_a_scan_in_tiled(tiled: Any, campaigns: Path) -> None:
    engine = RunEngine({})
    engine.subscribe(TiledWriter(tiled))
    with Rig.from_file(campaigns / "isa-rig.toml") as rig:
        devices = devices_of(rig)
        rig.only("rotation").home()
        (uid,) = engine(scan([devices["thermometer"]], devices["rotation"], -1.0, 1.0, 5))
    primary = tiled[uid]["primary"]
    assert primary["rotation_deg"].read() == pytest.approx(np.linspace(-1.0, 1.0, 5), abs=1e-3)
    assert len(primary["thermometer_c"].read()) == 5
