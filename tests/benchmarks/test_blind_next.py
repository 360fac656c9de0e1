"""The benchmark of recommended measurements: what counts as decided, and rates by what was promised."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.blind_next import promises, report, separated
from rigctl.workbench.findings import Diagnosis, Rank
from rigctl.workbench.next.questions import Question
from rigctl.workbench.next.recommendation import Answer, Recommendation
from rigctl.workbench.study import Term


def diagnosis(verdict: Any, said: tuple[str, ...], equal: tuple[str, ...] = ()) -> Diagnosis:
    terms = tuple(Term(effect) for effect in said)
    ranking = tuple(Rank(term, 1e-9, 1e-8, {}, 0.5, equal, 80.0, 1.0, {}) for term in terms)
    return Diagnosis(verdict, 0.01, (), terms, ranking, (), None, {}, (), 30.0)


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (diagnosis("effect", ("a",)), True),
        (diagnosis("effect", ("b",)), False),
        (diagnosis("adequate", ()), False),
        (diagnosis("ambiguous", ("a", "b")), False),
        (diagnosis("ambiguous", ("a",), equal=("b",)), False),
        (diagnosis("ambiguous", ("a",), equal=("c",)), True),
        (diagnosis("effect", ("a",), equal=("b",)), True),
        (diagnosis("unknown", ("a",), equal=("b",)), False),
    ],
)
def test_rivals_are_apart_when_one_is_named_and_the_other_is_not_left_open(found: Diagnosis, expected: bool) -> None:
    assert separated(found, "a", "b") == expected


def test_what_is_promised_of_the_hidden_effect_counts() -> None:
    def answer(one: str, other: str, value: float) -> Answer:
        return Answer(Question(Term(one), Term(other), np.ones(1), "estimate"), 0.0, value, 1.0, 1)

    found = (answer("a", "b", 30.0), answer("b", "a", 40.0), answer("a", "c", 50.0))
    assert promises(Recommendation("separate", (), "", found), "a") == {"b": 30.0, "c": 50.0}
    assert promises(Recommendation("reveal", (), "", found), "a") == {}


def row(kept: int, value: float = 30.0) -> dict[str, Any]:
    pair = {"from": "b", "lambda": value, "separated": bool(kept)}
    return {"seed": 1, "hidden": {"a": {}}, "said_after": ["a"] if kept else ["b"], "pairs": [pair]}


def test_rates_are_told_by_what_was_promised(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [*[row(1)] * 19, row(0), row(0, value=10.0), row(1, value=200.0), {"seed": 2}]
    assert not report(rows)
    told = capsys.readouterr().out
    assert "23 trials, 22 with the hidden effect among rivals" in told
    assert "19/20 pairs = 0.950 [0.751, 0.999]  lambda 25 .. 50" in told
    assert "0/1 pairs" in told
    assert "20/21 trials" in told


def test_a_promise_that_is_not_kept_is_missed() -> None:
    assert report([*[row(1)] * 10, *[row(0)] * 10])
