"""The shipped campaigns, small, from files to results through the command line."""

from __future__ import annotations

import json
import math
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl import runner
from rigctl.campaign.recording import on_rig_time, time_column
from rigctl.campaign.store.store import Store
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig

RESULT_KEYS = {
    "coc", "uoaf", "std_hc_2sigma_arcsec", "theta_m_arcsec", "vectors", "covariance", "requirement_arcsec", "pass"
}  # fmt: skip
MARKER = 0.123456789012
"""A number of nature's that nobody would come by otherwise."""


REFERENCE = """
[reference]
source = "the last calibration"

[reference.axes]
X = [0.99992, 1.45e-3, 1.28e-2]
"""


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory, campaigns: Path, small: str) -> Path:
    """The store of one axis, two mountings per configuration."""
    path = tmp_path_factory.mktemp("measured")
    (path / "campaign.toml").write_text(small.replace("mountings = 1", "mountings = 2") + REFERENCE)
    rig = read_rig(campaigns / "isa-rig.toml")
    store = path / "x.rig.sqlite"
    runner.start(read_campaign(path / "campaign.toml"), rig, store, runner.Options(unattended=True))
    return store


def rig_seconds(path: Path) -> dict[str, float]:
    """Rig time of each event by what happened."""
    with Store.open(path, readonly=True) as store:
        return {str(event.data.get("key", event.kind)): event.rig_time_s or 0.0 for event in store.events()}


def test_a_run_tells_where_it_is_how_it_went_and_what_it_found(desk: Any) -> None:
    ran = desk.run()
    assert ran.status == 0, ran.err
    assert ran.json["store"] == str(desk.store)
    assert ran.json["status"] == desk.rigctl("status", desk.store, "--json").json
    assert ran.json["result"] == desk.rigctl("result", desk.store, "--json").json
    status = ran.json["status"]
    assert set(status) >= {"state", "step", "runs_done", "runs_planned", "runs_invalid", "eta_s"}
    assert (status["state"], status["runs_invalid"], status["eta_s"]) == ("done", 0, 0.0)
    assert status["runs_done"] == status["runs_planned"] == 6
    assert ran.json["result"]["missing"]["X"].endswith("at least three motion vectors, not 2")


def test_one_axis_ends_with_every_key_of_the_contract(desk: Any, measured: Path) -> None:
    result = desk.rigctl("result", measured, "--json").json
    assert set(result) >= {"axes", "angles"}
    assert result["angles"] == {}
    assert set(result["axes"]) == {"X"}
    axis = result["axes"]["X"]
    assert set(axis) >= RESULT_KEYS
    assert axis["vectors"] == 4
    assert axis["requirement_arcsec"] == 100.0
    assert axis["pass"] is (axis["std_hc_2sigma_arcsec"] <= 100.0) is True
    coc, uoaf = np.array(axis["coc"]), np.array(axis["uoaf"])
    assert np.linalg.norm(coc) == pytest.approx(1.0, abs=1e-12)
    turn = math.radians(35.0)
    r_uc = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
    assert uoaf == pytest.approx(r_uc @ coc, abs=1e-9)


def test_the_covariance_is_singular_along_the_axis_and_covers_the_truth(desk: Any, measured: Path) -> None:
    axis = desk.rigctl("result", measured, "--json").json["axes"]["X"]
    covariance, coc = np.array(axis["covariance"]), np.array(axis["coc"])
    assert covariance.shape == (3, 3)
    assert covariance == pytest.approx(covariance.T, rel=1e-9)
    values = np.linalg.eigvalsh(covariance)
    assert np.abs(covariance @ coc).max() < 1e-6 * values[2]
    assert values[1] > 0.1 * values[2] > 0.0
    assert np.degrees(math.sqrt(values[2])) * 3600.0 < 60.0
    truth = np.array([0.99992, 1.4503e-3, 1.2822e-2])
    error = coc - truth / np.linalg.norm(truth)
    # Two components over their scatter of 4 - 2 degrees of freedom: one in a thousand lies beyond.
    assert error @ np.linalg.pinv(covariance, rcond=1e-6) @ error < 2 * 999.0
    assert np.linalg.norm(error) < 5e-4


def test_a_seed_gives_the_same_bits_and_another_seed_another_night(desk: Any) -> None:
    desk.campaign(('["pendulum", "flag"]', '["flag"]'))

    def samples(name: str, seed: int) -> tuple[Any, list[bytes]]:
        store = desk.directory / name
        result = desk.rigctl("run", "campaign.toml", "--store", store, "--yes", "--json", "--seed", seed).json[
            "result"
        ]
        with Store.open(store, readonly=True) as opened:
            assert opened.header.seed == seed
            columns = [opened.samples(run.run_id) for run in opened.runs()]
        return result, [column.tobytes() for run in columns for column in run.values()]

    first, again, other = samples("a", 5), samples("b", 5), samples("c", 6)
    assert first == again
    assert first[0] != other[0]


