"""A long table is asked by sums and sketches: what is found, and how sure it is, is what the columns say."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.analysis.column_sums import LARGE
from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.permuted import Permuted, is_heavy_tailed
from rigctl.workbench.verdict.significance import p_of_scored

ROWS = 500


def table(
    y: FloatArray, baseline: str = "b0 + b1 * x", order: str | None = None, **columns: FloatArray
) -> TableStudy:
    asked = {"response": "y", "baseline": baseline, "start": {}} | ({"order": order} if order else {})
    header = Header("table", extra={"table": asked})
    record = RunRecord(READINGS, READINGS, "import", {})
    return TableStudy(Recording(header, (record,), {READINGS: {"y": y, **columns}}, ImportReport(1)))


def readings(seed: int, rows: int = ROWS) -> tuple[FloatArray, dict[str, FloatArray]]:
    rng = np.random.default_rng(seed)
    columns = {
        "x": rng.uniform(0.0, 10.0, rows),
        "z": rng.normal(20.0, 3.0, rows),
        "w": rng.lognormal(0.0, 0.5, rows),
    }
    noise = 0.1 * rng.standard_normal(rows)
    hidden = 0.05 * np.sin(2.0 * np.pi * columns["z"] / 1.7) + 0.03 * (columns["w"] > 1.2)
    return 1.0 + 0.3 * columns["x"] + noise + hidden, columns


def test_more_readings_than_correlated_noise_is_worked_out_for_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """What each model needs of them does not fit into memory: it was the end of the computer's patience."""
    rng, rows = np.random.default_rng(3), 300
    walk = np.cumsum(rng.standard_normal(rows))
    columns = {"x": rng.uniform(0.0, 10.0, rows), "time_s": np.arange(rows, dtype=np.float64)}
    monkeypatch.setattr("rigctl.workbench.verdict.pool_order.MOST_CORRELATED", rows - 1)
    with pytest.raises(DataError, match=r"noise of 300 data is correlated along time_s.*299 at most: average"):
        Attempt(table(1.0 + 0.3 * columns["x"] + walk, order="time_s", **columns), ())
    # Independent ones need none of it.
    assert Attempt(table(1.0 + 0.3 * columns["x"] + rng.standard_normal(rows), **columns), ()).result.chi2 > 0.0


SLOW = 1500


