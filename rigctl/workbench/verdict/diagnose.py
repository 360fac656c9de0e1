"""Which physical effect is missing: candidates ranked with their sizes, and the verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise

from rigctl.core.errors import UNFIT
from rigctl.core.threads import one_thread
from rigctl.workbench.findings import Diagnosis, JointFit, Step, Unexplained, Verdict
from rigctl.workbench.study import Study, Term
from rigctl.workbench.verdict.account import LEVEL, Account, account_of
from rigctl.workbench.verdict.adequacy import p_as_a_whole
from rigctl.workbench.verdict.alike import inseparable_effects
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.description import described
from rigctl.workbench.verdict.far_reading import far_reading
from rigctl.workbench.verdict.fit import rms_by_channel
from rigctl.workbench.verdict.impossible import OfOneSign, impossible_parameters
from rigctl.workbench.verdict.lack_of_fit import lack_of_fit, unexplained_as_a_whole, unexplained_between_settings
from rigctl.workbench.verdict.likelihood import maximum_likelihood
from rigctl.workbench.verdict.noise_entries import noise_entries
from rigctl.workbench.verdict.ranking import ranking
from rigctl.workbench.verdict.rather_than_noise import breaks_level, is_noise_instead
from rigctl.workbench.verdict.rivals import rivals_of
from rigctl.workbench.verdict.search import Search
from rigctl.workbench.verdict.significance import REPEATS_SHARE
from rigctl.workbench.verdict.slow_noise import hidden_in_slow_noise
from rigctl.workbench.verdict.stated_sigma import stated_sigma
from rigctl.workbench.verdict.uneven_scatter import uneven_scatter


@one_thread
def diagnose(
    study: Study,
    terms: Sequence[Term],
    alpha: float = 0.01,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    account: Account | None = None,
    fitted: Attempt | None = None,
) -> Diagnosis:
    """Test every effect of the catalogue against what the model with `terms` leaves, and sets of them.

    `alpha` is the level over all trials together; `seed` fixes the draws behind corrected p-values; `progress` is
    told what is being done; `account` is the noise of the data, by default as these terms alone tell it; `fitted` is
    the model, where it has been fitted.
    """
    account = account or account_of(study, [terms], seed, progress)
    search = account.search(study, terms, alpha, seed, progress, fitted)
    alike = [rival for term in search.suggested for rival in rivals_of(search, term)]
    # What contains the found effect can always do as well: it may be the truth, but makes nothing ambiguous.
    rivals = any(not each.wider for each in alike)
    first, final = search.attempt(search.given), search.attempt(search.terms)
    suggested = _in_order(search)
    unexplained = None
    if search.unexplained is not None:
        # Scored again: its size is that beside all that was found.
        score = final.projector.score(final.whitened_columns(search.unexplained.described_columns))
        unexplained = described(final.model.observations, search.unexplained, score)
    elif (lack := lack_of_fit(final)) is not None and lack.p_value < REPEATS_SHARE * alpha:
        unexplained = unexplained_between_settings(lack)
    elif (p_value := p_as_a_whole(final, lack)) < alpha:
        unexplained = unexplained_as_a_whole(final, p_value)
    or_noise, given = _or_noise(search, alpha, seed), {term.effect for term in search.given}
    return Diagnosis(
        verdict=_verdict(search, rivals or any(effect not in given for effect, _ in or_noise), unexplained),
        alpha=alpha,
        terms=search.given,
        suggested=suggested,
        ranking=ranking(search, alike),
        # By the model that was asked about: what absorbs an effect there makes the result uncertain.
        inseparable=inseparable_effects(first),
        unexplained=unexplained,
        not_testable={each.effect: each.reason for each in first.not_testable},
        impossible=_impossible_effects(search),
        steps=tuple(_steps(search)),
        n_eff=first.trials.all,
        noise=noise_entries(first),
        joint_fit=_joint_fit(search, suggested) if suggested else None,
        hidden_in_slow_noise=hidden_in_slow_noise(final, alpha),
        or_correlated_noise=or_noise,
        scatter=uneven_scatter(account.richest, LEVEL),
        # Uncertainties that stay as stated are told by chi-square, which what was found has a part in.
        stated_sigma=stated_sigma(final if account.known is None else account.richest),
        far_reading=far_reading(account.richest),
        excluded=first.model.observations.excluded,
    )


def _joint_fit(search: Search, suggested: Sequence[Term]) -> JointFit:
    """What is suggested as `fit` fits it."""
    first, final = search.attempt(search.given), search.attempt((*search.given, *suggested))
    return JointFit(
        terms=tuple(suggested),
        chi2_fall=first.result.chi2 - final.result.chi2,
        minus_2_log_l=maximum_likelihood(final, final.estimator).minus_2_log_l,
        parameters=final.estimates(),
        held=tuple(sorted(final.held)),
    )


def _or_noise(search: Search, alpha: float, seed: int) -> tuple[tuple[str, str], ...]:
    """What was given or found where correlated noise does as well: the effect, and the order along which."""
    study, terms = search.study, search.terms
    breaks = [term for term in terms if breaks_level(search.attempt(terms), term.effect)]
    asked = ((term.effect, is_noise_instead(study, terms, term, alpha, seed)) for term in breaks)
    return tuple((effect, order) for effect, order in asked if order is not None)


def _impossible_effects(search: Search) -> dict[str, str]:
    """By effect, why what is significant beside the given terms is not what the data show."""
    first = search.attempt(search.given)
    reasons: dict[str, str] = {}
    if not isinstance(first.model, OfOneSign):
        return reasons
    for each in first.scored:
        effect = each.candidate.term.effect
        if first.corrected(each.score.p_value, effect) >= search.alpha:
            continue
        with suppress(*UNFIT):
            with_it = search.attempt((*search.given, each.candidate.term))
            names = impossible_parameters(with_it, {effect}, search.alpha)
            found = {name: with_it.estimates()[name] for name in names}
            told = [f"{name} = {one.value:.3g} ± {one.sigma:.2g} {one.unit}" for name, one in found.items()]
            if told:
                reasons[effect] = f"{', '.join(told)}: never negative"
    return reasons


def _verdict(search: Search, ambiguous: bool, unexplained: Unexplained | None) -> Verdict:
    if unexplained is not None:
        return "unknown"
    if not search.suggested:
        return "adequate"
    return "ambiguous" if ambiguous else "effect"


def _in_order(search: Search) -> tuple[Term, ...]:
    """What was found, the most significant first; where errors would not fall from version to version, each next is
    what then takes most."""
    found = tuple(sorted(search.suggested, key=lambda term: _p_of(search, term)))
    return found if _errors_fall(search, found) else _greedily(search, found)


def _errors_fall(search: Search, terms: Sequence[Term]) -> bool:
    """Whether each of the terms, one after the other, lowers every error that the ladder has of the fit."""
    if len(terms) < 2:
        return True
    tried = [search.attempt_if_fit((*search.given, *terms[:count])) for count in range(len(terms) + 1)]
    errors = [_errors(each) for each in tried if each is not None]
    return all(after < before for pair in pairwise(errors) for before, after in zip(*pair, strict=True))


def _errors(attempt: Attempt) -> tuple[float, ...]:
    """In units of the noise, on the data of the fit and on those held out, and in the unit of the only channel."""
    rms = rms_by_channel(attempt)
    # Of several channels an effect need not lower each.
    in_unit = [each.value for each in rms.values()] if len(rms) == 1 else []
    return attempt.error(), attempt.held_out_error, *in_unit


def _greedily(search: Search, terms: Sequence[Term]) -> tuple[Term, ...]:
    """The terms in an order in which each next leaves the least chi-square."""

    def left(term: Term) -> float:
        attempt = search.attempt_if_fit((*search.given, *ordered, term))
        return float("inf") if attempt is None else attempt.result.chi2

    ordered: list[Term] = []
    waiting = list(terms)
    while waiting:
        ordered.append(min(waiting, key=left))
        waiting.remove(ordered[-1])
    return tuple(ordered)


def _p_of(search: Search, term: Term) -> float:
    for line in search.lines:
        if line.term == term:
            return line.p_value
    return search.p_of_term(search.terms, term)


def _steps(search: Search) -> list[Step]:
    steps = []
    for move in search.moves:
        attempt = search.attempt_if_fit(move.terms)
        if attempt is None:
            continue
        steps.append(
            Step(
                move.terms,
                move.added,
                move.dropped,
                attempt.result.chi2_per_dof,
                attempt.chi2_p_value(),
                attempt.error(),
                attempt.held_out_error,
            )
        )
    return steps
