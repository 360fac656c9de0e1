"""What is told of the noise is what data are whitened with."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.experiments.table.study import TableStudy
from rigctl.report.verdicts import noise_sentence
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.noise_entries import noise_entries


def attempt(order: str | None, lots: tuple[str, ...] = ()) -> Attempt:
    """Sixty readings, of which each has a little of the one before, and those of one of many lots an offset."""
    x, noise = np.arange(60.0), np.random.default_rng([4, 60]).standard_normal(60)
    for at in range(1, 60):
        noise[at] += 0.3 * noise[at - 1]
    table = {"response": "y_v", "baseline": "b0", "start": {}} | ({"order": order} if order else {})
    columns = {
        READINGS: {"y_v": noise + np.repeat(np.arange(len(lots) or 1) % 5.0, 60 // (len(lots) or 1)), "x_s": x}
    }
    texts = {"lot": list(np.repeat(lots, 60 // len(lots)))} if lots else {}
    record = RunRecord(READINGS, READINGS, "import", texts)
    return Attempt(
        TableStudy(Recording(Header("table", extra={"table": table}), (record,), columns, ImportReport(1))), ()
    )


def test_what_may_be_correlated_is_told_where_white_is_the_likeliest() -> None:
    """Its variance is that of a mean of laws: "white, 2.5 V" stood beside residuals of 1 V."""
    made = attempt("x_s")
    (entry,) = noise_entries(made)
    assert entry.model == "white"
    assert entry.correlated_share > 0.5
    white = entry.sigma * np.sqrt(1.0 - entry.correlated_share)
    assert white == pytest.approx(np.sqrt(np.mean(made.noise.sigma**2)), rel=1e-4)
    said = noise_sentence({"noise": [entry.as_json()]})
    assert (
        f"white, or correlated along x_s ({100.0 * entry.correlated_share:.2g} % of the variance, by the odds" in said
    )


def test_of_readings_in_no_order_the_noise_is_white_and_no_more_is_said() -> None:
    (entry,) = noise_entries(attempt(None))
    assert entry.correlated_share == 0.0
    assert noise_sentence({"noise": [entry.as_json()]}).startswith(f"Noise: y_v white, {entry.sigma:.3g} V from ")


def test_beside_offsets_no_variance_is_more_by_what_may_be_slow() -> None:
    (entry,) = noise_entries(attempt("x_s", tuple("abcdefghijkl")))
    assert list(entry.batches) == ["lot"]
    assert (entry.model, entry.correlated_share) == ("white", 0.0)


@pytest.mark.parametrize(("share", "said"), [(0.24, False), (0.26, True)])
def test_less_than_the_variance_is_uncertain_by_is_not_said(share: float, said: bool) -> None:
    """By 25 %, from 32 degrees of freedom."""
    (entry,) = noise_entries(attempt("x_s"))
    told = noise_sentence({"noise": [{**entry.as_json(), "correlated_share": share, "dof": 32.0}]})
    assert (", or correlated along x_s" in told) is said
