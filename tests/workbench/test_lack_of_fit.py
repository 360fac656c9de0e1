"""Readings taken again at one setting tell the pure error, and a model's lack of fit against it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import opened_workbench
from rigctl.core.arrays import FloatArray
from rigctl.workbench.findings import Comparison, Diagnosis

EXAMPLES = Path(__file__).parents[2] / "examples"
LEVELS, REPEATS = 20, 3


def _asked(bundle: Path, store: Path, added: tuple[str, ...] = ()) -> tuple[Comparison, Diagnosis]:
    import_bundle(bundle, store).close()
    with opened_workbench(store) as bench:
        bench.add(added)
        return bench.compare(), bench.diagnose()


def _table(place: Path, columns: dict[str, FloatArray]) -> Path:
    place.mkdir()
    (place / "recording.toml").write_text(
        'format = 1\nexperiment = "table"\n[table]\nresponse = "out_v"\nbaseline = "b0 + b1 * force_n"\n'
    )
    rows = np.column_stack(list(columns.values()))
    np.savetxt(place / "readings.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
    return place


@pytest.mark.parametrize(("added", "f", "dof"), [((), 214.7469, 18), (("power2[load_lb]",), 0.8107, 17)])
def test_the_load_cell_of_nist_lacks_a_square_and_nothing_else(
    tmp_path: Path, added: tuple[str, ...], f: float, dof: int
) -> None:
    """Two readings at each of twenty loads; NIST fits a parabola to them (Pontius, StRD)."""
    compared, _ = _asked(EXAMPLES / "pontius", tmp_path / "pontius.rig.sqlite", added)
    lack = compared.lack_of_fit
    assert lack is not None
    assert (lack.dof, lack.pure_dof) == (dof, 20)
    assert lack.f == pytest.approx(f, rel=1e-4)
    assert lack.p_value == pytest.approx(stats.f.sf(f, dof, 20), rel=1e-2)


def test_what_differs_between_settings_and_follows_no_column_is_said_to_be_unknown(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    force = np.repeat(np.linspace(0.0, 11.0, LEVELS), REPEATS)
    # A dead weight that is wrong by itself: every reading of one setting shares it.
    wrong = np.repeat(rng.normal(0.0, 0.1, LEVELS), REPEATS)
    table = _table(
        tmp_path / "weights", {"out_v": 0.2 * force + wrong + rng.normal(0.0, 0.1, force.size), "force_n": force}
    )
    compared, found = _asked(table, tmp_path / "weights.rig.sqlite")
    assert compared.lack_of_fit is not None
    assert compared.lack_of_fit.pure_error == pytest.approx(0.1, rel=4.0 / np.sqrt(2.0 * LEVELS * (REPEATS - 1)))
    assert compared.p_value < 0.01
    assert found.verdict == "unknown"
    assert found.unexplained is not None
    assert "from setting to setting" in found.unexplained.description


def test_weights_that_are_all_wrong_end_in_a_verdict(tmp_path: Path) -> None:
    """Scanned terms imitate wrong weights one by one, until the last of them are not determined together."""
    rng = np.random.default_rng(5)
    force = np.repeat(np.linspace(0.0, 11.0, LEVELS), REPEATS)
    wrong = np.repeat(rng.normal(0.0, 1.0, LEVELS), REPEATS)
    table = _table(
        tmp_path / "all-wrong", {"out_v": 0.2 * force + wrong + rng.normal(0.0, 0.1, force.size), "force_n": force}
    )
    compared, found = _asked(table, tmp_path / "all-wrong.rig.sqlite")
    assert compared.p_value < 0.01
    assert found.verdict != "adequate"


def test_repeats_of_a_model_that_is_right_lack_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    force = np.repeat(np.linspace(0.0, 11.0, LEVELS), REPEATS)
    table = _table(tmp_path / "right", {"out_v": 0.2 * force + rng.normal(0.0, 0.1, force.size), "force_n": force})
    compared, found = _asked(table, tmp_path / "right.rig.sqlite")
    assert compared.lack_of_fit is not None
    assert compared.lack_of_fit.p_value > 0.01
    assert found.verdict == "adequate"


def test_readings_of_which_none_was_taken_again_are_not_asked(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    force = rng.uniform(0.0, 11.0, 30)
    compared, _ = _asked(
        _table(tmp_path / "once", {"out_v": 0.2 * force + rng.normal(0.0, 0.1, 30), "force_n": force}),
        tmp_path / "once.rig.sqlite",
    )
    assert compared.lack_of_fit is None
    assert compared.as_json()["lack_of_fit"] is None