def test_nature_stays_out_of_store_and_exports(desk: Any) -> None:
    desk.rig(
        ("[world]\nseed = 2022", f"# the marker is {MARKER}\n[world]\nseed = 2022\nbias_sigma_v = {MARKER}"),
        ("[constants.g_m_s2]", "[world.ground]\nbump_frequency_hz = 0.2123456789\n\n[constants.g_m_s2]"),
    )
    assert desk.run().status == 0
    assert desk.rigctl("export", desk.store, "bundle").status == 0
    assert desk.rigctl("export", desk.store, "hdf5", "--format", "hdf5").status == 0
    secrets = [str(MARKER).encode(), b"0.2123456789", b"[world.", b"true_axis", b"9.7e-5"]
    kept = [path for path in desk.directory.rglob("*") if path.is_file() and path.suffix != ".toml"]
    kept += list((desk.directory / "bundle").rglob("*.toml"))
    assert {path.name for path in kept} >= {"x.rig.sqlite", "recording.toml", "runs.csv"}
    for path in kept:
        for secret in secrets:
            assert secret not in path.read_bytes(), f"{path.name} holds {secret!r}"
    with sqlite3.connect(desk.store) as database:
        assert not [line for line in database.iterdump() if str(MARKER) in line or "true_axis" in line]
    database.close()
    truth = (desk.directory / "x.rig.sqlite.truth.toml").read_text()
    assert str(MARKER) in truth
    assert "0.2123456789" in truth
    assert "true_axis" in truth
    assert "[package]" not in truth


def test_a_record_says_all_it_takes_to_run_it_again(desk: Any) -> None:
    assert desk.run("--seed", 3).status == 0
    with Store.open(desk.store, readonly=True) as store:
        header = store.header
        assert header.experiment == "sensing-axis"
        assert header.title == "small"
        assert header.campaign_toml == (desk.directory / "campaign.toml").read_text()
        assert header.rig_toml is not None
        assert "[instruments.rotation]" in header.rig_toml
        assert header.world_sha256
        assert header.seed == 3
        assert set(header.versions) >= {"rigctl", "numpy", "scipy"}
        assert set(store.identities()) == {
            "rotation",
            "stage",
            "lasers_a",
            "lasers_b",
            "accelerometer",
            "thermometer",
        }
        for run in store.runs():
            assert set(run.conditions) >= {
                "axis", "configuration", "mounting", "theta_deg", "frequency_hz", "amplitude_mm", "approach",
                "start_s", "temperature_c",
            }  # fmt: skip
            columns = store.samples(run.run_id)
            assert set(on_rig_time(columns)) == {"t_s", "accel_v", "stage_x_mm"}
            assert len({len(column) for column in on_rig_time(columns).values()}) == 1
            for head in ("laser_1_mm", "laser_2_mm", "laser_3_mm"):
                assert len(columns[head]) == len(columns[time_column(head)]) > 0.99 * len(columns["t_s"])
        starts = [run.conditions["start_s"] for run in store.runs()]
        assert starts == sorted(starts)


def test_the_quick_check_takes_under_ten_minutes_and_finds_a_healthy_axis(desk: Any, campaigns: Path) -> None:
    desk.campaign(("isa-rig.toml", "rig.toml"), text=(campaigns / "quick-check.toml").read_text())
    found = desk.run()
    assert found.status == 0, found.err
    assert found.json["result"]["warnings"] == []
    check = found.json["result"]["quick_check"]
    assert check["passed"] is True
    assert abs(check["reversal"]) < 1e-3
    assert check["laser_scale"] == pytest.approx(1.0, abs=1e-3)
    assert check["gain_v_per_m_s2"] == pytest.approx(59.7 / (1 - (0.6 / 4.53) ** 2), rel=5e-3)
    at = rig_seconds(desk.store)
    assert 0.0 < at["quick check"] - at["X pendulum 1 level 1"] < 600.0
    with Store.open(desk.store, readonly=True) as store:
        angles = [run.conditions["theta_deg"] for run in store.runs()]
        theta0_deg = check["theta0_deg"]
        assert angles[1:] == pytest.approx([theta0_deg + 90.0, theta0_deg - 90.0], abs=1e-3)


def test_the_quick_check_finds_a_laser_with_a_wrong_scale(desk: Any, campaigns: Path) -> None:
    desk.campaign(("isa-rig.toml", "rig.toml"), text=(campaigns / "quick-check.toml").read_text())
    roll = "[world.effects.roll-gravity]"
    desk.rig((roll, f'[world.effects.laser-cosine]\n"dt[laser_1_mm]" = 0.05\n\n{roll}'))
    check = desk.run().json["result"]["quick_check"]
    assert check["passed"] is False
    tilt = math.radians(5.0)
    assert check["laser_scale"] == pytest.approx(math.cos(tilt) / math.cos(tilt + 0.05), abs=1e-3)


