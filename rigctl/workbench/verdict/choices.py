"""Choices of an effect found by scanning: the head, frequency or period that explains most of the residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.core.errors import DataError
from rigctl.workbench.study import Study, Term
from rigctl.workbench.verdict.attempt import Attempt


def diagnosed(diagnosis: Mapping[str, Any] | None, effect: str) -> Term | None:
    """The term as a diagnosis (its JSON) fitted it with all it suggested, else as it ranked it; None when that says
    nothing of it."""
    # A rival that is suggested is ranked beside what it stands for: it may explain what is left there otherwise.
    joint = (diagnosis or {}).get("joint_fit") or {"terms": []}
    ranking = diagnosis["ranking"] if diagnosis else []
    told = [Term(effect, each["choice"]) for each in [*joint["terms"], *ranking] if each["effect"] == effect]
    return told[0] if told else None


def joined(terms: Sequence[Term], term: Term) -> tuple[Term, ...]:
    """The terms and one more, in the place of the one of its effect: a period with more harmonics."""
    return (*(each for each in terms if each.effect != term.effect), term)


def best(study: Study, terms: Sequence[Term], effect: str) -> Term:
    """The term of `effect` that fits best beside `terms`; `DataError` when these data cannot be asked about it.

    A line is looked for in the samples; anything else by the fall of chi-square it would bring.
    """
    attempt = Attempt(study, terms)
    scored = [each.candidate.term for each in attempt.scored if each.candidate.term.effect == effect]
    if scored:
        return scored[0]
    lines = [line for line in study.lines(attempt.model) if line.term.effect == effect]
    if lines:
        return min(lines, key=lambda line: line.p_value).term
    reasons = [each.reason for each in attempt.not_testable if each.effect == effect]
    reason = reasons[0] if reasons else "nothing in them tells its size"
    raise DataError(f"'{effect}' cannot be added to a model of these data: {reason}")
