"""Which physical effect is missing: candidates ranked with their sizes, and the verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import optimize, stats

from rigctl.workbench.findings import Diagnosis, Estimate, Inseparable, Rank, Step, Unexplained, Verdict
from rigctl.workbench.study import DeclaresInseparable, Line, Study, Term
from rigctl.workbench.threads import one_thread
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.description import described
from rigctl.workbench.verdict.fitted_model import held_out_ratio
from rigctl.workbench.verdict.rivals import Rival, rivals_of
from rigctl.workbench.verdict.score import ABSORBED, contained, likeness
from rigctl.workbench.verdict.search import Search
from rigctl.workbench.verdict.significance import CATALOGUE_SHARE, corrected_for

SAME = 0.99
"""Canonical correlation above which two effects are one class: these data cannot tell them apart."""

TOLD_APART = 30.0
"""Difference of the falls of chi-square above which one of two alike effects is not the other, however alike."""

POWER = 0.95

HELD_OUT = 10
"""For so many of the effects that were not suggested the held-out error is worked out, the likeliest first."""

_SHARE = 0.3


@one_thread
def diagnose(
    study: Study,
    terms: Sequence[Term],
    alpha: float = 0.01,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Test every effect of the catalogue against what the model with `terms` leaves, and sets of them.

    `alpha` is the level over all trials together; `seed` fixes the draws behind corrected p-values; `progress` is
    told what is being done.
    """
    search = Search(study, terms, alpha, seed, progress or (lambda _: None))
    search.run()
    alike = [rival for term in search.suggested for rival in rivals_of(search, term)]
    rivals = [each for each in alike if not each.wider]
    first, final = search.attempt(search.given), search.attempt(search.terms)
    unexplained = None
    if search.unexplained is not None:
        score = final.projector.score(final.whitened_columns(search.unexplained.columns))
        unexplained = described(final.model.observations, search.unexplained, score)
    return Diagnosis(
        verdict=_verdict(search, rivals, unexplained),
        alpha=alpha,
        terms=search.given,
        suggested=_by_significance(search, rivals),
        ranking=_ranking(search, alike),
        inseparable=_inseparable(first),
        unexplained=unexplained,
        not_testable={each.effect: each.reason for each in first.not_testable},
        steps=tuple(_steps(search)),
        n_eff=first.n_eff,
    )


def _verdict(search: Search, rivals: Sequence[Rival], unexplained: Unexplained | None) -> Verdict:
    if unexplained is not None:
        return "unknown"
    if not search.suggested:
        return "adequate"
    return "ambiguous" if rivals else "effect"


def _by_significance(search: Search, rivals: Sequence[Rival]) -> tuple[Term, ...]:
    """What was found, the most significant first, each followed by rivals of other classes."""
    suggested: list[Term] = []
    p_values = {term.effect: _p_of(search, term) for term in search.suggested}
    for term in sorted(search.suggested, key=lambda term: p_values[term.effect]):
        alternatives = [term, *(rival.term for rival in rivals if rival.instead_of == term.effect)]
        for simplest in _simplest_of_classes(search, term, alternatives):
            if simplest not in suggested:
                suggested.append(simplest)
    return tuple(suggested)


def _simplest_of_classes(search: Search, term: Term, alternatives: Sequence[Term]) -> list[Term]:
    """One of each class of alternatives: fewest parameters, then the catalogue's order."""
    without = search.attempt([each for each in search.terms if each != term])
    scores = {each.candidate.term.effect: each for each in without.scored}
    order = list(search.study.effects())

    def simplicity(each: Term) -> tuple[int, int]:
        place = order.index(each.effect) if each.effect in order else len(order)
        return len(scores[each.effect].candidate.names), place

    classes: list[list[Term]] = []
    for each in alternatives:
        if each.effect not in scores:
            return [term]
        basis = scores[each.effect].score.basis
        for members in classes:
            if likeness(scores[members[0].effect].score.basis, basis) > SAME:
                members.append(each)
                break
        else:
            classes.append([each])
    return [min(members, key=simplicity) for members in classes]


def _p_of(search: Search, term: Term) -> float:
    for line in search.lines:
        if line.term == term:
            return line.p_value
    return search.p_of_term(search.terms, term)


def _ranking(search: Search, rivals: Sequence[Rival]) -> tuple[Rank, ...]:
    """What was suggested with its refitted size, then everything else against what is left."""
    first, final = search.attempt(search.given), search.attempt(search.terms)
    ranks = []
    lines = {line.term.effect: line for line in search.lines}
    for term in search.suggested:
        if term.effect in lines:
            ranks.append(_rank_of_line(lines[term.effect]))
        else:
            ranks.append(_rank_of_suggested(search, first, final, term, rivals))
    ranks.sort(key=lambda rank: rank.p_value)
    others = sorted(final.scored, key=lambda each: (each.score.p_value, -each.score.statistic))
    others = [each for each in others if each.candidate.term.effect not in {rank.term.effect for rank in ranks}]
    for place, scored in enumerate(others):
        ranks.append(_rank_of_other(search, final, scored, held_out=place < HELD_OUT))
    return tuple(ranks)


