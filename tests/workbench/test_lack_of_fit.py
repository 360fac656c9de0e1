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
from rigctl.workbench.verdict.lack_of_fit import _Test

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
    by_f_alone = stats.f.sf(f, dof, 20)
    assert 0.99 * by_f_alone < lack.p_value < max(1.01 * by_f_alone, 1e-6)


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


def test_scatter_that_differs_from_setting_to_setting_is_no_lack_of_fit() -> None:
    """Noise ten times larger at one end: by F alone one in thirty would be below one in a hundred."""
    rng = np.random.default_rng(2)
    force = np.repeat(np.linspace(0.0, 1.0, LEVELS), REPEATS)
    basis = np.linalg.qr(np.column_stack([np.ones(force.size), force]))[0]
    test = _Test(np.repeat(np.arange(LEVELS), REPEATS), np.ones(force.size), basis)
    tables = 3000
    volts = rng.normal(size=(tables, force.size)) * (0.2 + 2.0 * force)
    left = volts - (volts @ basis) @ basis.T
    by_f_alone = test.p_of(test.of(left)[0])
    small = np.flatnonzero(by_f_alone < 0.01)
    below = sum(test.p_of_signs(left[table], float(by_f_alone[table]), int(table)) < 0.01 for table in small)
    # Of a true rate of 1 %, one in ten thousand draws of so many tables has more than these.
    most = stats.binom.isf(1e-4, tables, 0.01)
    assert below <= most < len(small)
