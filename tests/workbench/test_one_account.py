"""One account of noise and error: what is found is not noise, the ladder falls, what is diagnosed is added."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.campaign.store.store import Store
from rigctl.composition import opened_workbench
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import StorageError
from rigctl.report.quantities import number
from rigctl.report.terminal_workbench import print_versions
from rigctl.workbench.model import versions
from rigctl.workbench.verdict import compare, fit
from rigctl.workbench.verdict.account import account_of, recalled
from rigctl.workbench.verdict.search import Search

TABLE = """\
format = 1
experiment = "table"
[table]
response = "temp_degf"
baseline = "b0"
[channels.temp_degf]
unit = "degF"
"""
SIGMA, MONTHS = 2.5, 120


@pytest.fixture(scope="module")
def seasons(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten years of monthly temperatures, as of Nottingham: a season of 12 degF, white noise, no order told."""
    noise = np.random.default_rng(11).normal(0.0, SIGMA, MONTHS)
    return recorded(tmp_path_factory.mktemp("seasons"), noise, TABLE)


@pytest.fixture(scope="module")
def slow_seasons(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with noise that relaxes in three months, along an order that is told, and a level that decays."""
    noise = np.random.default_rng(12).normal(0.0, SIGMA, MONTHS)
    for at in range(1, MONTHS):
        noise[at] += np.exp(-1.0 / 3.0) * noise[at - 1]
    table = TABLE.replace('"b0"', '"b0 * exp(-b1 * month)"\norder = "month"\nstart = { b0 = 50.0, b1 = 0.001 }')
    return recorded(tmp_path_factory.mktemp("slow-seasons"), noise, table)


def recorded(place: Path, noise: FloatArray, table: str) -> Path:
    month = np.arange(float(MONTHS))
    degf = 49.0 + 12.0 * np.cos(2.0 * np.pi * (month - 6.5) / 12.0) + noise
    bundle = place / "bundle"
    bundle.mkdir()
    (bundle / "recording.toml").write_text(table)
    rows = "\n".join(f"{value!r},{at!r}" for value, at in zip(degf.tolist(), month.tolist(), strict=True))
    (bundle / "readings.csv").write_text(f"temp_degf,month\n{rows}\n")
    store = place / "seasons.rig.sqlite"
    import_bundle(bundle, store).close()
    return store


@pytest.fixture(scope="module")
def told(seasons: Path) -> dict[str, Any]:
    """What the commands say one after the other, each with the store opened anew."""
    found: dict[str, Any] = {}
    with opened_workbench(seasons) as bench:
        found["compare"] = bench.compare().as_json()
    with opened_workbench(seasons) as bench:
        found["diagnose"] = bench.diagnose().as_json()
        found["add"] = bench.add(found["diagnose"]["suggested"])[-1].as_json()
    with opened_workbench(seasons) as bench:
        found["history"] = bench.history()
        found["fit"] = bench.fit().as_json()
        found["compare after"] = bench.compare().as_json()
    return found


def test_compare_fails_a_baseline_for_which_diagnose_finds_an_effect(told: dict[str, Any]) -> None:
    assert told["diagnose"]["suggested"] == ["periodic[month]"]
    assert told["compare"]["p_value"] < 1e-20
    assert told["compare after"]["p_value"] > 0.01


def test_the_noise_is_one_and_the_same_in_every_command(told: dict[str, Any]) -> None:
    first = told["compare"]["noise"]
    assert [(each["model"], each["source"], each["order"]) for each in first] == [("white", "scatter", None)]
    # Relative standard deviation of a sigma from nu degrees of freedom: 1 / sqrt(2 nu).
    assert first[0]["sigma"] == pytest.approx(SIGMA, rel=4.0 / np.sqrt(2.0 * first[0]["dof"]))
    others = [told["diagnose"], told["fit"], told["compare after"], *told["history"]]
    for other in others:
        assert other["noise"][0] == {**first[0], "sigma": pytest.approx(first[0]["sigma"], rel=1e-4)}


def test_the_ladder_falls_in_every_measure(told: dict[str, Any]) -> None:
    without, with_it = told["history"]
    for name in ("chi2_per_dof", "error_fit", "error_held_out", "minus_2_log_l"):
        assert with_it[name] < without[name]
    assert with_it["held_out_log_score"] > without["held_out_log_score"]
    assert without["rms"]["temp_degf"]["value"] == pytest.approx(np.sqrt(12.0**2 / 2.0 + SIGMA**2), rel=0.1)
    assert with_it["rms"]["temp_degf"] == {"value": pytest.approx(SIGMA, rel=0.2), "unit": "degF"}
    assert with_it["warnings"] == []
    # Of white noise, -2 log L is n log rss at its least, and a constant.
    rss = [MONTHS * rung["rms"]["temp_degf"]["value"] ** 2 for rung in told["history"]]
    fall = without["minus_2_log_l"] - with_it["minus_2_log_l"]
    assert fall == pytest.approx(MONTHS * np.log(rss[0] / rss[1]), rel=1e-6)


@pytest.mark.parametrize("store", ["seasons", "slow_seasons"])
def test_an_account_is_the_same_however_often_it_is_kept_and_recalled(
    store: str, request: pytest.FixtureRequest
) -> None:
    with opened_workbench(request.getfixturevalue(store)) as bench:
        made = account_of(bench.study, [()])
        kept = recalled(bench.study, made.as_document())
    assert kept.as_document() == made.as_document()
    np.testing.assert_array_equal(kept.richest.noise.sigma, made.richest.noise.sigma)
    for name in ("values", "covariance", "residuals", "jacobian"):
        np.testing.assert_array_equal(getattr(kept.richest.result, name), getattr(made.richest.result, name))


def test_what_a_comparison_found_is_asked_once(
    seasons: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Path(shutil.copy(seasons, tmp_path))
    with opened_workbench(store) as bench:
        first = bench.compare(bench.version(1))
    monkeypatch.setattr(compare, "adequacy", lambda *_: pytest.fail("asked again"))
    with opened_workbench(store) as bench:
        again = bench.compare(bench.version(1))
        assert again.as_json() == first.as_json()
        np.testing.assert_array_equal(again.residuals, first.residuals)
        # Another version tells the noise with it: the answer is another one.
        bench.add(["power2[month]"])
    with opened_workbench(store) as bench, pytest.raises(pytest.fail.Exception):
        bench.compare(bench.version(1))


def test_a_fit_is_as_adequate_as_its_comparison_found(
    seasons: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Path(shutil.copy(seasons, tmp_path))
    with opened_workbench(store) as bench:
        alone = bench.fitted(bench.version(1)).as_json()
        bench.compare(bench.version(1))
    monkeypatch.setattr(fit, "adequacy", lambda *_: pytest.fail("asked again"))
    with opened_workbench(store) as bench:
        assert bench.fitted(bench.version(1)).as_json() == alone
        bench.add(["power2[month]"])
    with opened_workbench(store) as bench, pytest.raises(pytest.fail.Exception):
        bench.fitted(bench.version(1))


def test_a_full_disk_keeps_nobody_from_a_comparison(
    seasons: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Path(shutil.copy(seasons, tmp_path))

    def full(*_: object) -> int:
        raise StorageError("no space left")

    for kept in ("kept_comparison", "kept_account"):
        monkeypatch.setattr(versions, kept, lambda *_: None)
    monkeypatch.setattr(Store, "add_document", full)
    with opened_workbench(store) as bench:
        assert np.isfinite(bench.compare(bench.version(1)).chi2)


def test_what_is_diagnosed_is_what_is_added(told: dict[str, Any]) -> None:
    joint, fit, ladder = told["diagnose"]["joint_fit"], told["fit"], told["history"]
    chi2 = [rung["chi2_per_dof"] * dof for rung, dof in zip(ladder, (MONTHS - 1, MONTHS - 4), strict=True)]
    assert chi2[0] - chi2[1] == pytest.approx(joint["chi2_fall"], rel=0.01)
    assert fit["minus_2_log_l"] == pytest.approx(joint["minus_2_log_l"], abs=1e-6)
    assert joint["held"] == []
    for name, each in joint["parameters"].items():
        assert fit["parameters"][name]["value"] == pytest.approx(each["value"], abs=0.1 * each["sigma"])


def test_a_version_is_told_with_the_place_where_its_fit_ends(
    told: dict[str, Any], seasons: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a period that was scanned for a diagnosis chose one on a grid, and fitted it."""
    fitted = told["fit"]["parameters"]["periodic[month].period"]
    (chosen,) = (each["choice"]["period"] for each in told["add"]["terms"])
    assert abs(chosen - fitted["value"]) > 1e-4
    assert told["add"]["places"]["periodic[month]"]["period"] == pytest.approx(fitted["value"], rel=1e-6)
    print_versions([told["add"]])
    assert f"(period {number(fitted['value'], 5)}," in capsys.readouterr().out
    with opened_workbench(seasons) as bench:
        assert bench.version(2).as_json() == told["add"]


def test_what_no_diagnosis_has_fitted_is_told_where_it_was_fitted_when_it_was_added(
    seasons: Path, tmp_path: Path
) -> None:
    store = Path(shutil.copy(seasons, tmp_path))
    with opened_workbench(store, readonly=False) as bench:
        added = bench.add(["periodic[month]#2"])[-1].as_json()
        values = bench.attempt(bench.current).values
    for effect, places in added["places"].items():
        assert places["period"] == pytest.approx(values[f"{effect}.period"], rel=1e-5)
    assert list(added["places"]) == ["periodic[month]", "periodic[month]#2"]
    assert versions.remove_all(Store.open(store), ["periodic[month]#2"])[0].places == {
        "periodic[month]": added["places"]["periodic[month]"]
    }


def test_what_a_search_would_add_to_a_version_is_asked_once(
    told: dict[str, Any], seasons: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes several fits; a fit and a comparison both want to know."""
    searched = []
    run_from = Search.run_from

    def noting(search: Search, richest: Any) -> None:
        searched.append(search.given)
        run_from(search, richest)

    monkeypatch.setattr(Search, "run_from", noting)
    with opened_workbench(seasons) as bench:
        first = bench.version(1)
        fitted, compared = bench.fitted(first), bench.compare(first)
    assert searched == [()]
    assert fitted.p_value == compared.p_value == pytest.approx(told["compare"]["p_value"], rel=1e-3)
