"""The Python front door does what the commands do."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rigctl
from rigctl import Campaign, results
from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.report.experiments.sensing_axis import tables

ROOT = Path(__file__).parents[1]
CAMPAIGNS = ROOT / "campaigns"


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """NIST's load cell, of which a line is not enough."""
    store = tmp_path_factory.mktemp("cell") / "cell.rig.sqlite"
    import_bundle(ROOT / "examples" / "pontius", store).close()
    return store


@pytest.fixture
def curved(cell: Path, tmp_path: Path) -> Path:
    """The same with the square that it lacks as a second version."""
    store = Path(shutil.copy(cell, tmp_path))
    Campaign.add(store, "power2[load_lb]")
    return store


def test_a_rig_is_opened_moved_and_left_safe() -> None:
    with rigctl.Rig.from_file(CAMPAIGNS / "isa-rig.toml") as rig:
        assert "<td>linear</td><td>aerotech-ensemble</td><td>sim:" in _shows(rig)
        rotation = rig.only("rotation")
        rotation.home()
        rotation.move_to(3.0)
        assert rotation.angle().value == pytest.approx(3.0, abs=1e-4)
    with pytest.raises(rigctl.RigError):
        rotation.angle()


def test_a_campaign_runs_and_its_store_gives_the_same_result_again(tmp_path: Path) -> None:
    campaign = rigctl.Campaign(CAMPAIGNS / "one-axis.toml")
    assert campaign.dry_run()["runs_planned"] > 0
    assert f"<td>{CAMPAIGNS / 'one-axis.toml'}</td>" in _shows(campaign)
    store = tmp_path / "one.rig.sqlite"
    result = campaign.run(store, unattended=True, seed=3)
    assert campaign.status(store)["state"] == "done"
    again = rigctl.Campaign.result(store)
    assert again.as_json() == result.as_json()
    shown = _shows(rigctl.Campaign.show(store))
    with rigctl.Store.open(store, readonly=True) as opened:
        pass
    assert str(store) in _shows(opened)
    assert "<table>" in shown
    assert "<figure>" in shown
    assert result.fit.result.verdict == "converged"
    found = results.of(store)
    assert "±σ: by the budget; U95: its expanded uncertainty, of the larger component" in _notes(found)
    # As `rigctl run` prints it.
    assert "±σ: by the budget, which `rigctl result` shows" in _notes({**found, "budget": {}})


def _notes(found: Mapping[str, Any]) -> list[str]:
    return [note for each in tables(found, {}) for note in each.notes]


def test_an_unknown_name_is_no_part_of_the_package() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        _ = rigctl.nonsense


def _shows(shown: object) -> str:
    """What a notebook shows of an object."""
    text = shown._repr_html_()  # type: ignore[attr-defined]
    assert isinstance(text, str)
    for tag in ("table", "figure", "p"):
        assert text.count(f"<{tag}>") + text.count(f"<{tag} ") == text.count(f"</{tag}>")
    return text


def test_a_comparison_shows_where_the_model_fails(cell: Path) -> None:
    shown = Campaign.compare(cell)
    text = _shows(shown)
    assert "The model does not describe the data: chi2/dof = " in text
    assert re.search(r"<td>deflection_in</td>.*FAILS", text)
    assert len(shown.plot().rows) == 40
    assert "against load" in text
    frame = shown.frame()
    assert frame.shape == (40, 5)
    # A line through a parabola: the ends are on one side, the middle on the other.
    by_load = frame.groupby("load_lb").residual_sigma.mean()
    assert by_load.iloc[0] < 0.0 < by_load.iloc[len(by_load) // 2]
    with pytest.raises(KeyError):
        shown.plot("temperature_c")


def test_a_diagnosis_shows_its_candidates(cell: Path) -> None:
    shown = Campaign.diagnose(cell)
    text = _shows(shown)
    assert "power2[load_lb]" in text
    assert text.count("<figure>") == 1
    assert shown.plot().svg.startswith("<svg")
    assert shown.frame().effect[0] == "power2[load_lb]"


def test_a_ladder_falls_in_table_figure_and_frame(curved: Path) -> None:
    ladder = Campaign.history(curved)
    frame = ladder.frame()
    assert frame.index.tolist() == [1, 2]
    assert frame.error_held_out.iloc[1] == pytest.approx(1.0, abs=0.1)
    assert frame.error_held_out.iloc[0] > 5.0
    text = _shows(ladder)
    assert "+ power2[load_lb]" in text
    assert text.count("<figure>") == 1
    assert [row.version for row in ladder.plot().rows] == [1, 2]


def test_names_are_taken_together_or_one_by_one_and_a_path_is_a_path_in_words_too(cell: Path, tmp_path: Path) -> None:
    names = [["power2[load_lb]"], "power3[load_lb]"]
    store = str(shutil.copy(cell, tmp_path))
    added = Campaign.add(store, *names)
    assert [version.terms[-1].effect for version in added] == ["power2[load_lb]", "power3[load_lb]"]
    with rigctl.Store.open(store, readonly=True) as opened:
        assert str(opened.path) == store
    assert [len(version.terms) for version in Campaign.remove(store, names[0])] == [1]


def test_a_fit_and_what_is_measured_are_tables(curved: Path) -> None:
    fit, measured = Campaign.fit(curved), Campaign.measured(curved)
    assert "<td>b1</td>" in _shows(fit)
    assert fit.frame().value["b1"] == fit.parameters["b1"].value
    assert "noise of deflection_in" in _shows(measured)
    frame = measured.frame()
    assert frame.U.to_numpy() == pytest.approx((frame.k * frame.u).to_numpy())
    assert np.array_equal(frame["u by noise of deflection_in"], frame.u)
    assert "what the term says" in _shows(Campaign.show(curved))
