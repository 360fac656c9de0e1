"""Runs one after the other: what tells most for its rig time, what is shared paid once, no lone run."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest

from rigctl.core.arrays import FloatArray
from rigctl.workbench.next.plan import COMPANY, Plan, runs_needed, shuffled
from rigctl.workbench.next.rig_time import RigTime, total_s
from rigctl.workbench.study import Proposal


class Known:
    """Lambdas that grow by so much with each run: `growth` (questions, runs)."""

    def __init__(self, growth: Sequence[Sequence[float]], now: float = 0.0) -> None:
        self.growth = np.array(growth)
        self._now = np.full(len(self.growth), now)

    def noncentralities(self, questions: Sequence[int]) -> FloatArray:
        return self._now[list(questions)]

    def noncentralities_with_each(self, questions: Sequence[int]) -> FloatArray:
        return self._now[list(questions), None] + self.growth[list(questions)]

    def add(self, run: int) -> None:
        self._now = self._now + self.growth[:, run]


def planned(known: Known, proposals: Sequence[Proposal], most: int = 24, wanted: float = 25.0) -> Plan:
    questions = list(range(len(known.growth)))
    return Plan(known, questions, [wanted] * len(questions), RigTime(proposals), most)  # type: ignore[arg-type]


def runs(*takes_s: float) -> list[Proposal]:
    return [Proposal({"number": i}, each) for i, each in enumerate(takes_s)]


def test_what_tells_most_per_second_comes_first_and_enough_is_enough() -> None:
    plan = planned(Known([[10.0, 12.0]]), runs(20.0, 60.0))
    assert plan.runs == [0, 0, 0]
    assert plan.promised(0) == [0.0, 10.0, 20.0, 30.0]


def test_more_than_is_wanted_is_no_gain() -> None:
    assert planned(Known([[1000.0, 26.0]]), runs(60.0, 20.0)).runs == [1]


def test_a_run_that_serves_two_questions_is_worth_both() -> None:
    assert planned(Known([[30.0, 0.0, 30.0], [0.0, 30.0, 30.0]]), runs(20.0, 20.0, 30.0)).runs == [2]


def test_nothing_is_measured_for_what_is_known_or_what_no_run_tells() -> None:
    assert planned(Known([[10.0]], now=30.0), runs(20.0)).runs == []
    assert planned(Known([[0.0]]), runs(20.0)).runs == []


def test_no_more_runs_than_may_be_made() -> None:
    assert len(planned(Known([[2.0]]), runs(20.0), most=5).runs) == 5


class Late(Known):
    """Three runs are needed before anything is told: a thousandth, a tenth, all."""

    def noncentralities(self, questions: Sequence[int]) -> FloatArray:
        return np.array([(0.0, 0.05, 1.0, 30.0)[min(int(self._now[0]), 3)]])

    def noncentralities_with_each(self, questions: Sequence[int]) -> FloatArray:
        after = [(0.0, 0.05, 1.0, 30.0)[min(int(self._now[0] + more), 3)] for more in self.growth[0]]
        return np.array([after])


def test_what_takes_three_runs_to_be_told_is_not_given_up_after_the_first() -> None:
    assert planned(Late([[0.0, 1.0]]), runs(20.0, 20.0)).runs == [1, 1, 1]


def test_a_sitting_is_paid_for_once_and_its_runs_have_company() -> None:
    room = [Proposal({"number": i}, 20.0, "warm", 3600.0) for i in range(COMPANY + 2)]
    plan = planned(Known([[0.0, *([30.0] * len(room))]]), [*runs(20.0), *room])
    assert len(plan.runs) == len(set(plan.runs)) == COMPANY
    assert 0 not in plan.runs
    assert total_s([([*runs(20.0), *room])[i] for i in plan.runs]) == COMPANY * 20.0 + 3600.0
    assert len(planned(Known([[0.0, *([30.0] * len(room))]]), [*runs(20.0), *room], most=3).runs) == 3
    assert planned(Known([[0.0, 30.0, 30.0]]), [*runs(20.0), *room[:2]]).runs == [1, 2]


def test_runs_of_a_sitting_that_has_begun_cost_their_own_time() -> None:
    cost = RigTime([*runs(20.0), Proposal({}, 30.0, "warm", 3600.0), Proposal({}, 40.0, "cold", 3600.0)], 5.0)
    assert cost.of_each([]).tolist() == [25.0, 3635.0, 3645.0]
    assert cost.of_each([0]).tolist() == [25.0, 3635.0, 3645.0]
    assert cost.of_each([1]).tolist() == [25.0, 35.0, 3645.0]


def test_unknown_rig_time_makes_all_runs_alike() -> None:
    assert RigTime(runs(float("nan"), float("nan"))).of_each([]).tolist() == [1.0, 1.0]
    assert np.isnan(total_s(runs(float("nan"))))


@pytest.mark.parametrize(
    ("course", "expected"), [([30.0], 0), ([0.0, 10.0, 26.0], 2), ([0.0, 5.0], 5), ([0.0, 1e-6], None), ([3.0], None)]
)
def test_runs_needed_are_those_made_or_as_many_more_as_the_last_suggest(
    course: list[float], expected: int | None
) -> None:
    assert runs_needed(course, 25.0) == expected


def test_runs_come_in_random_order_and_every_room_temperature_once() -> None:
    offered = [Proposal({"theta_deg": i, **({"temperature_c": 20.0 + i % 2} if i % 3 else {})}) for i in range(24)]
    mixed = shuffled(offered, 5)
    assert sorted(run.settings["theta_deg"] for run in mixed) == list(range(24))
    assert [run.settings["theta_deg"] for run in mixed] != list(range(24))
    rooms = [run.settings.get("temperature_c") for run in mixed]
    assert [room for room, _ in itertools.groupby(rooms)] == [None, 20.0, 21.0]
    assert shuffled(offered, 5) == mixed