def in_slow_noise(seed: int, walk: float) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Readings in white noise and a random walk of this step in its units, and their columns."""
    rng = np.random.default_rng(seed)
    columns = {"x": rng.uniform(0.0, 10.0, SLOW), "z": rng.normal(20.0, 3.0, SLOW)}
    noise = rng.standard_normal(SLOW) + np.cumsum(walk * rng.standard_normal(SLOW))
    return 1.0 + 0.3 * columns["x"] + 0.1 * noise, {**columns, "time_s": np.arange(SLOW, dtype=np.float64)}


def test_noise_that_is_slow_over_a_long_table_is_no_effect() -> None:
    """Of a stretch of it a walk is a level, and was named as up to four effects along the order.

    Walks go on without end, and draws of noise are tamer: of 60 tables like these three have an effect named.
    """
    named = []
    for seed in range(5):
        y, columns = in_slow_noise(seed, 0.05)
        found = diagnose(table(y, order="time_s", **columns), ())
        named += [seed] if found.verdict != "adequate" else []
        # What it may hide is said.
        assert {each.order for each in found.hidden_in_slow_noise} == {"time_s"}
    # Two of five would come once in fifty times.
    assert len(named) <= 1


def test_slow_noise_beside_batches_is_no_effect() -> None:
    """Taken for noise along the order of what is left without offsets, it was a slope in each batch."""
    y, columns = in_slow_noise(4, 0.05)
    lot = np.random.default_rng(4).integers(0, 30, 800)
    y = y[:800] + 0.2 * np.random.default_rng(5).standard_normal(30)[lot]
    asked = {"response": "y", "baseline": "b0 + b1 * x", "start": {}, "order": "time_s", "batch": ["lot"]}
    record = RunRecord(READINGS, READINGS, "import", {"lot": [f"L{number}" for number in lot]})
    samples = {"y": y, **{name: column[:800] for name, column in columns.items()}}
    header = Header("table", extra={"table": asked})
    found = diagnose(TableStudy(Recording(header, (record,), {READINGS: samples}, ImportReport(1))), ())
    assert (found.verdict, found.suggested) == ("adequate", ())
    assert found.noise[0].batches["lot"] > 0.1


def test_what_does_not_go_along_the_order_is_found_beside_slow_noise() -> None:
    y, columns = in_slow_noise(5, 0.05)
    y += 0.02 * (columns["z"] - 20.0) / 3.0
    found = diagnose(table(y, order="time_s", **columns), ())
    assert [term.effect for term in found.suggested] == ["linear[z]"]
    assert found.joint_fit is not None
    size = found.joint_fit.parameters["linear[z]"]
    assert abs(size.value - 0.02 / 3.0) < 4.0 * size.sigma


def test_a_break_that_no_slow_noise_makes_is_found_in_a_long_table() -> None:
    y, columns = in_slow_noise(6, 0.0)
    y += 0.2 * (columns["time_s"] > 640.0)
    found = diagnose(table(y, order="time_s", **columns), ())
    assert [term.effect for term in found.suggested] == ["step[time_s]"]
    assert found.joint_fit is not None
    assert found.joint_fit.parameters["step[time_s].at"].value == pytest.approx(640.5, abs=10.0)


def count_as_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigctl.experiments.table.spanned.LARGE", ROWS - 1)
    monkeypatch.setattr("rigctl.experiments.table.spanned._FEW", ROWS // 5)


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("terms", [(), (Term("periodic[z]", {"period": 1.7, "origin": 0.0}),)])
def test_scores_are_those_of_the_columns(seed: int, terms: tuple[Term, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    y, columns = readings(seed)
    plain = Attempt(table(y, **columns), terms)
    count_as_long(monkeypatch)
    assert_same_scores(plain, Attempt(table(y, **columns), terms))


def test_scores_in_correlated_noise_are_those_of_the_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums cannot be whitened: columns are made, whitened and sketched, and let go."""
    y, columns = readings(4)
    y += 0.1 * np.cumsum(0.1 * np.random.default_rng(9).standard_normal(ROWS))
    columns["time_s"] = np.arange(ROWS, dtype=np.float64)
    plain = Attempt(table(y, order="time_s", **columns), ())
    assert plain.noise.factors
    count_as_long(monkeypatch)
    summed = Attempt(table(y, order="time_s", **columns), ())
    assert_same_scores(plain, summed)
    assert_as_many_trials(plain, summed)


def assert_same_scores(plain: Attempt, summed: Attempt) -> None:
    of_plain = {each.candidate.term.effect: each for each in plain.scored}
    assert of_plain.keys() == {each.candidate.term.effect for each in summed.scored}
    for each in summed.scored:
        same = of_plain[each.candidate.term.effect]
        if each.candidate.term != same.candidate.term:
            # Of two choices that are as good to a part in ten thousand either may be first.
            assert each.score.statistic == pytest.approx(same.score.statistic, rel=1e-4)
            continue
        # What is far from significant is left as the sums over interpolated functions say.
        doubtful = each.score.p_value < 1e-3
        assert each.score.statistic == pytest.approx(same.score.statistic, rel=1e-9 if doubtful else 1e-6)
        assert each.score.p_value == pytest.approx(same.score.p_value, rel=1e-6)
        np.testing.assert_allclose(each.score.estimate, same.score.estimate, rtol=1e-6)
        np.testing.assert_allclose(each.score.sigma, same.score.sigma, rtol=1e-6)
        # The same span, whatever its basis.
        one, other = each.score.basis, same.score.basis
        assert one.shape == other.shape
        np.testing.assert_allclose(other @ (other.T @ one), one, atol=1e-7)


def test_trials_on_a_sketch_are_as_many(monkeypatch: pytest.MonkeyPatch) -> None:
    y, columns = readings(1)
    plain = Attempt(table(y, **columns), ())
    count_as_long(monkeypatch)
    assert_as_many_trials(plain, Attempt(table(y, **columns), ()))


