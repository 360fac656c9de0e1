"""The next measurement: the runs that best separate what is ambiguous, show what is hidden, or tighten the result.

For an effect j and what it must be told from (a rival k, or the fitted parameters alone) the promise of runs x is

    lambda = b' V(data + x) b,    V = G_j' M G_j,    M projecting out everything fitted, k among it,

with b the effect's size: as estimated where it is significant, else the catalogue's typical one, since what is not
significant is estimated too large. lambda is how far chi-square will be from what it would be, on average, with the
wrong one of the two in the model. Between rivals, M leaves the rest of the catalogue free too, within typical sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rigctl.core.threads import one_thread
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.next.courses import revealing
from rigctl.workbench.next.decide import Decided, decided, others_than
from rigctl.workbench.next.imagined import Imagined
from rigctl.workbench.next.plan import shuffled
from rigctl.workbench.next.questions import inseparable, rivals
from rigctl.workbench.next.recommendation import (
    Answer,
    Purpose,
    Recommendation,
    Tightened,
    course_words,
    hopeless_words,
    telling_words,
    tightening_words,
)
from rigctl.workbench.next.tighten import tightening
from rigctl.workbench.study import Allowed, Plannable, Proposal, Scheduled, Study, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.shared import Shared

MOST_RUNS = 24

_NOTHING_TO_SET = "No run can be proposed: nothing that was recorded with the others is a quantity that one sets."


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

    Rivals first; then what slow noise may hide; then effects that cannot be told from others or are absorbed; else
    what tightens the result. Runs are chosen among those `offered`, by default all options of the study; `allowed`
    says which of them the bench can do, `seed` fixes their order.
    """
    if not isinstance(study, Plannable):
        return Recommendation("none", (), f"Nothing is known of what a '{study.experiment}' rig could measure next.")
    given = offered is not None
    conceivable = offered or study.options()
    offered = [each for each in conceivable if allowed is None or allowed(each)]
    if not offered:
        why = "There is no run that the bench can do." if conceivable else _NOTHING_TO_SET
        return Recommendation("none", (), why)
    final = diagnosis.steps[-1].terms if diagnosis.steps else tuple(terms)
    shared = Shared()
    base, questions = rivals(study, final, diagnosis, shared)
    # Rivals are asked about in a model without any of those in doubt: each takes its place in turn.
    separating = Decided()
    if questions:
        imagined = Imagined(study, Attempt(study, base, shared=shared), offered)
        separating = decided(imagined, questions, most_runs, others_than(questions, imagined))
    if separating.chosen:
        return _telling("separate", separating, offered, seed)
    attempt = Attempt(study, final, shared=shared)
    # Whoever offers runs has asked for some of these, at any time.
    if not given and (revealed := _out_of_slow_noise(study, attempt, diagnosis, allowed)) is not None:
        return replace(revealed, hopeless=separating.hopeless)
    imagined = Imagined(study, attempt, offered)
    revealing = decided(imagined, inseparable(attempt, diagnosis), most_runs)
    revealing = replace(revealing, hopeless=(*separating.hopeless, *revealing.hopeless))
    if revealing.chosen:
        return _telling("reveal", revealing, offered, seed)
    result = study.result(attempt.model, attempt.result.values, attempt.result.covariance)
    chosen, tightened = tightening(imagined, result, most_runs)
    return _tightening([offered[i] for i in chosen], tightened, revealing.hopeless, seed)


def _out_of_slow_noise(
    study: Study, attempt: Attempt, diagnosis: Diagnosis, allowed: Allowed | None
) -> Recommendation | None:
    """The course of runs that shows what slow noise may hide; None where nothing is hidden, or none does."""
    if not diagnosis.hidden_in_slow_noise or not isinstance(study, Scheduled):
        return None
    found = revealing(study, attempt, diagnosis.hidden_in_slow_noise, diagnosis.alpha, allowed)
    if found is None:
        return None
    kind, runs = found.course.kind, found.course.runs
    words = course_words(kind, found.answers, found.sizes, runs)
    return Recommendation("reveal", runs, words, found.answers, best=runs[0], course=kind, sizes=found.sizes)


def _telling(purpose: Purpose, decision: Decided, offered: Sequence[Proposal], seed: int) -> Recommendation:
    runs = shuffled([offered[i] for i in decision.chosen], seed)
    words = telling_words(decision.answers, decision.hopeless, runs)
    return Recommendation(purpose, runs, words, decision.answers, decision.hopeless, best=offered[decision.chosen[0]])


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
