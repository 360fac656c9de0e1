"""A hundred thousand readings with two effects hidden in them: `make foreign`, for it takes half a minute."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import workbench_of

ROWS = 100_000
PERIOD_S, AMPLITUDE_V, CURVATURE_V_K2 = 137.0, 0.01, 3e-4

pytestmark = [
    pytest.mark.skipif("RIGCTL_FOREIGN" not in os.environ, reason="slow: make foreign"),
    pytest.mark.timeout(600),
]


def write(bundle: Path) -> None:
    rng = np.random.default_rng(20)
    time_s, load_n, room_k = rng.uniform(0.0, 5000.0, ROWS), rng.uniform(0.0, 50.0, ROWS), rng.normal(20.0, 2.0, ROWS)
    pressure_pa, humidity = rng.normal(1e5, 500.0, ROWS), rng.lognormal(-1.0, 0.3, ROWS)
    reading_v = 0.5 + 0.02 * load_n + 0.1 * rng.standard_normal(ROWS)
    reading_v += AMPLITUDE_V * np.cos(2.0 * np.pi * time_s / PERIOD_S + 0.7) + CURVATURE_V_K2 * (room_k - 20.0) ** 2
    bundle.mkdir()
    (bundle / "recording.toml").write_text(
        'format = 1\nexperiment = "table"\ntitle = "long"\n\n'
        '[table]\nresponse = "reading_v"\nbaseline = "b0 + b1 * load_n"\n\n[channels.humidity]\nunit = "1"\n'
    )
    header = "reading_v,time_s,load_n,room_k,pressure_pa,humidity"
    table = np.column_stack([reading_v, time_s, load_n, room_k, pressure_pa, humidity])
    np.savetxt(bundle / "readings.csv", table, fmt="%.7g", delimiter=",", header=header, comments="")


def test_two_hidden_effects_are_found_in_a_hundred_thousand_rows(tmp_path: Path) -> None:
    write(tmp_path / "bundle")
    with import_bundle(tmp_path / "bundle", tmp_path / "long.rig.sqlite") as store:
        found = workbench_of(store).diagnose()
    assert {term.effect for term in found.suggested} >= {"periodic[time_s]"}
    assert {term.effect for term in found.suggested} & {"turning[room_k]", "power2[room_k]"}
    assert len(found.suggested) == 2
    assert found.joint_fit is not None
    period = found.joint_fit.parameters["periodic[time_s].period"]
    assert abs(period.value - PERIOD_S) < 4.0 * period.sigma
