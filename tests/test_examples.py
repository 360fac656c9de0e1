"""The tour of docs/workbench.md: hidden effects are named, the unknown one is described and explained by a file."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.blind_sampler import nulls_deg
from benchmarks.unknown_effect import DESIGN, GAIN_PER_HPA, SEED, recording
from rigctl.campaign.bundle.bundle import read_bundle
from rigctl.cli.application import app
from simulators.worlds.bench_settings import isa_twin

ROOT = Path(__file__).parent.parent
UNKNOWN = ROOT / "examples" / "unknown-effect"
PLUGIN = str(UNKNOWN / "my_effect.py")
DRAFT = "drafted.py"
NULL = "theta0[X,flag,1]"


def rigctl(*arguments: str) -> Any:
    """The JSON document a command prints."""
    found = CliRunner().invoke(app, [*arguments, "--json"])
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


def ladder(*arguments: str) -> list[tuple[str | None, float, float]]:
    """What each version added, and its errors on the runs of the fit and on held-out ones."""
    rungs = rigctl("model", "history", *arguments)
    return [(rung["added"], rung["error_fit"], rung["error_held_out"]) for rung in rungs]


@pytest.fixture(scope="module")
def at_a_desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    directory = tmp_path_factory.mktemp("desk")
    with contextlib.chdir(directory):
        yield directory


@pytest.fixture(scope="module")
def hidden(at_a_desk: Path) -> dict[str, Any]:
    """The first round of the page: the shipped campaign run, diagnosed, and what was suggested added."""
    store = "hidden.rig.sqlite"
    rigctl("run", str(ROOT / "campaigns" / "hidden-effect.toml"), "--store", store, "--yes")
    compared, diagnosed = rigctl("compare", store), rigctl("diagnose", store)
    rigctl("model", "add", store, *diagnosed["suggested"])
    return {"compare": compared, "diagnose": diagnosed, "ladder": ladder(store), "fit": rigctl("fit", store)}


@pytest.fixture(scope="module")
def unknown(at_a_desk: Path) -> dict[str, Any]:
    """The second round: another laboratory's recording, and what the catalogue says of it."""
    store = "unknown.rig.sqlite"
    rigctl("import", str(UNKNOWN), "--store", store)
    found = {"store": store, "diagnose": rigctl("diagnose", store, "--draft", DRAFT)}
    rigctl("model", "add", store, *found["diagnose"]["suggested"])
    return found


@pytest.fixture(scope="module")
def explained(unknown: dict[str, Any], at_a_desk: Path) -> dict[str, Any]:
    """The same with the ten lines that explain it."""
    store = _copy(unknown["store"], "explained.rig.sqlite")
    rigctl("model", "add", store, "pressure-gain", "--plugin", PLUGIN)
    return {
        "store": store,
        "ladder": ladder(store, "--plugin", PLUGIN),
        "fit": rigctl("fit", store, "--plugin", PLUGIN),
        "diagnose": rigctl("diagnose", store, "--plugin", PLUGIN),
    }


def _copy(store: str, name: str) -> str:
    Path(name).write_bytes(Path(store).read_bytes())
    return name


def test_the_hidden_effects_are_named_with_their_sizes(hidden: dict[str, Any]) -> None:
    assert hidden["compare"]["p_value"] < 1e-4
    found = hidden["diagnose"]
    assert found["verdict"] == "effect"
    assert found["suggested"] == ["quadratic", "cable-hysteresis"]
    assert found["unexplained"] is None
    sizes = {name: size for rank in found["ranking"] for name, size in rank["parameters"].items()}
    for name, true in (("K2[X]", 2e-3), ("h", 1e-6)):
        assert sizes[name]["value"] == pytest.approx(true, abs=4.0 * sizes[name]["sigma"])


def test_each_rung_of_the_hidden_ladder_helps_on_runs_it_has_not_seen(hidden: dict[str, Any]) -> None:
    assert [added for added, _, _ in hidden["ladder"]] == [None, "quadratic", "cable-hysteresis"]
    held_out = [error for _, _, error in hidden["ladder"]]
    assert held_out == sorted(held_out, reverse=True)
    assert held_out[0] > 1.15
    assert held_out[-1] == pytest.approx(1.0, abs=0.06)
    assert hidden["fit"]["p_value"] > 0.01


def test_the_shipped_recording_is_the_one_its_script_makes() -> None:
    shipped, made = read_bundle(UNKNOWN), recording()
    assert shipped.header.channels == made.header.channels
    assert [run.run_id for run in shipped.runs()] == [run.run_id for run in made.runs()]
    for there, here in zip(shipped.runs(), made.runs(), strict=True):
        assert {name: there.conditions[name] for name in here.conditions} == here.conditions
        columns, expected = shipped.samples(there.run_id), made.samples(here.run_id)
        assert set(columns) == set(expected)
        for name, values in expected.items():
            # A digit more or less where another machine's arithmetic rounds to the other side.
            assert np.allclose(columns[name], values, rtol=0.0, atol=1.01e-4 if "laser" in name else 1.01e-6), name


