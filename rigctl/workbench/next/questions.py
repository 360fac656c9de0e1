"""What there is to ask of the next measurement: is it this effect, or that one; is it there at all?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import UNFIT
from rigctl.workbench.findings import Diagnosis, Rank
from rigctl.workbench.study import ScansBetween, Study, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.score import ABSORBED
from rigctl.workbench.verdict.shared import Shared

SURE = 2.0
"""So many sigma of a parameter, and it is there."""


@dataclass(frozen=True)
class Question:
    """Is it `term`, or `rival`? Or without a rival: is it there at all, so that `instead` does not imitate it?

    `size` (d,) are the parameters' sizes, `basis` where they are from. `nearby` are choices of the rival beside the
    one it has: free with it, for a time or a frequency is fitted too.
    """

    term: Term
    rival: Term | None
    size: FloatArray
    basis: Literal["estimate", "typical", "if-white"]
    instead: str = ""
    nearby: tuple[Term, ...] = ()

    @property
    def terms(self) -> tuple[Term, ...]:
        """What has columns of its own."""
        return (self.term, *(() if self.rival is None else (self.rival,)), *self.nearby)

    @property
    def other(self) -> str:
        """What it must be told from."""
        return self.rival.effect if self.rival else self.instead


def rivals(
    study: Study, final: Sequence[Term], diagnosis: Diagnosis, shared: Shared
) -> tuple[tuple[Term, ...], list[Question]]:
    """Of what was found and has an equal: either against the other, at the size it would have.

    `final` are the terms the diagnosis ended with; what is returned first are those of them without an equal.
    `shared` is what attempts with this study have in common.
    """
    contested = [
        rank
        for rank in diagnosis.ranking
        if rank.term in final and rank.term not in diagnosis.terms and rank.equivalent_to
    ]
    doubted = [rank.term for rank in contested]
    base = tuple(term for term in final if term not in doubted)
    questions = []
    for rank in contested:
        beside = (*base, *(term for term in doubted if term != rank.term))
        own = _estimated(study, beside, rank.term, shared)
        for alternative in _equals(study, beside, rank, shared):
            its = _estimated(study, beside, alternative, shared)
            # Both ways: either may be the truth, and the runs must tell whichever it is.
            for one, size, other in ((rank.term, own, alternative), (alternative, its, rank.term)):
                if len(size):
                    questions.append(Question(one, other, size, "estimate", nearby=_nearby(study, other)))
    return base, questions


def inseparable(final: Attempt, diagnosis: Diagnosis) -> list[Question]:
    """Effects that these data cannot tell from another, or from what is fitted: at their typical sizes."""
    scored = {each.candidate.term.effect: each for each in final.scored}
    questions = []
    # One question for an effect, however many parameters absorb it.
    absorbed: set[str] = set()
    for pair in diagnosis.inseparable:
        if pair.effect not in scored or pair.effect in absorbed:
            continue
        candidate = scored[pair.effect].candidate
        if pair.other.startswith("baseline:"):
            absorbed.add(pair.effect)
            # Its other parameters show in these data already.
            size = np.where(scored[pair.effect].score.keep < ABSORBED, candidate.typical, 0.0)
            if size.any():
                questions.append(Question(candidate.term, None, size, "typical", pair.other))
        elif pair.other in scored:
            questions.append(
                Question(candidate.term, scored[pair.other].candidate.term, candidate.typical, "typical")
            )
    return questions


def _equals(study: Study, beside: Sequence[Term], rank: Rank, shared: Shared) -> list[Term]:
    """What does as well in its place, each with the choice (a head) that does best there."""
    scored = Attempt(study, beside, shared=shared).scored
    instead = {each.candidate.term.effect: each.candidate.term for each in scored}
    return [instead[effect] for effect in rank.equivalent_to if effect in instead]


def _nearby(study: Study, term: Term) -> tuple[Term, ...]:
    """The same effect with the neighbours of what a scan has found."""
    if not isinstance(study, ScansBetween):
        return ()
    neighbours = study.neighbours(term).items()
    return tuple(Term(term.effect, {**term.choice, name: value}) for name, both in neighbours for value in both)


def _estimated(study: Study, beside: Sequence[Term], term: Term, shared: Shared) -> FloatArray:
    """Size of a term fitted beside others, (d,), without what was scanned for; empty when it cannot be fitted."""
    try:
        attempt = Attempt(study, (*beside, term), shared=shared)
    except UNFIT:
        return np.zeros(0)
    amplitudes = [name not in attempt.scanned for name in attempt.names]
    columns = np.flatnonzero([o == term.effect and a for o, a in zip(attempt.model.owners, amplitudes, strict=True)])
    size = np.asarray(attempt.result.values[columns])
    sure = np.abs(size) > SURE * _sigma(
        attempt.result.covariance, columns, np.flatnonzero(np.logical_not(amplitudes))
    )
    # What is not sure is estimated too large: no promise is built on it.
    return np.where(sure, size, 0.0) if sure.any() else size


def _sigma(covariance: FloatArray, amplitudes: IntArray, scanned: IntArray) -> FloatArray:
    """Standard uncertainties of amplitudes with what was scanned for held where it is."""
    across = covariance[np.ix_(amplitudes, scanned)]
    known = np.linalg.pinv(covariance[np.ix_(scanned, scanned)])
    return np.asarray(
        # Schur's complement: what is left of the amplitudes' covariance when the scanned values are known.
        np.sqrt(np.maximum(np.diag(covariance[np.ix_(amplitudes, amplitudes)] - across @ known @ across.T), 0.0))
    )
