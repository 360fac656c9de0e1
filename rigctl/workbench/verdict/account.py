"""One account of the noise of a store's data, by which all its models are judged.

Noise that comes from the scatter is estimated with everything in the model that is known or significant: the terms
of all versions, and what a search finds beside them. The search estimates the noise anew with every term it tries, so
that search and noise alternate until neither changes. The estimate depends on the data, the catalogue and the terms
of all versions, never on the version looked at. A version of terms that were found already changes nothing: what was
promised of them holds once they are added.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np

from rigctl.core.errors import UNFIT
from rigctl.workbench.study import Study, Term
from rigctl.workbench.verdict.attempt import Attempt, Ends
from rigctl.workbench.verdict.known_noise import KnownNoise
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.rather_than_noise import breaks_level
from rigctl.workbench.verdict.search import Search
from rigctl.workbench.verdict.shared import Shared
from rigctl.workbench.verdict.significance import significant_shape

LEVEL = 0.01
"""What is significant at this level, over all trials together, does not count as noise."""


ROUNDS = 3
"""Noise, and a search by that noise, until neither finds more; two are enough but for tables of few rows."""


@dataclass(frozen=True)
class Account:
    """The noise of a store's data: `richest` is the model it was estimated with.

    `known` is None where no noise comes from the scatter: then each model's data tell it by themselves.
    """

    richest: Attempt
    known: KnownNoise | None
    _searches: dict[Hashable, Search] = field(default_factory=dict, repr=False, compare=False)
    _plain: dict[Hashable, Attempt] = field(default_factory=dict, repr=False, compare=False)
    _shared: Shared = field(default_factory=Shared, repr=False, compare=False)

    def attempt(
        self,
        study: Study,
        terms: Sequence[Term],
        start: Mapping[str, float] | None = None,
        held: frozenset[str] = frozenset(),
    ) -> Attempt:
        """A model judged by this noise; `held` parameters stay at zero. One that starts where its study says is made
        once: a search begins with it, and its scores and trials are those that a comparison asks for."""
        if start or held or study is not self.richest.study:
            return Attempt(study, terms, start=start, known=self.known, held=held)
        key = tuple(term.key for term in terms)
        if key not in self._plain:
            if key == tuple(term.key for term in self.richest.terms):
                # Nothing more was found: the account's own fit is this model's, in this noise.
                self._plain[key] = self.richest.judged_by(self.known)
            else:
                self._plain[key] = Attempt(study, terms, self.richest.seed, self._shared, known=self.known)
        return self._plain[key]

    def search(
        self,
        study: Study,
        terms: Sequence[Term],
        alpha: float = LEVEL,
        seed: int = 0,
        progress: Callable[[str], None] | None = None,
        fitted: Attempt | None = None,
    ) -> Search:
        """What a model with these terms lacks, made once: a fit, a comparison and a diagnosis all ask.

        The search goes on from what was found when the noise was estimated. `fitted` is the model, where it is there.
        """
        key = (*(term.key for term in terms), alpha, seed)
        if key not in self._searches:
            shared = self._shared if study is self.richest.study else None
            search = Search(study, terms, alpha, seed, progress or (lambda _: None), self.known, shared)
            if fitted is not None:
                search.adopt(fitted)
            if self.known is None:
                search.run()
            else:
                search.run_from(self.richest)
            self._searches[key] = search
        return self._searches[key]

    def next_term(self, attempt: Attempt) -> Term | None:
        """What a diagnosis would name first that a model lacks; None where it finds nothing that helps."""
        search = self.search(attempt.study, attempt.terms, seed=attempt.seed, fitted=attempt)
        return next(iter(search.suggested), None)

    def covers(self, terms: Iterable[Term]) -> bool:
        """Whether the noise was estimated with all of these terms in the model."""
        return all(term in self.richest.terms for term in terms)

    def as_document(self) -> dict[str, Any]:
        """What `recalled` needs."""
        ends = self.richest.ends
        return {
            "terms": [term.as_json() for term in self.richest.terms],
            "ends": [dict(values) for values in ends.values],
            "held": sorted(ends.held),
        }


def account_of(
    study: Study,
    versions: Sequence[Sequence[Term]],
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    earlier: tuple[int, Account] | None = None,
) -> Account:
    """The account of a study's data, given the terms of all versions of its model; `earlier` is that of so many."""
    count, account = earlier or (0, None)
    for number, terms in enumerate(versions, start=1):
        if number > count and (account is None or not account.covers(terms)):
            account = _searched(study, _joint(study, versions[:number]), seed, progress)
    assert account is not None
    return account


def _searched(study: Study, joint: Sequence[Term], seed: int, progress: Callable[[str], None] | None) -> Account:
    """The account of a model with these terms and what a search finds beside them."""
    shared = Shared()
    account, found = _first(study, joint, seed, progress, shared)
    if account.known is None:
        return account
    sets = [found]
    for _ in range(ROUNDS):
        again = account.search(study, joint, seed=seed, progress=progress, fitted=account.attempt(study, joint))
        # What is not needed beside the others is no part of the account, unless without it it is found again.
        if again.found == sets[-1] or (account.covers(again.found) and again.found in sets):
            break
        account = _account_with(study, joint, again.found, again, shared)
        sets.append(again.found)
    return account


def _first(
    study: Study, joint: Sequence[Term], seed: int, progress: Callable[[str], None] | None, shared: Shared
) -> tuple[Account, tuple[Term, ...]]:
    """The account of what is found where every model is judged by the noise that it leaves, and what that is."""
    search = Search(study, joint, LEVEL, seed, progress or (lambda _: None), shared=shared)
    first = search.attempt(search.given)
    if not first.estimator.from_scatter:
        return Account(first, None, _shared=shared), ()
    search.run()
    return _account_with(study, joint, search.found, search, shared), search.found


def _account_with(
    study: Study, joint: Sequence[Term], found: Sequence[Term], search: Search, shared: Shared
) -> Account:
    """The account of a model that a search has found."""
    try:
        made = search.attempt((*joint, *found))
        if search.knows_noise:
            # Its fit was judged by the noise of the account before.
            made = Attempt(study, made.terms, search.seed, shared, start=made.values)
        return _account(made, shared)
    except UNFIT:
        # Fitted on the way, from where smaller models ended, but not from its own end: determined by a hair.
        if not found:
            raise
        return _account_with(study, joint, found[:-1], search, shared)


def recalled(study: Study, document: Mapping[str, Any], seed: int = 0) -> Account:
    """The account that a store keeps: the same as when it was made."""
    shared, terms = Shared(), [Term(each["effect"], each["choice"]) for each in document["terms"]]
    ended = Ends(tuple(document["ends"]), frozenset(document["held"]))
    return _account(Attempt(study, terms, seed, shared, ended=ended), shared)


def _account(richest: Attempt, shared: Shared) -> Account:
    return Account(richest, _known(richest) if richest.estimator.from_scatter else None, _shared=shared)


def _known(richest: Attempt) -> KnownNoise:
    breaks = any(breaks_level(richest, term.effect) for term in richest.terms)
    given = richest.model.observations
    return KnownNoise(richest.noise, richest.estimator, given, cache(partial(_beside_fit, richest)), breaks)


def _beside_fit(richest: Attempt) -> Noise:
    """What parameters are uncertain by: what is hidden is no noise, whether an effect or a shape describes it."""
    shape = significant_shape(richest, LEVEL)
    return richest.noise_beside(np.zeros((len(richest.result.residuals), 0)) if shape is None else shape.columns)


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
