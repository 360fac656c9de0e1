"""The commands on a recording of the rotating platform, from the bundle to the error ladder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.platform_sampler import SampledRun, record, sampled
from rigctl import Campaign
from rigctl.campaign.bundle.bundle import write_bundle
from rigctl.cli.application import app
from rigctl.composition import opened_workbench
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.model.model import PlatformModel
from rigctl.experiments.rotating_platform.observe import channel_runs
from rigctl.experiments.rotating_platform.observe.channel_runs import ChannelRun
from simulators.worlds.platform_settings import PlatformSettings

RUNS = [
    SampledRun("c", 60.0, 30, v_z_v=0.0),
    SampledRun("b", 60.0, 30, v_z_v=1.0),
    SampledRun("c", 300.0, 12, v_z_v=0.5),
]


def run(*words: object) -> Any:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout) if "--json" in words else done.stdout


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("cli")
    nature = PlatformSettings.model_validate(
        {"kind": "rotating-platform", "seed": 6, "effects": {"recovery-signed": {"e": 5e-6, "t_r": 5.0}}}
    )
    record(nature, RUNS, place / "bundle")
    run("import", place / "bundle", "--store", place / "s.rig.sqlite")
    return place / "s.rig.sqlite"


def test_what_each_run_tells_of_its_noise_is_worked_out_once(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def channels() -> list[ChannelRun]:
        with opened_workbench(store) as bench:
            model = bench.study.model(())
            assert isinstance(model, PlatformModel)
            return list(model.recorded.channels)

    first = channels()
    monkeypatch.setattr(channel_runs, "_likelihood", lambda _: pytest.fail("worked out again"))
    for one, other in zip(first, channels(), strict=True):
        assert (one.noise.white, one.noise.dof) == (other.noise.white, other.noise.dof)
        np.testing.assert_array_equal(one.noise.red, other.noise.red)
        np.testing.assert_array_equal(one.factor, other.factor)


def test_a_notebook_has_the_result_of_the_platform(store: Path) -> None:
    found = Campaign.result(store)
    assert found.as_json().items() <= run("result", store, "--json").items()
    assert sorted(found.accel_m_s2) == ["y", "z"]


def test_a_result_says_what_contradicts_it(tmp_path: Path) -> None:
    """A level of runs.csv that is not that of the samples, a pattern that is another, and a fit that is none."""
    record(PlatformSettings(kind="rotating-platform", seed=6), RUNS, tmp_path / "bundle")
    table = tmp_path / "bundle" / "runs.csv"
    names, *rows = [line.split(",") for line in table.read_text().splitlines()]
    rows[0][names.index("pattern")] = "b"
    rows[1][names.index("v_z_v")] = "0.25"
    table.write_text("\n".join(",".join(row) for row in (names, *rows)) + "\n")
    read = run("import", tmp_path / "bundle", "--store", tmp_path / "s.rig.sqlite", "--json")
    tilt = "v_z_v is 0.25 V (constant), dm1_z_v has 1 V: dm1_z_v counts; correct runs.csv, or mark the run invalid "
    # Who imports has runs.csv at hand, and learns it there.
    assert [each.partition(": ")[2] for each in read["warnings"]] == [f"{tilt}if dm1_z_v is wrong"]
    found = run("result", tmp_path / "s.rig.sqlite", "--json")
    first, second, third = [each["remarks"] for each in found["runs"]]
    assert first == [
        "r01: pattern is b, the platform rests at other times: that of theta_deg and moving counts; "
        "correct runs.csv, it looks like c"
    ]
    assert second == [f"r02: {tilt}if dm1_z_v is wrong"]
    assert third == []
    assert found["warnings"] == []


def test_a_result_says_that_its_model_does_not_describe_the_data(tmp_path: Path) -> None:
    def mistaken(number: int, samples: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {**samples, "dm1_z_v": 0.5 * samples["dm1_z_v"]} if number == 2 else samples

    made = sampled(PlatformSettings(kind="rotating-platform", seed=6), RUNS, mistaken)
    write_bundle(made, tmp_path / "bundle")
    run("import", tmp_path / "bundle", "--store", tmp_path / "s.rig.sqlite")
    [warning] = run("result", tmp_path / "s.rig.sqlite", "--json")["warnings"]
    assert warning.startswith("the model, version 1, does not describe these data, and no sigma holds: chi2/dof is ")
    said = " ".join(run("result", tmp_path / "s.rig.sqlite").split())
    assert said.index("does not describe these data") < said.index("Means of the runs")


@pytest.mark.parametrize(("factor", "word"), [(-1.0, "sign"), (1e-3, "unit")])
def test_a_result_says_that_a_chain_has_another_sign_or_unit(tmp_path: Path, factor: float, word: str) -> None:
    def mistaken(_: int, samples: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {**samples, "dm1_z_v": factor * samples["dm1_z_v"]}

    settings = PlatformSettings(kind="rotating-platform", seed=6)
    write_bundle(sampled(settings, RUNS, mistaken), tmp_path / "bundle")
    run("import", tmp_path / "bundle", "--store", tmp_path / "s.rig.sqlite")
    # The model describes such data as well as any.
    [warning] = run("result", tmp_path / "s.rig.sqlite", "--json")["warnings"]
    assert warning.startswith("the gain of the commanded tilt is ")
    assert f"dm1_z_v has another {word}; mend the recording" in warning


def test_from_bundle_to_a_model_that_holds(store: Path) -> None:
    compared = run("compare", store, "--json")
    components = {each["component"] for each in compared["channels"]}
    assert components == {
        "accel mean", "accel slope", "bias mean", "bias slope", "after turn", "before turn", "spectrum"
    }  # fmt: skip
    found = run("diagnose", store, "--json")
    assert (found["verdict"], found["suggested"]) == ("effect", ["recovery-signed"])
    size = found["ranking"][0]["parameters"]["e[z]"]
    assert size["value"] == pytest.approx(5e-6, abs=4.0 * size["sigma"])
    assert ("theta-locked-bias", "baseline:accel_z0") in {(e["effect"], e["from"]) for e in found["inseparable"]}
    run("model", "add", store, "recovery-signed")
    fitted = run("fit", store, "--json")
    assert {"tilt_gain", "accel_z0", "accel_y0", "bias_z[r01]", "bias_rate_y[r03]", "e[z]", "t_r"} <= set(
        fitted["parameters"]
    )
    assert fitted["error_held_out"] == pytest.approx(1.0, abs=0.12)
    first, second = run("model", "history", store, "--json")
    assert second["error_held_out"] < first["error_held_out"]


def test_the_result_at_a_terminal_and_as_json(store: Path) -> None:
    told = run("result", store, "--json")
    assert [each["run_id"] for each in told["runs"]] == ["r01", "r02", "r03"]
    assert (told["scans"], told["noise"]) == ([], [])
    budget = told["budget"]
    assert budget["outputs"] == ["tilt_gain", "accel_z", "accel_y", "wobble_a", "wobble_b"]
    assert budget["combined"][1] == pytest.approx(told["accel_m_s2"]["z"]["sigma"], rel=1e-6)
    assert budget["covariance"][1][1] == pytest.approx(budget["combined"][1] ** 2, rel=1e-6, abs=0.0)
    assert budget["monte_carlo"]["validated"], budget["monte_carlo"]["reason"]
    shown = run("result", store)
    assert "Uncertainty of tilt gain / 1, accelerations / m/s2, wobbles / rad." in shown
    assert "Monte Carlo: the first order agrees" in shown
    assert "gain of the commanded tilt │ 0.96" in " ".join(shown.split())
    assert "Not tested by any modulation: theta-locked-bias, pendulum-reaction." in shown


def test_a_second_question_reads_no_samples(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from rigctl.campaign.store.store import Store

    def refused(*_: object) -> Any:
        raise AssertionError("the samples were read again")

    run("compare", store, "--json")
    monkeypatch.setattr(Store, "samples", refused)
    monkeypatch.setattr(Store, "sample_chunks", refused)
    assert run("compare", store, "--json")["channels"]


def test_ids_that_two_experiments_share_are_both_told() -> None:
    told = run("effects", "quadratic", "--json")
    assert told["experiment"] == "sensing-axis"
    assert [each["experiment"] for each in told["others"]] == ["rotating-platform"]
    own = run("effects", "rotating-platform:quadratic", "--json")
    assert own["parameters"] == {"K2": "s2/m"}
    assert own["scope"] == "channel"


def test_a_campaign_that_cannot_tell_its_noise_has_been_run_and_has_no_result_yet(tmp_path: Path) -> None:
    short = "pattern = 'a'\nmodulation_period_s = 60.0\nperiods = 1\nv_z_v = 0.5\n"
    campaign = _campaign(tmp_path, f"{short}external = 'sine'\nexternal_period_s = 100.0\n")
    done = CliRunner().invoke(app, ["run", str(campaign), "--store", str(tmp_path / "s.rig.sqlite"), "--yes"])
    assert done.exit_code == 0, done.output
    assert "no result yet: the runs are too short to tell their noise: record more periods" in done.stderr


def test_the_report_of_a_single_run_is_written(tmp_path: Path) -> None:
    """Its covariates have no value at all in some of its series."""
    campaign = _campaign(tmp_path, "pattern = 'c'\nmodulation_period_s = 60.0\nperiods = 2\nv_z_v = [0.0]\n")
    run("run", campaign, "--store", tmp_path / "s.rig.sqlite", "--yes")
    run("report", tmp_path / "s.rig.sqlite", "--out", tmp_path / "report")


def _campaign(place: Path, run_of_it: str) -> Path:
    rig = Path(__file__).parents[1] / "campaigns" / "bias-rejection-rig.toml"
    head = f"experiment = 'rotating-platform'\nrig = '{rig}'\n[procedure]\nname = 'bias-rejection'\n"
    path = place / "campaign.toml"
    path.write_text(f"{head}[[procedure.runs]]\n{run_of_it}", encoding="utf-8")
    return path
