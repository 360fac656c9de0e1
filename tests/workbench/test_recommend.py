"""The next measurement: its promise is what refitting gives, and what it promises comes true."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl.analysis.least_squares import Parameter
from rigctl.core.arrays import FloatArray
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.next.noncentrality import LEVEL, SEPARATING_LAMBDA
from rigctl.workbench.next.recommend import recommend
from rigctl.workbench.next.recommendation import Recommendation
from rigctl.workbench.study import (
    Candidate,
    Line,
    NoisePool,
    NotTestable,
    Observations,
    Plannable,
    Proposal,
    Series,
    Term,
)
from rigctl.workbench.verdict.diagnose import diagnose

Column = Callable[[FloatArray, FloatArray], FloatArray]

EFFECTS: dict[str, Column] = {
    "flat": lambda theta, f: np.cos(theta),
    "growing": lambda theta, f: (f / 0.5) ** 2 * np.cos(theta),
    "second": lambda theta, f: np.sin(2.0 * theta),
    "offset": lambda theta, f: np.ones_like(theta),
}
"""Two that are one at 0.5 Hz, one of its own, and one that the baseline holds."""

TYPICAL = 8.0

ANGLES = np.radians([-60.0, -40.0, -20.0, 20.0, 40.0, 60.0])


@dataclass
class Model:
    observations: Observations
    terms: tuple[Term, ...]
    parameters: Sequence[Parameter]
    units: Sequence[str]
    owners: Sequence[str]
    design: FloatArray

    def predict(self, values: FloatArray) -> FloatArray:
        return self.design @ values

    def jacobian(self, values: FloatArray) -> FloatArray:
        return self.design


@dataclass
class Bench:
    """Readings of one series at angles and frequencies, with noise 1; `offered` are the frequencies to go on with."""

    theta: FloatArray
    frequency: FloatArray
    value: FloatArray
    offered: tuple[float, ...] = (0.3, 0.5, 0.6)
    experiment: str = "bench"

    def effects(self) -> Mapping[str, str]:
        return dict.fromkeys(EFFECTS, "an effect")

    def model(self, terms: Sequence[Term]) -> Model:
        names = ["level", "slope", *(term.effect for term in terms)]
        columns = [np.ones_like(self.theta), np.sin(self.theta)]
        columns += [self.column(term) for term in terms]
        owners = ["", "", *(term.effect for term in terms)]
        parameters = [Parameter(name, 0.0) for name in names]
        return Model(self._observed, tuple(terms), parameters, ["V"] * len(names), owners, np.stack(columns, axis=1))

    def column(self, term: Term) -> FloatArray:
        return EFFECTS[term.effect](self.theta, self.frequency)

    def catalogue(self) -> list[Term]:
        return [Term(name) for name in EFFECTS]

    def candidates(self, model: Any, values: FloatArray) -> tuple[list[Candidate], list[NotTestable]]:
        inside = {term.effect for term in model.terms}
        return [
            Candidate(term, (term.effect,), ("V",), self.column(term)[:, None], np.full(1, TYPICAL))
            for term in self.catalogue()
            if term.effect not in inside
        ], []

    def lines(self, model: Any) -> Sequence[Line]:
        return ()

    def result(self, model: Any, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        return {"slope": {"value": float(values[1]), "sigma": float(covariance[1, 1]) ** 0.5, "unit": "V"}}

    def options(self) -> list[Proposal]:
        return [
            Proposal({"theta_deg": float(np.degrees(theta)), "frequency_hz": f}, 30.0)
            for theta, f in itertools.product(ANGLES, self.offered)
        ]

    def extended(self, proposals: Sequence[Proposal]) -> Bench:
        theta = np.radians([float(each.settings["theta_deg"]) for each in proposals])
        frequency = [float(each.settings["frequency_hz"]) for each in proposals]
        return replace(
            self,
            theta=np.concatenate([self.theta, theta]),
            frequency=np.concatenate([self.frequency, frequency]),
            value=np.concatenate([self.value, np.full(len(proposals), 1e6)]),
        )

    @property
    def _observed(self) -> Observations:
        n = len(self.value)
        none = np.zeros(n, dtype=np.intp)
        return Observations(
            tuple(map(str, range(n))), (Series("v", "", "V"),), (NoisePool("v", 1e6),), self.value, np.ones(n),
            none, np.arange(n), none, none, np.arange(n) % 4,
        )  # fmt: skip


class Headed(Bench):
    """`growing` is one of head a or of head b; of b it is a shape of its own."""

    def catalogue(self) -> list[Term]:
        heads = [Term("growing", {"head": head}) for head in "ab"]
        return [*(term for term in super().catalogue() if term.effect != "growing"), *heads]

    def column(self, term: Term) -> FloatArray:
        return np.sin(3.0 * self.theta) if term.choice.get("head") == "b" else super().column(term)


class InTurn(Bench):
    """A bench that gets half as far from 0.5 Hz when it thinks of all its options at once."""

    def extended(self, proposals: Sequence[Proposal]) -> Bench:
        share = 1.0 if len(proposals) < len(self.options()) else 0.5
        nearer = [
            replace(
                each, settings={**each.settings, "frequency_hz": 0.5 + share * (each.settings["frequency_hz"] - 0.5)}
            )
            for each in proposals
        ]
        return super().extended(nearer)


def bench(seed: int = 1, hidden: float = 8.0, effect: str = "flat", **changes: Any) -> Bench:
    """Twenty-four readings at 0.5 Hz, where two effects are one."""
    theta = np.tile(ANGLES, 4)
    frequency = np.full(len(theta), 0.5)
    noise = np.random.default_rng(seed).standard_normal(len(theta))
    value = 1.0 + 2.0 * np.sin(theta) + hidden * EFFECTS[effect](theta, frequency) + noise
    return Bench(theta, frequency, value, **changes)


@pytest.fixture(scope="module")
def ambiguous() -> tuple[Bench, Diagnosis]:
    study = bench()
    return study, diagnose(study, ())


def noncentrality(study: Bench, wrong: str, right: str, size: float) -> float:
    """By plain projection, on all readings of a study; the rest of the catalogue may be as large as is typical."""
    others = [column(study.theta, study.frequency) for name, column in EFFECTS.items() if name not in (wrong, right)]
    fitted = np.column_stack([study.model([Term(wrong)]).design, *others])
    beliefs = np.hstack([np.zeros((len(others), fitted.shape[1] - len(others))), np.eye(len(others)) / TYPICAL])
    fitted = np.vstack([fitted, beliefs])
    column = np.append(EFFECTS[right](study.theta, study.frequency), np.zeros(len(others)))
    left = column - fitted @ np.linalg.lstsq(fitted, column, rcond=None)[0]
    return float(size**2 * (left @ left))


def test_rivals_are_separated_by_another_frequency(ambiguous: tuple[Bench, Diagnosis]) -> None:
    study, found = ambiguous
    assert isinstance(study, Plannable)
    assert found.verdict == "ambiguous"
    advice = recommend(study, (), found)
    assert advice.purpose == "separate"
    assert {run.settings["frequency_hz"] for run in advice.runs} - {0.5}
    assert {(a.question.term.effect, a.question.other) for a in advice.answers} >= {
        ("flat", "growing"),
        ("growing", "flat"),
    }
    assert all(answer.question.basis == "estimate" for answer in advice.answers)


def test_a_rival_that_has_choices_is_the_one_that_would_do_instead() -> None:
    """Beside what was found, which is the same as head a, head b fits best."""
    study = Headed(**vars(bench()))
    advice = recommend(study, (), diagnose(study, ()))
    assert advice.purpose == "separate"
    found = {(answer.question.term.effect, answer.question.other) for answer in advice.answers}
    assert found == {("flat", "growing"), ("growing", "flat")}
    choices = [term.choice for a in advice.answers for term in (a.question.term, a.question.rival) if term]
    assert {choice["head"] for choice in choices if choice} == {"a"}


@pytest.mark.parametrize("kind", [Bench, InTurn])
def test_the_promise_is_what_refitting_on_all_runs_gives(
    ambiguous: tuple[Bench, Diagnosis], kind: type[Bench]
) -> None:
    study, found = kind(**vars(ambiguous[0])), ambiguous[1]
    advice = recommend(study, (), found)
    longer = study.extended(advice.runs)
    for answer in advice.answers:
        size = float(answer.question.size[0])
        wrong, right = answer.question.other, answer.question.term.effect
        assert answer.lambda_promised == pytest.approx(noncentrality(longer, wrong, right, size), rel=1e-5)
        assert answer.lambda_now == pytest.approx(noncentrality(study, wrong, right, size), abs=1e-4)


def test_it_stops_when_enough_is_promised(ambiguous: tuple[Bench, Diagnosis]) -> None:
    study, found = ambiguous
    advice = recommend(study, (), found)
    least = min(answer.lambda_promised for answer in advice.answers)
    assert SEPARATING_LAMBDA <= least < 4.0 * SEPARATING_LAMBDA
    shorter = study.extended(advice.runs[:1])
    reached = [
        noncentrality(shorter, answer.question.other, answer.question.term.effect, float(answer.question.size[0]))
        for answer in advice.answers
    ]
    assert min(reached) < SEPARATING_LAMBDA


@pytest.mark.parametrize("true", ["flat", "growing"])
def test_what_is_promised_comes_true(ambiguous: tuple[Bench, Diagnosis], true: str) -> None:
    """The wrong rival is rejected in 95 % of simulations with the size that was estimated."""
    study, found = ambiguous
    advice = recommend(study, (), found)
    wrong = "growing" if true == "flat" else "flat"
    size = next(float(a.question.size[0]) for a in advice.answers if a.question.term.effect == true)
    longer = study.extended(advice.runs)
    design = longer.model([Term(wrong)]).design
    basis = np.linalg.qr(design)[0]
    column = EFFECTS[true](longer.theta, longer.frequency)
    free = column - basis @ (basis.T @ column)
    rng = np.random.default_rng(2)
    falls = np.array(
        [(free @ (size * column + rng.standard_normal(len(column)))) ** 2 / (free @ free) for _ in range(2000)]
    )
    assert np.mean(stats.chi2.sf(falls, 1) < LEVEL) >= 0.95


def test_what_no_run_can_separate_is_said(ambiguous: tuple[Bench, Diagnosis]) -> None:
    study, found = ambiguous
    advice = recommend(replace(study, offered=(0.5,)), (), found)
    assert advice.purpose == "tighten"
    assert {answer.question.other for answer in advice.hopeless} >= {"flat", "growing"}
    assert "flat, " not in advice.words
    assert "growing from flat" in advice.words


def test_only_runs_that_the_bench_can_do_are_chosen(ambiguous: tuple[Bench, Diagnosis]) -> None:
    study, found = ambiguous
    advice = recommend(study, (), found, allowed=lambda run: run.settings["frequency_hz"] < 0.55)
    assert {run.settings["frequency_hz"] for run in advice.runs} <= {0.3, 0.5}
    nothing = recommend(study, (), found, allowed=lambda _: False)
    assert (nothing.purpose, nothing.runs, nothing.words) == ("none", (), "There is no run that the bench can do.")
    # As in a table of words and a time.
    assert "nothing that was recorded" in recommend(replace(study, offered=()), (), found).words


def test_a_result_is_tightened_as_a_fit_with_these_runs_says() -> None:
    study = bench(hidden=0.0)
    found = replace(diagnose(study, ()), inseparable=())
    assert found.verdict == "adequate"
    advice = recommend(study, (), found)
    assert advice.purpose == "tighten"
    (slope,) = advice.result
    for runs, sigma in (((), slope.sigma_now), (advice.runs, slope.sigma_promised)):
        design = study.extended(runs).model(()).design
        assert sigma == pytest.approx(np.linalg.inv(design.T @ design)[1, 1] ** 0.5, rel=1e-3)
    assert slope.sigma_promised < 0.95 * slope.sigma_now
    assert {round(abs(run.settings["theta_deg"])) for run in advice.runs} == {60}


def test_what_the_baseline_holds_has_no_promise() -> None:
    study = bench(hidden=0.0)
    found = diagnose(study, ())
    advice = recommend(study, (), found)
    assert ("offset", "baseline:level") in {(a.question.term.effect, a.question.other) for a in advice.hopeless}
    assert "offset" not in {answer.question.term.effect for answer in advice.answers}
    assert {a.question.other for a in advice.answers} == {"growing"}


def test_a_study_that_cannot_plan_says_so(ambiguous: tuple[Bench, Diagnosis]) -> None:
    class Deaf:
        experiment = "deaf"

    advice = recommend(Deaf(), (), ambiguous[1])  # type: ignore[arg-type]
    assert advice.purpose == "none"
    assert "deaf" in advice.words


def test_json_has_the_documented_keys(ambiguous: tuple[Bench, Diagnosis]) -> None:
    found: Recommendation = recommend(ambiguous[0], (), ambiguous[1])
    document = found.as_json()
    assert set(document) == {
        *("purpose", "description", "runs", "best_run", "takes_s", "promises", "cannot_be_separated", "result"),
        *("course", "smallest_detectable"),
    }
    assert document["takes_s"] == pytest.approx(30.0 * len(document["runs"]))
    assert set(document["promises"][0]) == {
        *("effect", "from", "size", "lambda_now", "lambda", "power", "runs_needed"),
    }
