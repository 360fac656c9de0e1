"""Reduced runs stand in the order of what they contain."""

from __future__ import annotations

from rigctl.analysis.kept import LeftOut, Reduction


def test_runs_are_sorted_by_their_contents_unknown_numbers_last() -> None:
    nan = float("nan")
    found = Reduction.of([(nan, 1.0), (2.0, nan), LeftOut("r1", "too short"), (2.0, 5.0), (1.0, 9.0)])
    in_order = found.sorted_by(lambda run: run)
    assert [run[0] for run in in_order.runs[:3]] == [1.0, 2.0, 2.0]
    assert in_order.runs[1] == (2.0, 5.0)
    assert in_order.runs[3][1] == 1.0
    assert in_order.left_out == {"r1": "too short"}