def test_the_angle_scan_measures_its_grid(desk: Any, campaigns: Path) -> None:
    text = (campaigns / "angle-scan.toml").read_text()
    desk.campaign(
        ("isa-rig.toml", "rig.toml"),
        ("[-1.6, -1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2, 1.6]", "[0.2, 0.8, 1.4]"),
        ("dwell_s = 20.0", "dwell_s = 10.0"),
        text=text,
    )
    found = desk.run()
    assert found.status == 0, found.err
    assert found.json["status"]["runs_done"] == found.json["status"]["runs_planned"] == 9
    with Store.open(desk.store, readonly=True) as store:
        grid = {(run.conditions["theta_asked_deg"], run.conditions["frequency_hz"]) for run in store.runs()}
        assert grid == {(theta, frequency) for theta in (0.2, 0.8, 1.4) for frequency in (0.3, 0.5, 0.6)}
        for run in store.runs():
            assert run.conditions["theta_deg"] == pytest.approx(run.conditions["theta_asked_deg"], abs=1e-3)
            assert store.samples(run.run_id)["t_s"][-1] >= 10.0 - 0.02
    (null,) = found.json["result"]["nulls"]
    assert null["theta0_deg"] == pytest.approx(0.774, abs=0.01)


def test_another_accelerometer_is_another_table(desk: Any, campaigns: Path) -> None:
    desk.rig(of="one-axis.rig.toml")
    text = (campaigns / "one-axis.toml").read_text()
    desk.campaign(("one-axis.rig.toml", "rig.toml"), ("mountings = 3", "mountings = 2"), text=text)
    found = desk.run()
    assert found.status == 0, found.err
    result = found.json["result"]
    assert set(result["axes"]) == {"Y"}
    axis = result["axes"]["Y"]
    assert axis["requirement_arcsec"] == 60.0
    assert axis["pass"] is True
    x, y, z = axis["coc"]
    assert axis["uoaf"] == pytest.approx([x, -z, y], abs=1e-12)
    truth = np.array([3e-3, 1.0, -5e-3])
    assert np.array(axis["coc"]) == pytest.approx(truth / np.linalg.norm(truth), abs=2e-4)
    with Store.open(desk.store, readonly=True) as store:
        assert {run.conditions["frequency_hz"] for run in store.runs()} == {0.25, 0.5}
        assert set(store.samples("1")) == {"t_s", "accel_v", "stage_x_mm", "laser_main_mm", "laser_side_mm"}


def test_a_campaign_may_run_on_another_rig_and_keeps_its_store_beside_the_user(desk: Any, campaigns: Path) -> None:
    desk.campaign(('rig = "rig.toml"\n', ""))
    found = desk.rigctl("run", "campaign.toml", "--rig", campaigns / "all-instruments.rig.toml", "--yes", "--json")
    assert found.status == 0, found.err
    assert found.json["store"] == "campaign.rig.sqlite"
    with Store.open(desk.directory / "campaign.rig.sqlite", readonly=True) as store:
        assert len(store.identities()) == 12


def test_a_result_for_people_is_printed_beside_its_reference(desk: Any, measured: Path) -> None:
    shown = desk.rigctl("result", measured).out
    assert "ref: the last calibration" in shown
    assert "+0.012800" in shown
    assert "pass" in shown
    assert "done: 12 of 12 runs (0 invalid)" in desk.rigctl("status", measured).out


def test_figures_of_a_campaign_are_written_by_a_command(desk: Any, measured: Path) -> None:
    written = desk.rigctl("report", measured, "--figures", "figures", "--json").json["written"]
    assert {Path(path).suffix for path in written} >= {".svg", ".csv"}
    assert all(Path(path).stat().st_size > 0 for path in written)
    desk.rigctl("report", measured).refused(2, "nothing to write", "--figures")


def test_a_report_holds_the_axis_itself(desk: Any, measured: Path) -> None:
    axis = desk.rigctl("result", measured, "--json").json["axes"]["X"]
    assert desk.rigctl("report", measured, "--out", "x.html").status == 0
    page = (desk.directory / "x.html").read_text()
    found = page[page.index("<h2>Result</h2>") :]
    for text in (*(f"{component:+.6f}" for component in axis["coc"]), f"{axis['std_hc_2sigma_arcsec']:.2f}", "pass"):
        assert f">{text}</td>" in found


def test_json_has_no_infinities(desk: Any, measured: Path) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    assert json.loads(desk.rigctl("result", measured, "--json").out, parse_constant=refuse)
