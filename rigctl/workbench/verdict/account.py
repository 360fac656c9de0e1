"""One account of the noise of a store's data, by which all its models are judged.

Noise that comes from the scatter is estimated with everything in the model that is known or significant: the terms
of all versions, and what a search finds beside them. The search estimates the noise anew with every term it tries, so
that search and noise alternate until neither changes. The estimate depends on the data, the catalogue and the terms
of all versions, never on the version looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rigctl.core.errors import UNFIT
from rigctl.workbench.study import Study, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.known_noise import KnownNoise
from rigctl.workbench.verdict.rather_than_noise import breaks_level
from rigctl.workbench.verdict.search import Search

LEVEL = 0.01
"""What is significant at this level, over all trials together, does not count as noise."""


@dataclass(frozen=True)
class Account:
    """The noise of a store's data: `richest` is the model it was estimated with.

    `known` is None where no noise comes from the scatter: then each model's data tell it by themselves. `search` is
    the one that found what was not in any version; None when the account was kept.
    """

    richest: Attempt
    known: KnownNoise | None
    search: Search | None = None
    _next: dict[int, tuple[Attempt, Term | None]] = field(default_factory=dict, repr=False, compare=False)

    def attempt(
        self,
        study: Study,
        terms: Sequence[Term],
        start: Mapping[str, float] | None = None,
        held: frozenset[str] = frozenset(),
    ) -> Attempt:
        """A model judged by this noise; `held` parameters stay at zero."""
        return Attempt(study, terms, start=start, known=self.known, held=held)

    def next_term(self, attempt: Attempt) -> Term | None:
        """What a search would add to a model first; None where it finds nothing that helps."""
        if self.search is not None and self.search.given == attempt.terms:
            return next((term for term in self.search.suggested), None)
        # A fit and a comparison of one version both ask, and each answer takes several fits.
        if id(attempt) not in self._next:
            search = Search(attempt.study, attempt.terms, LEVEL, attempt.seed, lambda _: None, self.known)
            search.adopt(attempt)
            self._next[id(attempt)] = (attempt, search.next_term())
        return self._next[id(attempt)][1]

    def as_document(self) -> dict[str, Any]:
        """What `recalled` needs."""
        return {"terms": [term.as_json() for term in self.richest.terms], "start": self.richest.values}


def account_of(
    study: Study,
    versions: Iterable[Sequence[Term]],
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Account:
    """The account of a study's data, given the terms of all versions of its model."""
    search = Search(study, _joint(study, versions), LEVEL, seed, progress or (lambda _: None))
    first = search.attempt(search.given)
    if not first.estimator.from_scatter:
        return Account(first, None, None)
    search.run()
    # A line of the samples changes none of the reduced data whose scatter tells the noise.
    lines = {id(line.term) for line in search.lines}
    estimated = _recallable(study, search, [term for term in search.terms if id(term) not in lines], seed)
    assert estimated.known is not None
    search.judged_by(estimated.known, estimated.richest)
    return Account(estimated.richest, estimated.known, search)


def _recallable(study: Study, search: Search, terms: Sequence[Term], seed: int) -> Account:
    """The account of a model by way of its document: the same whether just made or kept in a store."""
    try:
        return recalled(study, Account(search.attempt(terms), None).as_document(), seed)
    except UNFIT:
        # Fitted on the way, from where smaller models ended, but not from its own end: determined by a hair.
        if len(terms) == len(search.given):
            raise
        return _recallable(study, search, terms[:-1], seed)


def recalled(study: Study, document: Mapping[str, Any], seed: int = 0) -> Account:
    """The account that a store keeps."""
    terms = [Term(each["effect"], each["choice"]) for each in document["terms"]]
    richest = Attempt(study, terms, seed, start=document["start"])
    return Account(richest, _known(richest) if richest.estimator.from_scatter else None)


def _known(richest: Attempt) -> KnownNoise:
    breaks = any(breaks_level(richest, term.effect) for term in richest.terms)
    return KnownNoise(richest.noise, richest.estimator, richest.model.observations, breaks)


def _joint(study: Study, versions: Iterable[Sequence[Term]]) -> tuple[Term, ...]:
    """The terms of all versions as far as they can be fitted together; the first always."""
    joint: tuple[Term, ...] | None = None
    for terms in versions:
        if joint is None:
            joint = tuple(terms)
            continue
        for term in terms:
            if term not in joint and _can_be_fitted(study, (*joint, term)):
                # Terms that these data cannot tell apart are not fitted together: the earlier version's stays.
                joint = (*joint, term)
    return joint or ()


def _can_be_fitted(study: Study, terms: Sequence[Term]) -> bool:
    try:
        Attempt(study, terms)
    except UNFIT:
        return False
    return True
