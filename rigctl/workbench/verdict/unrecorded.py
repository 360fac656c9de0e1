"""Effects that cannot be asked about, because what they depend on was not recorded, and terms that imitate them."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.workbench.study import DependsOnUnrecorded, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.significance import CATALOGUE_SHARE


def imitations(attempt: Attempt, suggested: Sequence[Term], alpha: float) -> list[Term]:
    """Suggested terms that are not significant beside what an effect of an unrecorded quantity could do.

    Where something unknown remains with them in the model, they explain a part of it and are no effect that is there.
    `attempt` has none of them.
    """
    if not suggested or not isinstance(attempt.study, DependsOnUnrecorded):
        return []
    columns = attempt.study.unrecorded(attempt.model, attempt.result.values)
    if not columns.shape[1]:
        return []
    projector = attempt.projector_with(attempt.whitened_columns(columns))
    scored = [(term, attempt.scored_effect(term.effect)) for term in suggested]
    return [
        term
        for term, each in scored
        if each is not None
        and attempt.corrected(projector.score(attempt.columns(each.candidate)).p_value, term.effect)
        >= CATALOGUE_SHARE * alpha
    ]