def assert_as_many_trials(plain: Attempt, sketched: Attempt) -> None:
    counted = sketched.trials
    assert plain.trials.within.keys() == counted.within.keys()
    for family, count in plain.trials.within.items():
        # Each is known to 16 % from its draws, and so is the other: five standard deviations.
        assert np.log(counted.within[family] / count) == pytest.approx(0.0, abs=5 * 0.16 * np.sqrt(2.0)), family
    assert np.log(counted.all / plain.trials.all) == pytest.approx(0.0, abs=5 * 0.16 * np.sqrt(2.0))


def test_two_hidden_effects_are_found_in_a_long_table() -> None:
    y, columns = readings(2, LARGE + 1)
    found = diagnose(table(y, **columns), ())
    assert {term.effect for term in found.suggested} == {"periodic[z]", "step[w]"}
    assert found.verdict in {"effect", "ambiguous"}
    assert found.joint_fit is not None
    fitted = found.joint_fit.parameters
    for name, true in (("periodic[z].period", 1.7), ("step[w]", 0.03)):
        assert abs(fitted[name].value - true) < 4.0 * fitted[name].sigma
    assert fitted["step[w].at"].value == pytest.approx(1.2, abs=0.02)


def test_nothing_is_found_where_nothing_is_hidden() -> None:
    rng = np.random.default_rng(7)
    columns = {name: rng.uniform(0.0, 1.0, LARGE + 1) for name in "xzw"}
    found = diagnose(table(1.0 + columns["x"] + rng.standard_normal(LARGE + 1), **columns), ())
    assert (found.verdict, found.suggested) == ("adequate", ())


def test_long_columns_are_heavy_tailed_where_it_matters() -> None:
    rng = np.random.default_rng(3)
    assert is_heavy_tailed(rng.standard_t(4, 20_000))
    # Seen by the test, but of no weight: an excess of 0.1.
    assert not is_heavy_tailed(rng.standard_t(64, 100_000))


def test_permutations_of_long_columns_are_those_of_short_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    left = np.random.default_rng(4).standard_t(3, 300)
    frame = np.linalg.qr(np.random.default_rng(5).standard_normal((300, 3)))[0]
    kept = Permuted(left, 0).p_of_share(frame, frame[:, :1])
    monkeypatch.setattr("rigctl.workbench.verdict.permuted.LARGE", 299)
    monkeypatch.setattr("rigctl.workbench.verdict.permuted._AT_ONCE", 300 * 64)
    assert Permuted(left, 0).p_of_share(frame, frame[:, :1]) == kept


def test_every_piece_of_permutations_is_asked_about_scans(monkeypatch: pytest.MonkeyPatch) -> None:
    y, columns = readings(3)
    y += 0.2 * np.cos(columns["z"] / 0.3) + 0.15 * np.random.default_rng(6).standard_t(2.5, ROWS)
    whole = _p_of_period(table(y, **columns))
    monkeypatch.setattr("rigctl.workbench.verdict.permuted.LARGE", ROWS - 1)
    monkeypatch.setattr("rigctl.workbench.verdict.permuted._AT_ONCE", ROWS * 300)
    # The same orders, in seven pieces; single precision of products tells the rest.
    assert _p_of_period(table(y, **columns)) == pytest.approx(whole, rel=1e-2)


def _p_of_period(study: TableStudy) -> float:
    attempt = Attempt(study, ())
    scored = attempt.scored_effect("periodic[z]")
    assert scored is not None
    p_value = p_of_scored(attempt, scored)
    assert p_value > scored.score.p_value
    return p_value


def test_readings_that_follow_a_curve_to_the_last_digit_have_the_noise_of_rounding() -> None:
    """A square exactly: what it leaves is zero, and a sigma of zero would overflow every test."""
    x = np.arange(20.0)
    found = diagnose(table(x**2 + 3.0 * x + 2.0, x=x), ())
    assert (found.verdict, [term.effect for term in found.suggested]) == ("effect", ["power2[x]"])
    assert found.joint_fit is not None
    assert abs(found.joint_fit.parameters["power2[x]"].value - 1.0) < 1e-12
