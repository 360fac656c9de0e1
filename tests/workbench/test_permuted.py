"""Where residuals have heavy tails, permutations say what chance shows: wild readings are no effect, effects stay."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal, stats

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.permuted import PERMUTATIONS, Permuted, Tail, is_heavy_tailed, p_of_kurtosis

ROWS = 120


def table(y: FloatArray, **columns: FloatArray) -> TableStudy:
    header = Header("table", extra={"table": {"response": "y", "baseline": "b0", "start": {}}})
    record = RunRecord(READINGS, READINGS, "import", {})
    return TableStudy(Recording(header, (record,), {READINGS: {"y": y, **columns}}, ImportReport(1)))


def columns(seed: int) -> dict[str, FloatArray]:
    rng = np.random.default_rng(seed)
    return {"x": rng.uniform(0.0, 10.0, ROWS), "s": rng.lognormal(0.0, 0.8, ROWS), "z": rng.normal(20.0, 1.0, ROWS)}


def test_wild_readings_have_heavy_tails_and_normal_noise_seldom() -> None:
    rng = np.random.default_rng(1)
    assert all(is_heavy_tailed(rng.standard_t(3, 500)) for _ in range(10))
    of_normal = sum(is_heavy_tailed(rng.standard_normal(500)) for _ in range(400))
    # At a level of 5 % of a test that is asymptotic: more than 33 of 400 in one case of a thousand.
    assert of_normal <= 33
    assert not is_heavy_tailed(np.zeros(50))
    assert not is_heavy_tailed(rng.standard_t(3, 10))


@pytest.mark.parametrize("rows", [20, 51, 400])
def test_the_test_of_kurtosis_is_that_of_scipy(rows: int) -> None:
    rng = np.random.default_rng(rows)
    for left in (rng.standard_normal(rows), rng.standard_t(3, rows), rng.uniform(size=rows)):
        p_value = stats.kurtosistest(left, alternative="greater").pvalue
        assert p_of_kurtosis(rows, stats.kurtosis(left, fisher=False)) == pytest.approx(p_value, rel=1e-9, abs=1e-15)


def test_the_tail_of_normal_noise_is_its_p_value_itself() -> None:
    tail = Tail(np.sort(np.random.default_rng(2).uniform(size=PERMUTATIONS)))
    for p_value in (0.5, 0.1, 0.04):
        # Three times the binomial error.
        error = 3.0 * np.sqrt(p_value * (1.0 - p_value) / PERMUTATIONS)
        assert tail.probability(p_value) == pytest.approx(p_value, abs=error)
    # Beyond, the power is known to one part in the root of fifty, and the logarithm of the ratio goes with it.
    assert np.log(tail.probability(1e-5)) == pytest.approx(np.log(1e-5), abs=3.0 * np.log(0.025 / 1e-5) / 50**0.5)


def test_the_tail_of_wild_readings_is_much_wider() -> None:
    rng = np.random.default_rng(3)
    tail = Tail(np.sort(rng.uniform(size=PERMUTATIONS) ** 5.0))
    assert tail.probability(1e-5) == pytest.approx(0.1, rel=0.2)
    assert tail.probability(1e-12) == pytest.approx(1e-12**0.2, rel=0.5)


def test_what_exchangeable_residuals_do_along_a_frame_is_as_probable_as_its_rank() -> None:
    rng = np.random.default_rng(4)
    frame, _ = np.linalg.qr(rng.standard_normal((60, 8)))
    found = []
    for seed in range(60):
        left = rng.standard_t(3, 60)
        left -= frame[:, :1] @ (frame[:, :1].T @ left)
        found.append(Permuted(left, seed).p_of_share(frame, frame[:, :1]))
    # A uniform mean, three standard errors.
    assert np.mean(found) == pytest.approx(0.5, abs=3.0 / np.sqrt(12.0 * 60.0))
    assert min(found) >= 1.0 / (1.0 + PERMUTATIONS)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_wild_reading_at_the_end_of_a_column_is_no_effect(seed: int) -> None:
    given = columns(seed)
    noise = np.random.default_rng([seed, 1]).standard_normal(ROWS)
    noise[[5, 40, 77]] += (9.0, -8.0, 11.0)
    largest = int(np.argmax(given["s"]))
    noise[[5, largest]] = noise[[largest, 5]]
    study = table(noise, **given)
    account = account_of(study, [()])
    search = account.search(study, ())
    assert not search.suggested
    assert search.unexplained is None


def test_an_effect_beside_wild_readings_is_named_all_the_same() -> None:
    given = columns(3)
    noise = np.random.default_rng(7).standard_t(3, ROWS)
    away = given["z"] - given["z"].mean()
    study = table(10.0 * noise.std() * away / np.linalg.norm(away) + noise, **given)
    assert Attempt(study, ()).permuted is not None
    found = diagnose(study, ())
    assert found.verdict in {"effect", "ambiguous"}
    assert {term.effect.split("[")[1] for term in found.suggested} == {"z]"}


def in_order(y: FloatArray, **columns: FloatArray) -> TableStudy:
    header = Header("table", extra={"table": {"response": "y", "baseline": "b0", "start": {}, "order": "t"}})
    record = RunRecord(READINGS, READINGS, "import", {})
    made = {"y": y, "t": np.arange(float(len(y))), **columns}
    return TableStudy(Recording(header, (record,), {READINGS: made}, ImportReport(1)))


def test_noise_that_is_correlated_along_an_order_is_not_permuted() -> None:
    drawn = np.random.default_rng(8).standard_t(3, ROWS)
    assert Attempt(in_order(signal.lfilter([1.0], [1.0, -0.9], drawn)), ()).permuted is None
    assert Attempt(in_order(drawn), ()).permuted is not None


def test_a_wild_reading_of_a_table_in_order_is_no_effect() -> None:
    given = columns(3)
    noise = np.random.default_rng([3, 1]).standard_normal(ROWS)
    noise[[5, 40, 77]] += (9.0, -8.0, 11.0)
    largest = int(np.argmax(given["s"]))
    noise[[5, largest]] = noise[[largest, 5]]
    account = account_of(study := in_order(noise, **given), [()])
    assert not account.search(study, ()).suggested
    found = diagnose(study, (), account=account)
    # What is listed was judged in the same way: nothing that was left out reads as significant.
    assert min(rank.p_value_corrected for rank in found.ranking) > found.alpha
