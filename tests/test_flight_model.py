"""The shipped flight-model campaign against the paper's tables (Lucente et al. 2022)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl import Campaign, results
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.report.drawn import drawing_of
from rigctl.report.figures.data import write_plates

# A whole campaign and its budget before the first of them: a minute, on a computer that may be busy.
pytestmark = pytest.mark.timeout(600)

CAMPAIGNS = Path(__file__).parents[1] / "campaigns"

TABLE_1 = {
    "X": (9.9992e-1, 1.4503e-3, 1.2822e-2),
    "Y": (-6.7925e-3, 9.9997e-1, -1.9907e-3),
    "Z": (-1.2242e-2, 2.4100e-3, 9.9992e-1),
}
TABLE_2_OFFSETS_DEG = {"XY": 0.31, "XZ": 0.03, "YZ": 0.03}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flight") / "flight.rig.sqlite"
    Campaign(CAMPAIGNS / "isa-flight-model.toml").run(path, unattended=True)
    return path


@pytest.fixture(scope="module")
def result(store: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(results.of(store), allow_nan=False))
    return found


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_axes_are_those_of_table_1_within_their_scatter(result: dict[str, Any], axis: str) -> None:
    found = result["axes"][axis]
    truth = np.array(TABLE_1[axis]) / np.linalg.norm(TABLE_1[axis])
    error = np.array(found["coc"]) - truth
    dof = found["vectors"] - 2
    assert found["vectors"] == 20
    covariance = np.array(found["covariance"])
    assert covariance @ np.array(found["coc"]) == pytest.approx(np.zeros(3), abs=1e-20)
    distance = error @ np.linalg.pinv(covariance, rcond=1e-8, hermitian=True) @ error
    assert distance < 2.0 * stats.f(2, dof).ppf(0.9973)


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_vectors_scatter_as_the_paper_says(result: dict[str, Any], axis: str) -> None:
    assert 15.0 < result["axes"][axis]["std_hc_2sigma_arcsec"] < 40.0
    assert result["axes"][axis]["pass"] is True


@pytest.mark.parametrize("pair", ["XY", "XZ", "YZ"])
def test_angles_between_axes_are_those_of_table_2(result: dict[str, Any], pair: str) -> None:
    assert result["angles"][pair]["offset_deg"] == pytest.approx(TABLE_2_OFFSETS_DEG[pair], abs=0.01)


def test_the_budget_is_led_by_the_scatter_and_validated(result: dict[str, Any]) -> None:
    for axis in result["budget"].values():
        largest = max(axis["contributions"], key=lambda row: max(row["arcsec"]))
        assert largest["name"].startswith("scatter in")
        assert axis["monte_carlo"]["validated"] is True


def test_the_paper_s_figures_are_written(store: Path, tmp_path: Path) -> None:
    with Store.open(store) as opened:
        drawn = drawing_of("sensing-axis").draw(workbench_of(opened), (), ())
        written = {path.name for path in write_plates(drawn.plates, drawn.left_out, tmp_path)}
    for name in ("fig12", "fig15", "fig16", "fig17"):
        assert {f"{name}.svg", f"{name}.csv"} <= written
