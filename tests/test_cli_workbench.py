"""The workbench's commands on a table whose model lacks its curvature: the loop from compare to the error ladder."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl import Campaign
from rigctl.campaign.store.store import Store
from rigctl.workbench.model.versions import last_diagnosis
from rigctl.workbench.workbench import Workbench

RECORDING = """\
format = 1
experiment = "table"
title = "load cell"

[table]
response = "deflection_mm"
baseline = "b0 + b1 * load_n"
block = "day"
"""

PLUGIN = '''\
from rigctl.effects import effect


@effect("sag", on="response", parameters={"s": "mm"}, typical={"s": 1e-3}, source="made up")
def sag(run, s):
    """The frame gives way from the second day on."""
    return s * (run.column("day") > 1)
'''


def bundle(directory: Path, curvature: float = -3e-5, sag: float = 0.0, seed: int = 4) -> Path:
    """Five days with ten loads each; noise of 2 um."""
    rng = np.random.default_rng(seed)
    directory.mkdir()
    lines = ["load_n,day,deflection_mm"]
    for day in range(5):
        for load in range(0, 100, 10):
            value = 0.1 + 0.06 * load + curvature * load**2 + sag * (day > 1) + 2e-3 * rng.standard_normal()
            lines.append(f"{load},{day},{value:.9f}")
    (directory / "readings.csv").write_text("\n".join(lines) + "\n")
    (directory / "recording.toml").write_text(RECORDING)
    return directory


@pytest.fixture
def bench(desk: Any, tmp_path: Path) -> Any:
    """A desk with the table in its store."""
    bundle(tmp_path / "bundle")
    assert desk.rigctl("import", "bundle", "--store", desk.store).out == f"50 rows read into {desk.store}\n"
    return desk


@pytest.fixture
def plugin(tmp_path: Path) -> Path:
    path = tmp_path / "sag.py"
    path.write_text(PLUGIN)
    return path


def words(text: str) -> str:
    """Text without the line breaks of a narrow terminal."""
    return " ".join(text.split())


def test_compare_says_where_the_model_fails(bench: Any) -> None:
    found = bench.rigctl("compare", bench.store, "--json").json
    assert found["model"] == {"version": 1, "effects": []}
    assert found["chi2_per_dof"] > 2.0
    assert found["p_value"] < 1e-3
    (channel,) = found["channels"]
    assert channel["channel"] == "deflection_mm"
    assert channel["unit"] == "mm"
    assert channel["noise"] == pytest.approx(2e-3, rel=0.3)
    assert channel["rms"] > 1.5 * channel["noise"]
    assert abs(found["worst"][0]["sigma"]) >= abs(found["worst"][-1]["sigma"]) > 0.0
    assert found["trends"][0]["covariate"] == "load_n"
    told = bench.rigctl("compare", bench.store).out
    assert "The model does not describe the data" in told
    assert "FAILS" in told
    assert "component" not in told
    assert max(map(len, told.splitlines())) <= 80


def test_diagnose_names_the_effect_and_adds_nothing(bench: Any) -> None:
    found = bench.rigctl("diagnose", bench.store, "--json")
    assert found.json["suggested"] == ["power2[load_n]"]
    assert found.json["verdict"] in {"effect", "ambiguous"}
    first = found.json["ranking"][0]
    assert first["effect"] == "power2[load_n]"
    size = first["parameters"]["power2[load_n]"]
    assert size["value"] == pytest.approx(-3e-5, abs=4.0 * size["sigma"])
    assert first["p_value_corrected"] < 0.01
    assert first["held_out_error_ratio"] < 0.8
    assert {"inseparable", "unexplained", "next_measurement", "not_testable"} <= set(found.json)
    assert found.err
    assert bench.rigctl("model", "show", bench.store, "--json").json["effects"] == []
    told = bench.rigctl("diagnose", bench.store, "--alpha", "0.05").out
    assert "power2[load_n]" in told.split("Candidates")[0]
    assert f"rigctl model add {bench.store} 'power2[load_n]'" in told.replace("\n", "")
    assert max(map(len, told.split("Candidates")[1].splitlines())) <= 80


def test_the_ladder_shows_what_each_version_brought(bench: Any) -> None:
    added = bench.rigctl("model", "add", bench.store, "power2[load_n]", "--json").json
    assert [(each["version"], each["parent"], each["added"]) for each in added] == [(2, 1, "power2[load_n]")]
    first, second = bench.rigctl("model", "history", bench.store, "--json").json
    assert first["effects"] == []
    assert first["added"] is None
    assert second["added"] == "power2[load_n]"
    assert second["error_fit"] == pytest.approx(1.0, abs=0.2)
    assert first["error_fit"] > 1.5
    assert second["error_held_out"] < first["error_held_out"]
    told = bench.rigctl("model", "history", bench.store).out
    assert re.search(r"2: \+ power2\[load_n\] +\S", told)
    fit = bench.rigctl("fit", bench.store, "--json").json
    assert set(fit["parameters"]) == {"b0", "b1", "power2[load_n]"}
    assert fit["chi2_per_dof"] == pytest.approx(1.0, abs=0.4)
    result = bench.rigctl("result", bench.store, "--json").json
    assert result == fit
    assert "b1" in bench.rigctl("result", bench.store).out


def test_fits_of_the_ladder_are_kept(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.rigctl("model", "add", bench.store, "power2[load_n]")
    before = bench.rigctl("model", "history", bench.store, "--json")
    assert "fitting version" in before.err

    def never(*_: object) -> None:
        raise AssertionError("it was fitted already")

    monkeypatch.setattr("rigctl.workbench.workbench.Workbench.fit", never)
    after = bench.rigctl("model", "history", bench.store, "--json")
    assert after.json == before.json
    assert after.err == ""


@pytest.mark.parametrize("command", ["compare", "diagnose", "fit"])
def test_what_was_asked_of_the_same_runs_is_not_worked_out_again(
    bench: Any, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    first = bench.rigctl(command, bench.store, "--json").out
    with monkeypatch.context() as patch:
        patch.setattr(Workbench, "study", property(lambda _: pytest.fail("the runs were read again")))
        assert bench.rigctl(command, bench.store, "--json").out == first
    bench.rigctl("mark", bench.store, "readings", "the frame was touched", "--invalid")
    refused = bench.rigctl(command, bench.store, "--json")
    assert refused.status == 2
    assert refused.err.endswith(
        "the readings are declared invalid (the frame was touched); mark them valid to use them\n"
    )


def test_a_diagnosis_that_is_asked_for_again_is_the_last_one(bench: Any) -> None:
    first = bench.rigctl("diagnose", bench.store, "--json").json
    assert bench.rigctl("diagnose", bench.store, "--alpha", "1e-60", "--json").json["suggested"] != first["suggested"]
    for _ in range(2):
        assert bench.rigctl("diagnose", bench.store, "--json").json == first
    with Store.open(bench.store, readonly=True) as store:
        last = last_diagnosis(store)
        assert last is not None
        assert last["suggested"] == first["suggested"]
        assert len(store.documents("diagnosis")) == 3


def test_what_is_removed_is_out_and_what_was_is_not_forgotten(bench: Any) -> None:
    bench.rigctl("model", "add", bench.store, "power2[load_n]", "linear[day]")
    removed = bench.rigctl("model", "remove", bench.store, "linear[day]", "--json").json
    assert [(each["version"], each["removed"], each["effects"]) for each in removed] == [
        (4, "linear[day]", ["power2[load_n]"])
    ]
    ladder = bench.rigctl("model", "history", bench.store, "--json").json
    assert [len(each["effects"]) for each in ladder] == [0, 1, 2, 1]


def test_what_cannot_be_added_or_removed_is_one_line_and_changes_nothing(bench: Any) -> None:
    bench.rigctl("model", "add", bench.store, "power2[load_n]")
    add, remove = ("model", "add", bench.store), ("model", "remove", bench.store)
    bench.rigctl(*add, "power2[load_n]").refused(2, "power2[load_n]", "already")
    bench.rigctl(*add, "power2[lod_n]").refused(2, "unknown effect 'power2[lod_n]'", "power2[load_n]")
    bench.rigctl(*add, "linear[day]", "nonsense").refused(2, "unknown effect 'nonsense'")
    bench.rigctl(*add, "linear[day]", "linear[day]").refused(2, "already")
    bench.rigctl(*remove, "linear[day]").refused(2, "'linear[day]' is not in the model", "power2[load_n]")
    bench.rigctl(*remove, "power2[load_n]", "nonsense").refused(2, "nonsense")
    assert bench.rigctl("model", "show", bench.store, "--json").json["version"] == 2


@pytest.mark.parametrize("effects", [["linear[load_n]"], ["power2[load_n]", "linear[load_n]"]])
def test_what_these_data_cannot_tell_from_the_model_is_not_added(bench: Any, effects: list[str]) -> None:
    added = bench.rigctl("model", "add", bench.store, *effects)
    added.refused(2, "cannot be added to a model of these data", "these data cannot tell linear[load_n] from")
    assert bench.rigctl("model", "show", bench.store, "--json").json["effects"] == []
    assert bench.rigctl("fit", bench.store).status == 0


def test_a_scanned_effect_gets_its_choice(bench: Any) -> None:
    (added,) = bench.rigctl("model", "add", bench.store, "step[day]", "--json").json
    (term,) = added["terms"]
    assert term["effect"] == "step[day]"
    assert term["choice"]
    diagnosed = bench.rigctl("diagnose", bench.store, "--json").json
    choice = next(r["choice"] for r in diagnosed["ranking"] if r["effect"] == "periodic[load_n]")
    (later,) = bench.rigctl("model", "add", bench.store, "periodic[load_n]", "--json").json
    assert later["terms"][-1] == {"effect": "periodic[load_n]", "choice": choice}


@pytest.mark.parametrize("alpha", ["0", "1", "-0.1", "7"])
def test_a_level_that_is_none_is_refused(bench: Any, alpha: str) -> None:
    bench.rigctl("diagnose", bench.store, "--alpha", alpha).refused(2, "alpha", "between 0 and 1")


def test_another_store_is_compared_with_the_same_model(bench: Any, tmp_path: Path) -> None:
    bundle(tmp_path / "like", seed=5)
    bundle(tmp_path / "unlike", curvature=-9e-5, seed=6)
    bench.rigctl("model", "add", bench.store, "power2[load_n]")
    found = {}
    for name in ("like", "unlike"):
        assert bench.rigctl("import", name, "--store", f"{name}.rig.sqlite").status == 0
        found[name] = bench.rigctl("compare", bench.store, "--with", f"{name}.rig.sqlite", "--json").json["with"]
    assert found["like"]["error_transferred"] == pytest.approx(1.0, abs=0.25)
    assert found["unlike"]["error_own"] == pytest.approx(1.0, abs=0.25)
    assert found["unlike"]["error_transferred"] > 5.0
    apart = found["unlike"]["parameters"]["power2[load_n]"]
    assert apart["there"]["value"] == pytest.approx(-9e-5, rel=0.1)
    assert apart["sigmas_apart"] < -10.0
    told = bench.rigctl("compare", bench.store, "--with", "unlike.rig.sqlite").out
    assert "unlike.rig.sqlite" in told
    assert "does not hold" in words(told)


def test_an_effect_of_ones_own_is_added_and_its_file_is_asked_for(desk: Any, plugin: Path, tmp_path: Path) -> None:
    bundle(tmp_path / "bundle", curvature=0.0, sag=0.02)
    desk.rigctl("import", "bundle", "--store", desk.store)
    desk.rigctl("model", "add", desk.store, "sag").refused(2, "unknown effect 'sag'", "--plugin FILE")
    found = desk.rigctl("diagnose", desk.store, "--plugin", plugin, "--json").json
    assert "sag" in {rank["effect"] for rank in found["ranking"][:3]}
    (added,) = desk.rigctl("model", "add", desk.store, "sag", "--plugin", plugin, "--json").json
    digest = hashlib.sha256(plugin.read_bytes()).hexdigest()
    assert added["plugins"] == {"sag": {"path": str(plugin), "sha256": digest}}
    fit = desk.rigctl("fit", desk.store, "--plugin", plugin, "--json").json
    (size,) = (each for name, each in fit["parameters"].items() if name.startswith(("sag", "s")))
    assert size["value"] == pytest.approx(0.02, abs=4.0 * size["sigma"])
    for command in (("fit",), ("compare",), ("diagnose",), ("result",), ("model", "history"), ("report",)):
        more = ("--figures", "figures") if command == ("report",) else ()
        desk.rigctl(*command, desk.store, *more).refused(2, str(plugin), "--plugin", digest[:12])
    plugin.write_text(PLUGIN + "# looked at again\n")
    desk.rigctl("fit", desk.store, "--plugin", plugin).refused(2, str(plugin), digest[:12], "as it was")
    assert b"run.column" not in desk.store.read_bytes()
    assert desk.rigctl("model", "remove", desk.store, "sag", "--json").json[0]["plugins"] == {}
    assert desk.rigctl("fit", desk.store, "--json").json["version"] == 3
    ladder = desk.rigctl("model", "history", desk.store, "--json").json
    assert [each["error_fit"] is None for each in ladder] == [False, False, False]


def test_an_older_version_without_its_plugin_says_why_it_has_no_numbers(
    desk: Any, plugin: Path, tmp_path: Path
) -> None:
    bundle(tmp_path / "bundle", sag=0.02)
    desk.rigctl("import", "bundle", "--store", desk.store)
    desk.rigctl("model", "add", desk.store, "sag", "--plugin", plugin)
    desk.rigctl("model", "remove", desk.store, "sag")
    second = desk.rigctl("model", "history", desk.store, "--json").json[1]
    assert second["error_fit"] is None
    assert str(plugin) in second["note"]
    assert "not fitted" in desk.rigctl("model", "history", desk.store).out


@pytest.mark.parametrize("command", ["compare", "diagnose", "fit", "model show", "model history"])
def test_a_store_that_is_missing_or_none_is_refused(desk: Any, command: str) -> None:
    desk.rigctl(*command.split(), "none.rig.sqlite").refused(2, "none.rig.sqlite", "no such store")
    desk.rigctl(*command.split(), "rig.toml").refused(2, "rig.toml", "not a campaign store")


def test_json_has_no_nan(desk: Any, tmp_path: Path) -> None:
    """One block: nothing can be held out."""
    bundle(tmp_path / "bundle")
    text = RECORDING.replace('block = "day"\n', "")
    (tmp_path / "bundle" / "recording.toml").write_text(text)
    desk.rigctl("import", "bundle", "--store", desk.store)

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    for command in (("fit",), ("compare",), ("model", "history"), ("diagnose",)):
        out = desk.rigctl(*command, desk.store, "--json").out
        json.loads(out, parse_constant=refuse)


def test_the_report_of_a_table_is_one_file_that_needs_no_network(bench: Any, tmp_path: Path) -> None:
    bench.rigctl("model", "add", bench.store, "power2[load_n]")
    written = bench.rigctl("report", bench.store, "--out", "r.html", "--figures", "figures", "--json").json["written"]
    assert all(Path(path).is_file() for path in written)
    names = {Path(path).name for path in written}
    assert {
        "r.html",
        "ladder.svg",
        "ladder.csv",
        "residuals_load_n.svg",
        "residuals_load_n.csv",
        "ranking.svg",
    } <= names
    page = (tmp_path / "r.html").read_text()
    for text in ("load cell", "Error ladder", "power2[load_n]", "adequate", "residual / σ"):
        assert text in page
    outside = [url for url in re.findall(r'(?:src|href)="([^"]*)"|url\(([^)]*)\)', page) if not any(map(local, url))]
    assert outside == []
    # All of the script is in the page, and it asks nobody for anything.
    assert "<script src" not in page
    assert not re.search(r"fetch\(|XMLHttp|import\(", page)
    assert page.count("<svg") == len([name for name in names if name.endswith(".svg")])


def local(url: str) -> bool:
    return url.startswith("#")


def test_a_report_needs_somewhere_to_go(bench: Any) -> None:
    bench.rigctl("report", bench.store).refused(2, "--out", "--figures")
    bench.rigctl("report", bench.store, "--out", "no/dir/r.html").refused(2, "no/dir/r.html", "cannot be written")


def test_an_effect_of_an_experiment_without_signatures_says_so(desk: Any, tmp_path: Path) -> None:
    refused = desk.rigctl("effects", "tracker-bias", "--figure", "x.svg")
    refused.refused(2, "tracker-bias", "inflight-calibration", "rigctl report")
    assert not (tmp_path / "x.svg").exists()


def test_a_notebook_has_the_result_of_a_table(bench: Any) -> None:
    told = bench.rigctl("result", bench.store, "--json").json
    assert {"version": 1, **Campaign.result(bench.store).as_json()}.keys() == told.keys()


def test_effects_are_told_and_drawn(desk: Any, tmp_path: Path) -> None:
    known = {each["id"]: each for each in desk.rigctl("effects", "--json").json}
    assert {"roll-gravity", "resonance", "laser-cosine", "mains-pickup"} <= set(known)
    assert "roll-gravity" in desk.rigctl("effects").out
    one = desk.rigctl("effects", "roll-gravity", "--figure", "roll.svg", "--json").json
    assert one == {**known["roll-gravity"], "others": []}
    assert one["parameters"] == {"rho1": "rad/m"}
    assert "eq. 5" in one["source"]
    assert "accel_v, nu in-phase" in (tmp_path / "roll.svg").read_text()
    assert "rho1 / rad/m, typically 0.0001" in desk.rigctl("effects", "roll-gravity").out
    desk.rigctl("effects", "rol-gravity").refused(2, "unknown effect 'rol-gravity'", "roll-gravity")
    desk.rigctl("effects", "--figure", "x.svg").refused(2, "--figure", "name it")
    desk.rigctl("effects", "mains-pickup", "--figure", "x.svg").refused(2, "mains-pickup", "samples")
    assert not (tmp_path / "x.svg").exists()


def test_effects_of_ones_own_are_in_the_catalogue(desk: Any, plugin: Path) -> None:
    told = desk.rigctl("effects", "sag", "--plugin", plugin, "--json").json
    assert told["experiment"] == "table"
    assert told["summary"] == "The frame gives way from the second day on."
    assert told["columns"] == ["day"]
    desk.rigctl("effects", "--plugin", "none.py").refused(2, "none.py", "cannot be read")


OWN = '''\
from rigctl.effects import effect


@effect("barometer", on="specific_force_m_s2", parameters={"kp": "1/hPa"}, typical={"kp": 1e-5})
def barometer(run, kp):
    """The gain follows the air."""
    return kp * (run.column("pressure_hpa") - 1013.25) * run.signal


@effect("tilted", on="angle_rad", parameters={"t2": "rad"}, typical={"t2": 1e-5}, source="the floor")
def tilted(run, t2):
    """The floor gives way."""
    return t2 * run.theta**2


@effect("jump", on="sensor_output_v", parameters={"j": "V"}, typical={"j": 1e-3})
def jump(run, j):
    """The bias jumps in the first half hour."""
    return j * (run.start < 1800.0)
'''


def test_a_signature_of_ones_own_effect_is_drawn_or_says_what_it_lacks(desk: Any, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    options = ("--plugin", "own.py")
    told = desk.rigctl("effects", "barometer", *options).out
    assert "needs to be recorded: column pressure_hpa" in told
    assert "source" not in told
    desk.rigctl("effects", "barometer", *options, "--figure", "x.svg").refused(2, "barometer", "needs pressure_hpa")
    desk.rigctl("effects", "jump", *options, "--figure", "x.svg").refused(2, "jump", "no observable", "3600 s")
    assert not (tmp_path / "x.svg").exists()
    assert desk.rigctl("effects", "tilted", *options, "--figure", "x.svg").out.endswith("source: the floor\n")
    assert "accel_v" in (tmp_path / "x.svg").read_text()


def test_documents_survive_in_the_store(bench: Any) -> None:
    bench.rigctl("model", "add", bench.store, "power2[load_n]")
    bench.rigctl("diagnose", bench.store)
    bench.rigctl("fit", bench.store)
    with Store.open(bench.store, readonly=True) as store:
        kinds = [document.kind for document in store.documents()]
    assert kinds == ["model-version", "diagnosis", "noise-account", "model-fit"]
