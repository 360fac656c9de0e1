"""The whole way: campaigns measured, killed and gone on with, diagnosed, extended and reported, by commands alone."""

from __future__ import annotations

import asyncio
import os
import signal
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl import runner
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.console.app import Console

HERE = Path(__file__).parent.parent
CLEAN = ("first_urad = [9.0, -6.0]", "")


def truth(name: str) -> dict[str, float]:
    """What the world of a rig file has for the coefficients, in the units of results."""
    found = {}
    for sensor, each in tomllib.loads((HERE / f"{name}.rig.toml").read_text())["world"]["sensors"].items():
        x, y, z = each["turned_urad"]
        turned = dict(zip("xyz", (x, y, z), strict=True))
        after, then = ("xyz"[("xyz".index(sensor) + step) % 3] for step in (1, 2))
        bends = each["bends_ug"]
        names = {"K2": bends["k2"], "K3": bends["k3"], "K_ip": bends["k_ip"], "K_io": bends["k_io"]}
        names |= {"K1": each["scale_v_per_g"], "K0": 1e3 * each["bias_mg"]}
        names |= {"delta_p": turned[after], "delta_o": turned[then]}
        found |= {f"{coefficient}[{sensor}]": size for coefficient, size in names.items()}
    return found


def test_coefficients_are_those_of_the_world_within_their_sigmas(begin: Any) -> None:
    true = truth("three-axis")
    found = workbench_of(Store.open(begin("three-axis")())).fit().as_json()["result"]
    assert set(found) == set(true)
    pulls = [(each["value"] - true[name]) / each["sigma"] for name, each in found.items()]
    assert np.abs(pulls).max() < 4.5
    # Of so many, 99 of 100 scatters lie within.
    least, most = np.sqrt(stats.chi2(len(pulls)).ppf([0.005, 0.995]) / len(pulls))
    assert least < float(np.sqrt(np.mean(np.square(pulls)))) < most


def test_in_a_clean_world_no_effect_is_found(begin: Any) -> None:
    clean = workbench_of(Store.open(begin("one-axis", CLEAN, seed=101)())).diagnose()
    assert (clean.verdict, clean.as_json()["suggested"]) == ("adequate", [])


def contents(store: Path) -> list[Any]:
    """Everything measured."""
    with Store.open(store, readonly=True) as opened:
        return [
            (run.key, run.conditions, {name: column.tolist() for name, column in opened.samples(run.run_id).items()})
            for run in opened.runs()
        ]


@pytest.mark.parametrize("killed_in", [1, 20])
def test_a_killed_campaign_gone_on_with_is_the_undisturbed_one(begin: Any, tmp_path: Path, killed_in: int) -> None:
    few = ("positions = 12", "positions = 6")
    undisturbed = contents(begin("one-axis", few)())
    (tmp_path / "one-axis-1.rig.sqlite").unlink()
    start, store = begin("one-axis", few), tmp_path / "one-axis-1.rig.sqlite"
    if not (child := os.fork()):
        finish, ended = RunWriter.finish, iter(range(killed_in))

        def finished(writer: RunWriter, *arguments: Any, **named: Any) -> Any:
            if next(ended, None) is None:
                os.kill(os.getpid(), signal.SIGKILL)
            return finish(writer, *arguments, **named)

        RunWriter.finish = finished  # type: ignore[method-assign]
        try:
            start()
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert len(contents(store)) == killed_in
    runner.resume(store, runner.Options(unattended=True))
    assert contents(store) == undisturbed


def test_what_one_mounting_cannot_tell_another_can(begin: Any, rigctl: Callable[..., Any], tmp_path: Path) -> None:
    store = begin("one-axis", ('[[procedure.mountings]]\nout = "+z"\nclocking_deg = 180.0\n', ""))()
    assert rigctl("compare", store)["p_value"] > 0.001
    assert "head-eccentricity" in {each["effect"] for each in rigctl("diagnose", store)["inseparable"]}
    asked = rigctl("next", store, "--write", tmp_path / "next.toml")
    assert asked["purpose"] == "reveal"
    rigctl("run", tmp_path / "next.toml", "--store", store, "--yes")
    with Store.open(store, readonly=True) as opened:
        seats = [(run.conditions["mounting"], run.conditions["out"]) for run in opened.runs()]
    assert len(seats) == 24 + len(asked["runs"])
    assert {number for number, _ in seats} == {1, 2}


def test_diagnose_add_fit_ladder_next_and_report(begin: Any, rigctl: Callable[..., Any], tmp_path: Path) -> None:
    store = begin("one-axis")()
    assert rigctl("compare", store)["p_value"] < 1e-6
    hidden = rigctl("diagnose", store)
    assert (hidden["verdict"], hidden["suggested"]) == ("effect", ["head-eccentricity"])
    rigctl("model", "add", store, "head-eccentricity")
    fitted = rigctl("fit", store)["parameters"]
    for name, size in (("c1", 9e-6), ("s1", -6e-6)):
        assert abs(fitted[name]["value"] - size) < 4.0 * fitted[name]["sigma"] < 5e-6
    first, second = rigctl("model", "history", store)
    assert second["error_held_out"] < 0.5 * first["error_held_out"]
    assert rigctl("next", store)["purpose"] in {"reveal", "tighten"}
    rigctl("report", store, "--out", tmp_path / "report.html", "--figures", tmp_path / "figures")
    assert "tumble_nonlinearity" in (tmp_path / "figures" / "figures.md").read_text()
    assert "ug/g2" in (tmp_path / "report.html").read_text()


def test_a_bundle_comes_back_as_it_went(begin: Any, rigctl: Callable[..., Any], tmp_path: Path) -> None:
    store = begin("one-axis")()
    rigctl("export", store, tmp_path / "bundle")
    rigctl("import", tmp_path / "bundle", "--store", tmp_path / "again.rig.sqlite")
    here, there = (rigctl("result", each)["result"] for each in (store, tmp_path / "again.rig.sqlite"))
    assert {name: each["value"] for name, each in here.items()} == pytest.approx(
        {name: each["value"] for name, each in there.items()}, rel=1e-6
    )


def test_the_console_opens_on_its_store(begin: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    store = begin("one-axis")()

    async def sit() -> None:
        app = Console(store)
        async with app.run_test(size=(100, 30)) as pilot:

            def text() -> str:
                strips = app.screen._compositor.render_strips()
                return "\n".join("".join(segment.text for segment in strip) for strip in strips)

            async def sees(words: str) -> None:
                for _ in range(1200):
                    if words in text():
                        return
                    await pilot.pause(0.05)
                raise AssertionError(text())

            await pilot.press("3", "u")
            await sees("K_ip")
            await pilot.press("4", "f")
            await sees("K_ip[x]")

    asyncio.run(sit())
