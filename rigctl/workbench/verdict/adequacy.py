"""How striking is what a model leaves? The question of `compare`, and the first that a diagnosis asks."""

from __future__ import annotations

from rigctl.workbench.scatter import LackOfFit
from rigctl.workbench.verdict.account import LEVEL, Account
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.lack_of_fit import lack_of_fit
from rigctl.workbench.verdict.rather_than_noise import breaks_level
from rigctl.workbench.verdict.significance import (
    CATALOGUE_SHARE,
    LINES_SHARE,
    REPEATS_SHARE,
    SHAPES_SHARE,
    p_of_scored,
    p_of_shape,
)


def adequacy(attempt: Attempt, account: Account) -> float:
    """The probability that noise alone leaves something as striking; NaN without degrees of freedom.

    Asked are chi-square as a whole, every effect of the catalogue and every plain shape, at the shares of the level
    that a diagnosis gives them: what one finds, the other does not call noise. An effect that a search would not add,
    for it predicts held-out data no better, counts for nothing here too.
    """
    if attempt.result.dof <= 0:
        return float("nan")
    effects = _of_effects(attempt, account)
    lack = lack_of_fit(attempt)
    asked = (
        p_as_a_whole(attempt, lack),
        1.0 if lack is None else lack.p_value / REPEATS_SHARE,
        effects / CATALOGUE_SHARE,
        p_of_shape(attempt) / SHAPES_SHARE,
    )
    return min(1.0, *asked)


def p_as_a_whole(attempt: Attempt, lack: LackOfFit | None) -> float:
    """Of chi-square at its share of the level.

    Lines are looked for in the samples, and their share is free for chi-square as a whole, which says little where
    the scatter told the noise, and for repeats, which then say more.
    """
    return attempt.chi2_p_value() / (LINES_SHARE if lack is None else LINES_SHARE - REPEATS_SHARE)


def _of_effects(attempt: Attempt, account: Account) -> float:
    """The least corrected p-value of an effect that a search would add."""
    tried = (attempt.corrected(p_of_scored(attempt, each), each.candidate.term.effect) for each in attempt.scored)
    least, level = min(tried, default=1.0), CATALOGUE_SHARE * LEVEL
    beside_break = account.known is not None and account.known.beside_break
    if least >= level and not beside_break:
        return least
    added = account.next_term(attempt)
    if added is not None and breaks_level(attempt, added.effect) and (scored := attempt.scored_effect(added.effect)):
        # By the noise as it is beside the break: that it was estimated from these data has been asked already.
        return min(least, attempt.corrected(scored.score.p_value, added.effect))
    return 1.0 if added is None and least < level else least