def test_what_no_effect_explains_is_described(unknown: dict[str, Any]) -> None:
    found = unknown["diagnose"]
    assert found["verdict"] == "unknown"
    assert found["suggested"] == ["resonance", "roll-gravity"]
    left = found["unexplained"]
    assert (left["channel"], left["component"]) == ("accel_v", "nu in-phase")
    assert left["details"]["covariate"] == "signal*pressure_hpa"
    assert left["description"].endswith(
        "in proportion to the signal, with pressure_hpa (size per standard deviation of it)"
    )
    assert left["p_value"] < 1e-20


def test_a_drafted_effect_has_the_form_of_what_was_hidden_and_brings_the_ladder_down(unknown: dict[str, Any]) -> None:
    text = Path(DRAFT).read_text(encoding="utf-8")
    assert 'on="sensor_output_v"' in text
    assert 'return k * (run.column("pressure_hpa") - 1010) * run.signal' in text
    store = _copy(unknown["store"], "drafted.rig.sqlite")
    rigctl("model", "add", store, "drafted", "--plugin", DRAFT)
    fit = rigctl("fit", store, "--plugin", DRAFT)
    size = fit["parameters"]["k"]
    assert size["unit"] == "1/hPa"
    assert size["value"] == pytest.approx(GAIN_PER_HPA, abs=4.0 * size["sigma"])
    assert fit["error_held_out"] == pytest.approx(1.0, abs=0.05)


def test_what_no_column_explains_of_a_table_is_drafted_too(at_a_desk: Path) -> None:
    rigctl("import", str(ROOT / "tests" / "foreign" / "data" / "galton"), "--store", "galton.rig.sqlite")
    found = rigctl("diagnose", "galton.rig.sqlite", "--draft", "families.py")
    assert found["verdict"] == "unknown"
    assert rigctl("effects", "drafted", "--plugin", "families.py")["on"] == "response"


def test_ten_lines_make_the_model_adequate(explained: dict[str, Any]) -> None:
    assert explained["diagnose"]["verdict"] == "adequate"
    assert explained["diagnose"]["unexplained"] is None
    size = explained["fit"]["parameters"]["kP"]
    assert size["value"] == pytest.approx(GAIN_PER_HPA, abs=4.0 * size["sigma"])
    assert size["sigma"] < 0.03 * GAIN_PER_HPA
    assert [added for added, _, _ in explained["ladder"]] == [None, "resonance", "roll-gravity", "pressure-gain"]
    held_out = [error for _, _, error in explained["ladder"]]
    assert held_out[2] > 2.0
    assert held_out[3] == pytest.approx(1.0, abs=0.05)


def test_only_the_right_effect_gives_the_right_null(explained: dict[str, Any]) -> None:
    ((true_deg),) = nulls_deg(isa_twin(SEED), DESIGN).values()
    right = explained["fit"]["parameters"][NULL]
    assert right["value"] == pytest.approx(true_deg, abs=3.0 * right["sigma"])
    short_of_it = rigctl("model", "history", explained["store"], "--plugin", PLUGIN)[2]["result"][NULL]
    assert abs(short_of_it["value"] - true_deg) > 8.0 * short_of_it["sigma"]


def test_a_wrong_effect_does_not_bring_the_error_down(unknown: dict[str, Any]) -> None:
    store = _copy(unknown["store"], "wrong.rig.sqlite")
    rigctl("model", "add", store, "thermal-gain")
    rigctl("model", "remove", store, "thermal-gain")
    rigctl("model", "add", store, "encoder-eccentricity")
    before, thermal, _, eccentric = [error for _, _, error in ladder(store)][-4:]
    assert thermal >= before
    assert eccentric > 1.8
    page = (ROOT / "docs" / "workbench.md").read_text(encoding="utf-8")
    for name, error in (("nothing", before), ("`thermal-gain`", thermal), ("`encoder-eccentricity`", eccentric)):
        (said,) = re.findall(rf"^\| {name} \| \S+ \| (\S+) \|", page, re.MULTILINE)
        assert float(said) == pytest.approx(error, rel=0.02)


def test_nothing_runs_the_file_but_the_user(explained: dict[str, Any]) -> None:
    refused = CliRunner().invoke(app, ["fit", explained["store"], "--json"])
    assert refused.exit_code != 0
    assert "--plugin" in str(refused.exception)


def test_ladders_of_the_page_are_those_of_the_program(hidden: dict[str, Any], explained: dict[str, Any]) -> None:
    page = (ROOT / "docs" / "workbench.md").read_text(encoding="utf-8")
    said = re.findall(r"^│ (\d): (?:\+ )?([\w+ -]+?) +│ +(\S+) │ +(\S+) │ +(\S+) │$", page, re.MULTILINE)
    expected = [*hidden["ladder"], *explained["ladder"]]
    assert len(said) == len(expected)
    for (_, change, _, fit, held_out), (added, error_fit, error_held_out) in zip(said, expected, strict=True):
        assert added is None or change == added
        assert float(fit) == pytest.approx(error_fit, rel=0.02)
        assert float(held_out) == pytest.approx(error_held_out, rel=0.02)
