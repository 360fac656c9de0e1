"""The study's tables: the paper's rows multiplied out, and our errors as it counts them."""

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
