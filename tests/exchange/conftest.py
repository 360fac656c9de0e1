"""A small store with everything that is awkward in a file for others."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.recording import ChannelInfo, Header
from rigctl.campaign.store.store import Store

NAN = float("nan")
VOLTS = np.array([0.1, NAN, -0.0, 1e-320, 1e300])
OWN_S = np.array([0.05, 1.07])

HEADER = Header(
    "sensing-axis",
    title="nuit à ±2° <b>&</b>",
    started="2026-11-21T01:00:00.000+00:00",
    rig_toml='[rig]\nname = "x"\n',
    versions={"rigctl": "0.1.0"},
    constants={"g_m_s2": 9.803},
    channels={
        "stage_x_mm": ChannelInfo("mm", "stage"),
        "accel_v": ChannelInfo("V", "accelerometer", noise_rms=4e-4, full_scale=10.0),
        "laser_1_mm": ChannelInfo("mm", "laser", clock="own", clock_u_s=0.02),
    },
    extra={"item": {"name": "accelerometer", "serial": "FM-1", "manufacturer": "us"}},
)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    conditions = {"theta_deg": 1 / 3, "mounting": 1, "note": "a\0b", "spots": ["a", 2], "n": 2**70, "start_s": 10.0}
    with Store.create(tmp_path / "s.rig.sqlite", HEADER) as store:
        with store.begin_run("first", "phase 1", {**conditions, "on": True}, "1⁄2 <i>") as writer:
            writer.append({"t_s": np.arange(3.0), "accel_v": VOLTS[:3], "a/b [V]": np.ones(3)})
            writer.append({"t_s": np.arange(3.0, 5.0), "accel_v": VOLTS[3:], "a/b [V]": np.ones(2)})
            writer.append({"laser_1_mm": np.array([1.0, 2.0]), "laser_1_mm.t_s": OWN_S})
            writer.finish(rig_time_s=15.0)
        with store.begin_run("second", "phase 1", {"theta_deg": 0.5}, "2") as writer:
            writer.append({"t_s": np.arange(2.0), "accel_v": np.array([5.0, 6.0])})
            writer.finish()
        with store.begin_run("third", "phase 1", {"theta_deg": "unknown"}, "3") as writer:
            writer.append({"t_s": np.arange(2.0), "accel_v": np.array([7.0])})
        store.mark("2", False, "a door")
        store.set_identity("dmm", {"model": "34465A", "serial": "MY1", "firmware": "A.02", "text": "Keysight,34465A"})
        store.set_status({"state": "done", "step": "", "runs_planned": 2, "eta_s": 0.0})
        yield store
