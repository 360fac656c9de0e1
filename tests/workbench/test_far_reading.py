"""A single reading far from all others is named, whichever it is, and no more."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.report.verdicts import scatter_sentences
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.compare import compared
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.far_reading import FAR, far_reading

ROWS, SIGMA_V = 17, 0.1


def study(noise: FloatArray, row: int = 11, sigmas: float = 0.0, lots: int = 0) -> TableStudy:
    """Readings about a line, one of them so far off, in so many lots with large offsets of their own."""
    load_n = np.linspace(0.0, 10.0, len(noise))
    y_v = 1.0 + 0.3 * load_n + SIGMA_V * noise
    y_v[row] += sigmas * SIGMA_V
    lot = np.arange(len(noise)) % max(lots, 1)
    y_v += 10.0 * np.random.default_rng(9).standard_normal(max(lots, 1))[lot] * bool(lots)
    texts = {"lot": [f"lot {each}" for each in lot]} if lots else {}
    header = Header("table", extra={"table": {"response": "y_v", "baseline": "b0 + b1 * load_n", "start": {}}})
    columns = {READINGS: {"y_v": y_v, "load_n": load_n}}
    return TableStudy(Recording(header, (RunRecord(READINGS, READINGS, "import", texts),), columns, ImportReport(1)))


def drawn(seed: int, tails: str = "normal") -> FloatArray:
    random = np.random.default_rng([seed, 7])
    return random.standard_t(4, ROWS) if tails == "t4" else random.standard_normal(ROWS)


@pytest.mark.parametrize("row", [0, 11])
@pytest.mark.parametrize("sigmas", [-12.0, 12.0])
def test_it_is_named_with_what_all_others_say(row: int, sigmas: float) -> None:
    """At the end, where it draws the line to itself, as in the middle."""
    found = far_reading(Attempt(study(drawn(1), row, sigmas), ()))
    without = np.delete(np.arange(ROWS), row)
    load_n, y_v = np.linspace(0.0, 10.0, ROWS), study(drawn(1), row, sigmas).observations.value
    fit = np.polynomial.Polynomial.fit(load_n[without], y_v[without], 1)
    scatter = np.sqrt(np.sum((y_v[without] - fit(load_n[without])) ** 2) / (ROWS - 3))
    assert found is not None
    assert found.run_id == f"row {row + 1}"
    assert found.scatter == pytest.approx(scatter, rel=1e-6)
    # Off by its own scatter and that of the line there.
    design = np.vander(load_n[without], 2)
    of_line = np.array([load_n[row], 1.0]) @ np.linalg.solve(design.T @ design, [load_n[row], 1.0])
    assert found.sigmas == pytest.approx(
        abs(y_v[row] - fit(load_n[row])) / scatter / np.sqrt(1.0 + of_line), rel=1e-6
    )
    assert found.sigmas > FAR * found.following


@pytest.mark.parametrize("tails", ["normal", "t4"])
def test_none_is_named_where_none_is_far(tails: str) -> None:
    """At a nominal 1 %; 5 of 40 are one in a thousand at 2 %."""
    assert sum(far_reading(Attempt(study(drawn(seed, tails)), ())) is not None for seed in range(40)) < 5


def test_in_a_lot_it_is_off_by_what_is_a_readings_own() -> None:
    noise = np.random.default_rng(3).standard_normal(80)
    found = far_reading(Attempt(study(noise, sigmas=20.0, lots=8), ()))
    assert found is not None
    assert found.run_id == "row 12"
    # Lots are a hundred times as far apart; what they share is told with the reading in.
    assert found.scatter == pytest.approx(SIGMA_V, rel=0.5)


def test_nor_where_another_is_nearly_as_far() -> None:
    noise = np.random.default_rng(3).standard_normal(80)
    assert far_reading(Attempt(study(noise, sigmas=12.0), ())) is not None
    noise[40] += 9.0
    assert far_reading(Attempt(study(noise, sigmas=12.0), ())) is None


def test_nor_where_the_others_have_no_scatter_but_rounding() -> None:
    exact = study(np.zeros(ROWS), sigmas=1e-13)
    assert far_reading(Attempt(exact, ())) is None


def test_compare_and_diagnose_say_it() -> None:
    """Of seventeen one is 10 sigma off: the noise is told with it, and hides it from every test."""
    account = account_of(study(drawn(2), sigmas=10.0), [()])
    asked = account.richest.study
    found = diagnose(asked, (), account=account)
    for said in (compared(account.attempt(asked, ()), account, 1).as_json(), found.as_json()):
        (sentence,) = scatter_sentences(said)
        assert sentence.startswith("row 12 is far from all others: off by ")
        assert "Look at it: marked invalid it counts nowhere" in sentence
