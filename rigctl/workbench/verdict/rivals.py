"""Which other effects explain the data as well as one that a search has found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.noise import orthonormal
from rigctl.workbench.verdict.score import Projector, contained
from rigctl.workbench.verdict.search import Search
from rigctl.workbench.verdict.simplest import alternatives, substituted

_CONTAINED = 0.99
_LEAST_STATISTIC = 0.25
"""Of the found effect's: what explains less is no rival."""


@dataclass(frozen=True)
class Rival:
    """`term` explains the data as well as the suggested `instead_of`; `wider`: it can do all that does, and more."""

    instead_of: str
    term: Term
    wider: bool


def rivals_of(search: Search, term: Term) -> list[Rival]:
    """Other effects that would do instead of a suggested one: with them in, neither it nor more is needed."""
    others = tuple(each for each in search.terms if each != term)
    without = search.attempt_if_fit(others)
    suggested = None if without is None else without.scored_effect(term.effect)
    if without is None or suggested is None:
        return []
    rivals = []
    for each in alternatives(without):
        effect = each.candidate.term.effect
        if effect == term.effect or not each.score.dimension:
            continue
        if each.score.statistic < _LEAST_STATISTIC * suggested.score.statistic:
            continue
        instead = substituted(search.attempt_if_fit, without, each, suggested, search.alpha)
        if instead is not None:
            # In the model, what was scanned for is a parameter too.
            size = sum(owner == term.effect for owner in search.attempt(search.terms).model.owners)
            wider = _contains(instead, effect, suggested, max(size, len(suggested.candidate.names)))
            rivals.append(Rival(term.effect, each.candidate.term, wider))
    return rivals


def _contains(attempt: Attempt, effect: str, simpler: Scored, parameters: int) -> bool:
    """Whether an effect has more parameters than another's, whose doing it can imitate entirely.

    A candidate's columns are its amplitudes: what is scanned for counts as a parameter once it is in a model.
    """
    columns = [i for i, owner in enumerate(attempt.model.owners) if owner == effect]
    if len(columns) <= parameters:
        return False
    rest = np.delete(attempt.jacobian, columns, axis=1)
    others = Projector(rest, attempt.left, attempt.noise.dof, len(attempt.noise.dof))
    span = orthonormal(others.free(attempt.jacobian[:, columns]), 1e-6)
    inner = orthonormal(others.free(attempt.columns(simpler.candidate)), 1e-6)
    return contained(inner, span) > _CONTAINED
