"""Runs that answer questions, with the noncentrality and the power they are expected to reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.next.imagined import Imagined
from rigctl.workbench.next.information import Information
from rigctl.workbench.next.noncentrality import SEPARATING_LAMBDA, power
from rigctl.workbench.next.plan import Plan, runs_needed
from rigctl.workbench.next.questions import Question
from rigctl.workbench.next.recommendation import Answer
from rigctl.workbench.next.rig_time import RigTime
from rigctl.workbench.next.triangle import Triangle, triangle_of
from rigctl.workbench.study import Candidate, Term

_SCANNED = 3
"""Effects with more choices than that (an unknown period) are scanned for: too many to count with beside others."""

_HOPELESS = 0.2 * SEPARATING_LAMBDA
"""Questions that stay below this noncentrality are reported as not answerable."""


@dataclass(frozen=True)
class Decided:
    """Proposals chosen for some questions, and the answers: those worth having and those that are none."""

    chosen: tuple[int, ...] = ()
    answers: tuple[Answer, ...] = ()
    hopeless: tuple[Answer, ...] = ()


def decided(
    imagined: Imagined, questions: Sequence[Question], most_runs: int, others: Sequence[Candidate] = ()
) -> Decided:
    """What to measure to answer questions, while `others` may act too; what cannot be answered is left out."""
    if not questions:
        return Decided()
    triangle = triangle_of(imagined, _terms_of(questions), others=others)
    first = _planned(triangle, imagined, questions, most_runs)
    reached = [answer for answer in first.answers if answer.lambda_promised >= SEPARATING_LAMBDA]
    if not reached or not (first.hopeless or len(reached) < len(first.answers)):
        return _made(first, imagined, others)
    # What cannot be reached anyway would take its share of the runs.
    missed = tuple(answer for answer in first.answers if answer not in reached)
    again = _planned(triangle, imagined, [answer.question for answer in reached], most_runs)
    return _made(replace(again, hopeless=(*first.hopeless, *missed, *again.hopeless)), imagined, others)


def others_than(questions: Sequence[Question], imagined: Imagined) -> list[Candidate]:
    """Candidates that are not in question but may act too, and are therefore free while runs are chosen."""
    asked = _terms_of(questions)
    effects = [candidate.term.effect for candidate in imagined.candidates]
    return [
        candidate
        for candidate in imagined.candidates
        if candidate.term not in asked and effects.count(candidate.term.effect) <= _SCANNED
    ]


def _planned(triangle: Triangle, imagined: Imagined, questions: Sequence[Question], most_runs: int) -> Decided:
    information = Information(triangle)
    asked = [(question, known) for question in questions if (known := information.asked(question)) is not None]
    wanted = [SEPARATING_LAMBDA] * len(asked)
    plan = Plan(information, [known for _, known in asked], wanted, RigTime(imagined.proposals), most_runs)
    answers = [_answer(question, plan.promised(number)) for number, (question, _) in enumerate(asked)]
    worth = tuple(answer for answer in answers if answer.lambda_promised >= _HOPELESS)
    hopeless = tuple(answer for answer in answers if answer.lambda_promised < _HOPELESS)
    return Decided(tuple(plan.runs) if worth else (), worth, hopeless)


def _answer(question: Question, course: Sequence[float]) -> Answer:
    return Answer(
        question, course[0], course[-1], _power(question, course[-1]), runs_needed(course, SEPARATING_LAMBDA)
    )


def _made(decision: Decided, imagined: Imagined, others: Sequence[Candidate]) -> Decided:
    """Expected noncentralities once all chosen runs are made; each run was chosen as if it were the next."""
    if not decision.chosen:
        return decision
    questions = [answer.question for answer in decision.answers]
    promised = _promised(imagined.only(decision.chosen), questions, others)
    answers = [
        replace(answer, lambda_promised=value, power=_power(answer.question, value))
        for answer, value in zip(decision.answers, map(float, promised), strict=True)
    ]
    return replace(decision, answers=tuple(answers))


def _promised(imagined: Imagined, questions: Sequence[Question], others: Sequence[Candidate]) -> FloatArray:
    information = Information(triangle_of(imagined, _terms_of(questions), others=others))
    for run in range(len(imagined.proposals)):
        information.add(run)
    asked = [information.asked(question) for question in questions]
    return np.array([0.0 if each is None else information.noncentralities([each])[0] for each in asked])


def _power(question: Question, noncentrality: float) -> float:
    # Parameters without a size are free in the test, not part of what is tested.
    return power(noncentrality, int(np.sum(question.size != 0.0)))


def _terms_of(questions: Sequence[Question]) -> list[Term]:
    terms: list[Term] = []
    for question in questions:
        terms += [term for term in question.terms if term not in terms]
    return terms
