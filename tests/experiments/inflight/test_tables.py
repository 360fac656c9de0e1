"""The study's tables: the paper's rows multiplied out, and our errors as it counts them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigctl.core.errors import DataError
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.result.monte_carlo import Draw, budget, tables
from rigctl.experiments.inflight.result.published import published


def test_table_3_is_table_2_times_the_drivers():
    rows = published().rows.values()
    for row in rows:
        assert row.worst * row.per_unit_m_s2 == pytest.approx(row.row_worst_m_s2, rel=0.08)
        assert row.mean * row.per_unit_m_s2 == pytest.approx(row.row_mean_m_s2, rel=0.08)
    assert sum(row.row_worst_m_s2 for row in rows) == pytest.approx(1.10e-15, rel=0.01)
    assert sum(row.row_mean_m_s2 for row in rows) == pytest.approx(3.59e-16, rel=0.01)
    assert sum(row.before_m_s2 for row in rows) == pytest.approx(published().before_m_s2, rel=0.02)
    assert sum(row.bound * row.per_unit_m_s2 for row in rows) == pytest.approx(2e-13, rel=0.1)


def drawn(number, paper, joint):
    errors = {"paper": paper, "joint": joint}
    row = published().rows
    return Draw(
        number,
        {which: {name: factor * row[name].objective for name in NAMES} for which, factor in errors.items()},
        {which: {name: 0.1 * row[name].objective for name in NAMES} for which in errors},
        {
            "exact_truth": dict.fromkeys(NAMES, 0.0),
            "paper_truth": {name: 0.5 * row[name].objective for name in NAMES},
        },
    )


def test_errors_are_counted_by_estimate_and_truth():
    found = tables([Draw.from_json(drawn(i, paper, 0.25).as_json()) for i, paper in enumerate((1.0, -2.0, 0.0, 0.4))])
    assert found["draws"] == 4
    row, objective = found["table2"]["k2d_s2_m"], published().rows["k2d_s2_m"].objective
    against_paper = np.array([0.5, 2.5, 0.5, 0.1])
    assert row["paper"]["paper_truth"]["worst"] == pytest.approx(2.5 * objective)
    assert row["paper"]["paper_truth"]["mean"] == pytest.approx(against_paper.mean() * objective)
    assert row["paper"]["paper_truth"]["std"] == pytest.approx(against_paper.std() * objective)
    assert row["paper"]["exact_truth"]["worst"] == pytest.approx(2.0 * objective)
    assert row["joint"]["exact_truth"]["mean"] == pytest.approx(0.25 * objective)
    assert row["paper"]["analytic_sigma"] == pytest.approx(0.1 * objective)
    assert row["over_objective"] == 0.25
    assert row["reference"] == {"worst": 124.0, "mean": 25.0, "std": 23.0}
    assert found["table3"]["rows"]["k2d_s2_m"]["worst_m_s2"] == pytest.approx(2.5 * objective * 2 * 2.86e-20)
    mean = against_paper.mean() * objective * 2 * 2.86e-20
    assert found["table3"]["rows"]["k2d_s2_m"]["mean_m_s2"] == pytest.approx(mean)
    means = [each["mean_m_s2"] for each in found["table3"]["rows"].values()]
    assert found["table3"]["total_mean_m_s2"] == pytest.approx(sum(means))
    totals = [each["worst_m_s2"] for each in found["table3"]["rows"].values()]
    assert found["table3"]["total_worst_m_s2"] == pytest.approx(sum(totals))


def test_pulls_of_a_study_are_by_the_covariance_of_each_draw():
    rng = np.random.default_rng(3)
    objectives = np.array([published().rows[name].objective for name in NAMES])
    mixing = 0.3 * rng.standard_normal((10, 10)) + np.eye(10)
    covariance = np.outer(objectives, objectives) * (mixing @ mixing.T)
    draws = []
    for number in range(400):
        truth = dict(zip(NAMES, objectives * (mixing @ rng.standard_normal(10)), strict=True))
        one = drawn(number, 0.0, 0.0)
        draws.append(replace(one, truths={**one.truths, "exact_truth": truth}, covariance=covariance.tolist()))
    straight = {"tracker_bias_rad": 0.0, "coupling_rad": 0.0}
    found = tables([Draw.from_json(draw.as_json()) for draw in draws], straight)
    # Three standard deviations of 400 draws, of ten numbers.
    assert all(abs(each["mean"]) < 3.5 / 20.0 for each in found["pulls"].values())
    assert all(abs(each["rms"] - 1.0) < 3.5 / math.sqrt(800.0) for each in found["pulls"].values())
    assert found["chi2"]["mean"] == pytest.approx(10.0, abs=3.5 * math.sqrt(20.0 / 400.0))
    # A tracker that may be off makes more of the same errors likely.
    assert tables(draws)["pulls"]["ac12_rad"]["rms"] < found["pulls"]["ac12_rad"]["rms"]
    assert "pulls" not in tables([drawn(0, 1.0, 1.0)])


def test_the_papers_errors_give_the_papers_totals():
    worst = np.array([[published().rows[name].worst for name in NAMES]])
    assert budget(worst)["total_worst_m_s2"] == pytest.approx(1.07e-15, rel=0.02)


def test_a_draw_that_lacks_an_estimate_is_named():
    with pytest.raises(DataError, match="no draws yet"):
        tables([])
    data = drawn(0, 1.0, 1.0).as_json()
    del data["estimates"]["joint"]["ad11"]
    with pytest.raises(DataError, match="a draw of the study has no joint of ad11; run it again"):
        tables([Draw.from_json(data)])
