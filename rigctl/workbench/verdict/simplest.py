"""Of effects that describe the data equally well the simplest is named: the others are its alternatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rigctl.analysis.column_sums import LARGE
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.first_order import found_at_least
from rigctl.workbench.verdict.score import p_of
from rigctl.workbench.verdict.significance import is_adequate, is_significant

NEAR_TIE = 1.0
"""Difference of log evidence that is no reason to prefer the larger: a Bayes factor below e is "not worth more than a
bare mention" (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773)."""

RIVAL_LEVEL = 0.5
"""Share of the level at which a rival is rejected as a substitute: one question, not many."""

Fit = Callable[[Sequence[Term]], Attempt | None]
"""A model with these terms; None where these data do not determine it."""


def substituted(fit: Fit, without: Attempt, rival: Scored, found: Scored, alpha: float) -> Attempt | None:
    """The model with a rival instead of what was found; None when that, or anything else, is needed beside it.

    Both are candidates beside the model `without` them.
    """
    if _is_needed_beside(without, rival, found, alpha):
        return None
    instead = fit((*without.terms, rival.candidate.term))
    if instead is None:
        return None
    beside = instead.scored_effect(found.candidate.term.effect)
    # Beside a substitute that does all it does, nothing of the effect that was found is left to be significant.
    if beside is not None and beside.score.dimension and beside.score.p_value < RIVAL_LEVEL * alpha:
        return None
    return instead if is_adequate(instead, alpha) else None


def _is_needed_beside(without: Attempt, rival: Scored, found: Scored, alpha: float) -> bool:
    """Whether what was found is significant beside the rival whatever a fit of both finds."""
    both = without.projector.score(np.hstack([without.columns(each.candidate) for each in (rival, found)]))
    dimension = both.dimension - rival.score.dimension
    left = found_at_least(max(both.statistic - rival.score.statistic, 0.0), found.score.statistic)
    return dimension > 0 and float(p_of(left, dimension, both.dof)) < RIVAL_LEVEL * alpha


def most_evident_first(attempt: Attempt, candidates: Sequence[Scored]) -> list[Scored]:
    """By evidence; but a detail of what the model has, a harmonic, after every effect of its own that explains more.

    A harmonic has no scan to pay for, and would take the place of another period that does more.
    """
    there = {term.effect for term in attempt.terms}
    own = [each for each in candidates if each.candidate.term.effect not in there]
    most = max((each.score.statistic for each in own), default=0.0)

    def is_detail(each: Scored) -> bool:
        return each.candidate.term.effect in there and each.score.statistic < most

    return sorted(candidates, key=lambda each: (is_detail(each), -attempt.evidence(each)))


def alternatives(attempt: Attempt) -> list[Scored]:
    """Candidates that are effects of their own, and not more of one that the model has."""
    there = {term.effect for term in attempt.terms}
    return [each for each in attempt.scored if each.candidate.term.effect not in there]


def simplest(fit: Fit, terms: Sequence[Term], term: Term, alpha: float) -> Term:
    """The simplest effect that does instead of a `term` of the model with hardly less evidence; else the term itself.

    Simpler is what has fewer parameters, one that was scanned for among them, then what comes first in the catalogue.
    """
    best = fit(terms)
    # In a long table the candidates cost more than the fit that they might spare.
    if best is None or (len(best.left) <= LARGE and best.p_beside_others(term.effect) < RIVAL_LEVEL * alpha):
        return term
    others = tuple(each for each in terms if each != term)
    without = fit(others)
    found = None if without is None else without.scored_effect(term.effect)
    if without is None or found is None:
        return term
    catalogue = list(without.study.effects())
    least = without.evidence(found) - NEAR_TIE
    simpler = [each for each in alternatives(without) if each.score.dimension and without.evidence(each) >= least]
    for each in sorted(simpler, key=lambda one: _simplicity(one, catalogue)):
        if _simplicity(each, catalogue) >= _simplicity(found, catalogue):
            break
        # A break of the level may be there on other grounds, beside noise in which nothing is significant.
        if not is_significant(without, each, alpha):
            continue
        instead = substituted(fit, without, each, found, alpha)
        # Scores are of first order: what counts is the fit, by one noise and less the price.
        if (
            instead is not None
            and _cost(without, instead, best, each) <= _cost(without, best, best, found) + NEAR_TIE
        ):
            return each.candidate.term
    return term


def _cost(without: Attempt, fitted: Attempt, best: Attempt, scored: Scored) -> float:
    """Minus the log evidence of a fitted model, by the noise of the best."""
    return 0.5 * fitted.chi2_with(best.noise) + without.price(scored)


def _simplicity(scored: Scored, catalogue: Sequence[str]) -> tuple[int, int]:
    kind = scored.candidate.term.effect.partition("#")[0]
    place = catalogue.index(kind) if kind in catalogue else len(catalogue)
    return scored.score.dimension + scored.candidate.scanned, place