def _rank_of_suggested(search: Search, first: Attempt, final: Attempt, term: Term, rivals: Sequence[Rival]) -> Rank:
    without = search.attempt([each for each in search.terms if each != term])
    p_value = search.p_of_term(search.terms, term)
    estimates = {
        name: estimate
        for (name, estimate), owner in zip(final.estimates().items(), final.model.owners, strict=True)
        if owner == term.effect
    }
    scored = without.scored_effect(term.effect)
    equivalent = [rival.term.effect for rival in rivals if rival.instead_of == term.effect]
    if scored is not None:
        equivalent += [name for name in _classmates(without, scored) if name not in equivalent]
    return Rank(
        term=term,
        p_value=p_value,
        p_value_corrected=corrected_for(first, p_value),
        parameters=estimates,
        held_out_error_ratio=held_out_ratio(final, without),
        equivalent_to=tuple(equivalent),
        statistic=without.chi2_with(final.noise) - final.result.chi2,
        keep=float(scored.score.keep.max()) if scored is not None else float("nan"),
        detectable=_detectable(without, scored, search.alpha) if scored is not None else {},
    )


def _rank_of_other(search: Search, final: Attempt, scored: Scored, *, held_out: bool) -> Rank:
    score = scored.score
    columns = final.columns(scored.candidate)
    given = final.model.observations
    strength = np.zeros(len(given.series))
    np.add.at(strength, given.series_of, np.sum(columns[: len(given.value)] ** 2, axis=1))
    touched = np.flatnonzero(strength > 1e-3 * strength.max())
    ratio = float("nan")
    if held_out and score.dimension and final.held_out.possible:
        ratio = final.held_out.error(score.basis, touched) / final.held_out.error(series=touched)
    return Rank(
        term=scored.candidate.term,
        p_value=score.p_value,
        p_value_corrected=corrected_for(final, score.p_value),
        parameters={
            name: Estimate(float(value), float(sigma), unit)
            for name, value, sigma, unit in zip(
                scored.candidate.names, score.estimate, score.sigma, scored.candidate.units, strict=True
            )
        },
        held_out_error_ratio=ratio,
        equivalent_to=tuple(_classmates(final, scored)),
        statistic=score.statistic,
        keep=float(score.keep.max()),
        detectable=_detectable(final, scored, search.alpha),
    )


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


def _classmates(attempt: Attempt, scored: Scored) -> list[str]:
    """Effects these data cannot tell from this one, and parameters of the baseline that absorb it."""
    if not scored.score.dimension:
        return list(_absorbers(attempt, scored))
    return [other.candidate.term.effect for other in attempt.scored if other is not scored and _one(scored, other)]


def _one(a: Scored, b: Scored) -> bool:
    """Whether two effects do the same to these data: their spans coincide, neither explains more of what is left."""
    same = a.score.dimension == b.score.dimension > 0 and abs(a.score.statistic - b.score.statistic) < TOLD_APART
    return same and contained(a.score.basis, b.score.basis) > SAME


def _inseparable(attempt: Attempt) -> tuple[Inseparable, ...]:
    """Effects absorbed by fitted parameters, and pairs of effects that are one."""
    inseparable = []
    for scored in attempt.scored:
        effect = scored.candidate.term.effect
        if scored.score.keep.min() < ABSORBED:
            for name, shift in _absorbers(attempt, scored).items():
                inseparable.append(Inseparable(effect, name, shift))
    if isinstance(attempt.study, DeclaresInseparable):
        known = {(each.effect, each.other) for each in inseparable}
        for effect, names in attempt.study.inseparable().items():
            pairs = [(effect, f"baseline:{name}") for name in names]
            inseparable += [Inseparable(*pair) for pair in pairs if pair not in known]
    for number, a in enumerate(attempt.scored):
        for b in attempt.scored[number + 1 :]:
            if _one(a, b):
                inseparable.append(Inseparable(a.candidate.term.effect, b.candidate.term.effect))
    return tuple(inseparable)


def _absorbers(attempt: Attempt, scored: Scored) -> dict[str, str]:
    """Fitted parameters that imitate the absorbed columns of a candidate, with what its typical size does to them."""
    absorbed = scored.score.keep < ABSORBED
    typical = np.where(absorbed, scored.candidate.typical, 0.0)
    column = attempt.columns(scored.candidate) @ typical
    shift, *_ = np.linalg.lstsq(attempt.jacobian, column, rcond=1e-10)
    strength = np.abs(shift) * np.linalg.norm(attempt.jacobian, axis=0)
    shifts: dict[str, str] = {}
    for where in np.argsort(-strength):
        if strength[where] < _SHARE * strength.max() or not strength[where] > 0.0:
            break
        name = attempt.model.owners[where] or f"baseline:{attempt.names[where].partition('[')[0]}"
        if name not in shifts:
            shifts[name] = (
                f"its typical size moves {attempt.names[where]} by {shift[where]:.3g}{_unit(attempt, where)}"
            )
    return shifts


def _unit(attempt: Attempt, where: np.intp) -> str:
    unit = attempt.model.units[int(where)]
    return f" {unit}" if unit not in {"", "1"} else ""


def _detectable(attempt: Attempt, scored: Scored, alpha: float) -> dict[str, float]:
    """Size of each parameter that would have been significant with power 0.95 (noncentral chi-square)."""
    d = scored.score.dimension
    if not d:
        return {}
    level = -np.expm1(np.log1p(-CATALOGUE_SHARE * alpha) / attempt.n_eff)
    threshold = stats.chi2.isf(level, d)
    needed = optimize.brentq(lambda size: stats.ncx2.sf(threshold, d, size) - POWER, 1e-3, 1e4)
    return {
        name: float(np.sqrt(needed) * sigma)
        for name, sigma in zip(scored.candidate.names, scored.score.sigma, strict=True)
        if np.isfinite(sigma)
    }


def _steps(search: Search) -> list[Step]:
    steps = []
    for move in search.moves:
        attempt = search.attempt(move.terms)
        steps.append(
            Step(
                move.terms,
                move.added,
                move.dropped,
                attempt.result.chi2_per_dof,
                attempt.chi2_p_value(),
                attempt.error(),
                attempt.held_out.error(),
            )
        )
    return steps
