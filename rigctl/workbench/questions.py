"""What there is to ask of the next measurement: is it this effect, or that one; is it there at all?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rigctl.errors import RigError
from rigctl.workbench.attempt import Attempt
from rigctl.workbench.findings import Diagnosis, Rank
from rigctl.workbench.score import ABSORBED
from rigctl.workbench.study import FloatArray, Study, Term


@dataclass(frozen=True)
class Question:
    """Is it `term`, or `rival`? Or without a rival: is it there at all, so that `instead` does not imitate it?

    `size` (d,) are the parameters' sizes, `basis` where they are from.
    """

    term: Term
    rival: Term | None
    size: FloatArray
    basis: Literal["estimate", "typical"]
    instead: str = ""

    @property
    def other(self) -> str:
        """What it must be told from."""
        return self.rival.effect if self.rival else self.instead


def rivals(study: Study, final: Sequence[Term], diagnosis: Diagnosis) -> tuple[tuple[Term, ...], list[Question]]:
    """Of what was found and has an equal: either against the other, at the size it would have.

    `final` are the terms the diagnosis ended with; what is returned first are those of them without an equal.
    """
    ranks = {rank.term.effect: rank for rank in diagnosis.ranking}
    contested = [
        rank
        for rank in diagnosis.ranking
        if rank.term in final and rank.term not in diagnosis.terms and _equals(rank, ranks)
    ]
    doubted = [rank.term for rank in contested]
    base = tuple(term for term in final if term not in doubted)
    sizes: dict[str, FloatArray] = {}
    questions = []
    for rank in contested:
        others = tuple(each.term for each in contested if each is not rank)
        for alternative in _equals(rank, ranks):
            for one, other in ((rank.term, alternative), (alternative, rank.term)):
                if one.effect not in sizes:
                    sizes[one.effect] = _estimated(study, (*base, *others), one)
                if len(sizes[one.effect]):
                    questions.append(Question(one, other, sizes[one.effect], "estimate"))
    return base, questions


def inseparable(final: Attempt, diagnosis: Diagnosis) -> list[Question]:
    """Effects that these data cannot tell from another, or from what is fitted: at their typical sizes."""
    scored = {each.candidate.term.effect: each for each in final.scored}
    questions = []
    absorbed: set[str] = set()
    for pair in diagnosis.inseparable:
        if pair.effect not in scored or pair.effect in absorbed:
            continue
        own = scored[pair.effect].candidate
        if pair.other.startswith("baseline:"):
            absorbed.add(pair.effect)
            size = np.where(scored[pair.effect].score.keep < ABSORBED, own.typical, 0.0)
            if size.any():
                questions.append(Question(own.term, None, size, "typical", pair.other))
        elif pair.other in scored:
            questions.append(Question(own.term, scored[pair.other].candidate.term, own.typical, "typical"))
    return questions


def _equals(rank: Rank, ranks: dict[str, Rank]) -> list[Term]:
    return [ranks[name].term for name in rank.equivalent_to if name in ranks]


def _estimated(study: Study, beside: Sequence[Term], term: Term) -> FloatArray:
    """Size of a term fitted beside others, (d,); empty when it cannot be."""
    try:
        attempt = Attempt(study, (*[each for each in beside if each != term], term))
    except RigError:
        return np.zeros(0)
    own = [i for i, owner in enumerate(attempt.model.owners) if owner == term.effect]
    return np.asarray(attempt.result.values[own])
