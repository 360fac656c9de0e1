"""Every effect of the catalogue as it stands beside the model that a search ended with."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy import special

from rigctl.core.arrays import IntArray
from rigctl.workbench.findings import Estimate, Rank
from rigctl.workbench.study import Line, Term
from rigctl.workbench.verdict.alike import equivalent_effects
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.fitted_model import held_out_ratio
from rigctl.workbench.verdict.held_out import error_ratio
from rigctl.workbench.verdict.rivals import Rival
from rigctl.workbench.verdict.search import Search
from rigctl.workbench.verdict.significance import CATALOGUE_SHARE, corrected_for, p_of_scored

POWER = 0.95

HELD_OUT = 10
"""For so many of the effects that were not suggested the held-out error is worked out, the likeliest first."""


def ranking(search: Search, rivals: Sequence[Rival]) -> tuple[Rank, ...]:
    """What was suggested with its refitted size, then everything else against what is left."""
    final = search.attempt(search.terms)
    ranks = []
    lines = {line.term.key: line for line in search.lines}
    for term in search.suggested:
        if term.key in lines:
            ranks.append(_rank_of_line(lines[term.key]))
        else:
            ranks.append(_rank_of_suggested(search, final, term, rivals))
    ranks.sort(key=lambda rank: rank.p_value)
    there = {term.effect for term in final.terms}
    # As the search judged them: one that it left out because chance shows as much is not listed as significant.
    others = [(p_of_scored(final, each), each) for each in final.scored if each.candidate.term.effect not in there]
    others.sort(key=lambda each: (each[0], -each[1].score.statistic))
    for place, (p_value, scored) in enumerate(others):
        ranks.append(_rank_of_other(search, final, scored, p_value, held_out=place < HELD_OUT))
    return tuple(ranks)


def _rank_of_suggested(search: Search, final: Attempt, term: Term, rivals: Sequence[Rival]) -> Rank:
    without = search.attempt_if_fit([each for each in search.terms if each != term])
    p_value = search.p_of_term(search.terms, term)
    estimates = {
        name: estimate
        for (name, estimate), owner in zip(final.estimates().items(), final.model.owners, strict=True)
        if owner == term.effect
    }
    scored = None if without is None else without.scored_effect(term.effect)
    equivalent = [rival.term.effect for rival in rivals if rival.instead_of == term.effect]
    if without is not None and scored is not None:
        equivalent += [name for name in equivalent_effects(without, scored) if name not in equivalent]
    return Rank(
        term=term,
        p_value=p_value,
        p_value_corrected=search.corrected_p_of_term(search.terms, term),
        parameters=estimates,
        held_out_error_ratio=float("nan") if without is None else held_out_ratio(final, without),
        equivalent_to=tuple(equivalent),
        statistic=float("nan") if without is None else without.chi2_with(final.noise) - final.result.chi2,
        keep=float(scored.score.keep.max()) if scored is not None else float("nan"),
        detectable=detectable(without, scored, search.alpha) if without is not None and scored is not None else {},
    )


def _rank_of_other(search: Search, final: Attempt, scored: Scored, p_value: float, *, held_out: bool) -> Rank:
    score, touched = scored.score, _touched(final, scored)
    ratio = float("nan")
    if held_out and score.dimension and final.held_out.possible:
        ratio = error_ratio(final.held_out.error(score.basis, touched), final.held_out.error(series=touched))
    return Rank(
        term=scored.candidate.term,
        p_value=p_value,
        p_value_corrected=corrected_for(final, p_value, scored.candidate.term.effect),
        parameters={
            name: Estimate(float(value), float(sigma), unit)
            for name, value, sigma, unit in zip(
                scored.candidate.names, score.estimate, score.sigma, scored.candidate.units, strict=True
            )
        },
        held_out_error_ratio=ratio,
        equivalent_to=tuple(equivalent_effects(final, scored)),
        statistic=score.statistic,
        keep=float(score.keep.max()),
        detectable=detectable(final, scored, search.alpha),
    )


def _touched(final: Attempt, scored: Scored) -> IntArray:
    """The series that an effect changes: the error over all of them would hide one that touches two of thirty."""
    given = final.model.observations
    if len(given.series) == 1:
        return np.zeros(1, dtype=np.intp)
    columns, strength = final.columns(scored.candidate), np.zeros(len(given.series))
    np.add.at(strength, given.series_of, np.sum(columns[: len(given.value)] ** 2, axis=1))
    return np.flatnonzero(strength > 1e-3 * strength.max())


def _rank_of_line(line: Line) -> Rank:
    return Rank(
        term=line.term,
        p_value=line.p_value,
        p_value_corrected=line.p_value,
        parameters={
            name: Estimate(float(each["value"]), float(each["sigma"]), str(each["unit"]))
            for name, each in line.parameters.items()
        },
        held_out_error_ratio=line.held_out_error_ratio,
        equivalent_to=(),
        statistic=(line.amplitude / line.sigma) ** 2,
        keep=1.0,
        detectable={},
    )


def detectable(attempt: Attempt, scored: Scored, alpha: float) -> dict[str, float]:
    """Size of each parameter that would have been significant with power 0.95 (noncentral chi-square)."""
    d = scored.score.dimension
    if not d:
        return {}
    # Of one trial: the inverse of `score.corrected`.
    level = -np.expm1(np.log1p(-CATALOGUE_SHARE * alpha) / attempt.trials_of(scored.candidate.term.effect))
    needed = _noncentrality(d, float(level))
    return {
        name: float(np.sqrt(needed) * sigma)
        for name, sigma in zip(scored.candidate.names, scored.score.sigma, strict=True)
        if np.isfinite(sigma)
    }


@lru_cache(maxsize=64)
def _noncentrality(d: int, level: float) -> float:
    """With which a chi-square of d degrees of freedom is significant at a level with power 0.95."""
    threshold = special.chdtri(d, level)
    return float(special.chndtrinc(threshold, d, 1.0 - POWER))
