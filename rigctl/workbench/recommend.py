"""The next measurement: the runs that best separate what is ambiguous, show what is hidden, or tighten the result.

For an effect j and what it must be told from (a rival k, or the fitted parameters alone) the promise of runs x is

    lambda = b' V(data + x) b,    V = G_j' M G_j,    M projecting out everything fitted, k among it,

with b the effect's size: as estimated where it is significant, else the catalogue's typical one, since what is not
significant is estimated too large. lambda is how far chi-square will be from what it would be, on average, with the
wrong one of the two in the model. Between rivals, M leaves the rest of the catalogue free too, within typical sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigctl.workbench.attempt import Attempt
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.imagined import Imagined
from rigctl.workbench.information import Information
from rigctl.workbench.plan import Plan, runs_needed, shuffled
from rigctl.workbench.promise import PROMISE, power
from rigctl.workbench.questions import Question, inseparable, rivals
from rigctl.workbench.recommendation import (
    Answer,
    Purpose,
    Recommendation,
    Tightened,
    hopeless_words,
    telling_words,
    tightening_words,
)
from rigctl.workbench.rig_time import RigTime
from rigctl.workbench.study import Candidate, Plannable, Proposal, Study, Term
from rigctl.workbench.threads import one_thread
from rigctl.workbench.tighten import tightening
from rigctl.workbench.triangle import Triangle, triangle_of

MOST_RUNS = 24

_SCANNED = 3
"""Effects with more choices than that (an unknown period) are scanned for: too many to count with beside others."""

_HOPELESS = 0.2 * PROMISE
"""A lambda that nothing can lift past this is no promise."""

Allowed = Callable[[Proposal], bool]


@one_thread
def recommend(
    study: Study,
    terms: Sequence[Term],
    diagnosis: Diagnosis,
    *,
    allowed: Allowed | None = None,
    offered: Sequence[Proposal] | None = None,
    seed: int = 0,
    most_runs: int = MOST_RUNS,
) -> Recommendation:
    """What to measure next, given what `diagnosis` found beside `terms`.

    Rivals first; then effects that cannot be told from others or are absorbed; else what tightens the result. Runs
    are chosen among those `offered`, by default all options of the study; `allowed` says which of them the bench can
    do, `seed` fixes their order.
    """
    if not isinstance(study, Plannable):
        return Recommendation("none", (), f"Nothing is known of what a '{study.experiment}' rig could measure next.")
    offered = [each for each in offered or study.options() if allowed is None or allowed(each)]
    if not offered:
        return Recommendation("none", (), "There is no run that the bench can do.")
    final = diagnosis.steps[-1].terms if diagnosis.steps else tuple(terms)
    base, questions = rivals(study, final, diagnosis)
    separating = _Found()
    if questions:
        imagined = Imagined(study, Attempt(study, base), offered)
        separating = _answered(imagined, questions, most_runs, _others(imagined, questions))
    if separating.chosen:
        return _telling("separate", separating, offered, seed)
    attempt = Attempt(study, final)
    imagined = Imagined(study, attempt, offered)
    revealing = _answered(imagined, inseparable(attempt, diagnosis), most_runs)
    revealing = replace(revealing, hopeless=(*separating.hopeless, *revealing.hopeless))
    if revealing.chosen:
        return _telling("reveal", revealing, offered, seed)
    result = study.result(attempt.model, attempt.result.values, attempt.result.covariance)
    chosen, tightened = tightening(imagined, result, most_runs)
    return _tightening([offered[i] for i in chosen], tightened, revealing.hopeless, seed)


@dataclass(frozen=True)
class _Found:
    """Proposals chosen for some questions, and the answers: those worth having and those that are none."""

    chosen: tuple[int, ...] = ()
    answers: tuple[Answer, ...] = ()
    hopeless: tuple[Answer, ...] = ()


def _answered(
    imagined: Imagined, questions: Sequence[Question], most_runs: int, others: Sequence[Candidate] = ()
) -> _Found:
    if not questions:
        return _Found()
    triangle = triangle_of(imagined, _terms_of(questions), others=others)
    first = _planned(triangle, imagined, questions, most_runs)
    reached = [answer for answer in first.answers if answer.lambda_promised >= PROMISE]
    if not reached or not (first.hopeless or len(reached) < len(first.answers)):
        return first
    # What cannot be reached anyway would take its share of the runs.
    missed = tuple(answer for answer in first.answers if answer not in reached)
    again = _planned(triangle, imagined, [answer.question for answer in reached], most_runs)
    return replace(again, hopeless=(*first.hopeless, *missed, *again.hopeless))


def _planned(triangle: Triangle, imagined: Imagined, questions: Sequence[Question], most_runs: int) -> _Found:
    information = Information(triangle)
    asked = [(question, known) for question in questions if (known := information.asked(question)) is not None]
    wanted = [PROMISE] * len(asked)
    plan = Plan(information, [known for _, known in asked], wanted, RigTime(imagined.proposals), most_runs)
    answers = [_answer(question, plan.promised(number)) for number, (question, _) in enumerate(asked)]
    worth = tuple(answer for answer in answers if answer.lambda_promised >= _HOPELESS)
    hopeless = tuple(answer for answer in answers if answer.lambda_promised < _HOPELESS)
    return _Found(tuple(plan.runs) if worth else (), worth, hopeless)


def _answer(question: Question, course: Sequence[float]) -> Answer:
    dimension = int(np.sum(question.size != 0.0))
    return Answer(question, course[0], course[-1], power(course[-1], dimension), runs_needed(course, PROMISE))


def _terms_of(questions: Sequence[Question]) -> list[Term]:
    found: list[Term] = []
    for question in questions:
        found += [term for term in (question.term, question.rival) if term is not None and term not in found]
    return found


def _others(imagined: Imagined, questions: Sequence[Question]) -> list[Candidate]:
    """What might act too and is not in question: a run must not raise as many doubts as it settles."""
    asked = _terms_of(questions)
    effects = [candidate.term.effect for candidate in imagined.candidates]
    return [
        candidate
        for candidate in imagined.candidates
        if candidate.term not in asked and effects.count(candidate.term.effect) <= _SCANNED
    ]


def _telling(purpose: Purpose, found: _Found, offered: Sequence[Proposal], seed: int) -> Recommendation:
    runs = shuffled([offered[i] for i in found.chosen], seed)
    words = telling_words(found.answers, found.hopeless, runs)
    return Recommendation(purpose, runs, words, found.answers, found.hopeless, best=offered[found.chosen[0]])


def _tightening(
    chosen: Sequence[Proposal], result: Sequence[Tightened], hopeless: Sequence[Answer], seed: int
) -> Recommendation:
    said, kept = hopeless_words(hopeless), tuple(hopeless)
    if not result:
        words = f"{said}Nothing is ambiguous, and the result has no parameter to tighten."
        return Recommendation("none", (), words, hopeless=kept)
    if not chosen:
        words = f"{said}Nothing is ambiguous, and no single run would tighten the result by 1 %."
        return Recommendation("none", (), words, hopeless=kept)
    runs = shuffled(chosen, seed)
    words = f"{said}{tightening_words(result, runs)}"
    return Recommendation("tighten", runs, words, (), kept, tuple(result), chosen[0])
