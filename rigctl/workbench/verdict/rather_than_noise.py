"""A break of the level where correlated noise does as well: a step of the years, or years that hang together?

Noise that is estimated from what a model leaves takes a break for correlation along the order, and beside so much
noise the break is not significant: two descriptions, each of which agrees with itself. They are compared by ordinary
likelihood, the noise estimated anew beside every break, and draws of correlated noise alone tell how much better a
break does by chance. Nothing in the data tells which of the two it is: both are said.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.core.errors import UNFIT
from rigctl.workbench.study import HasBreaks, Study, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.noise_alone import Asked, NoiseAlone
from rigctl.workbench.verdict.significance import is_significant

BY_CHANCE = 0.05
"""What correlated noise alone does more often than this is no break."""


def break_rather_than_noise(attempt: Attempt) -> Term | None:
    """The break of the level that describes the data better than noise correlated along their order.

    By Schwarz's criterion, and by more than such noise does by chance. None where there is none, and where the data
    are not one pool with an order.
    """
    pool = attempt.estimator.whole_pool
    if pool is None:
        return None
    breaks = [each for each in attempt.candidates if breaks_level(attempt, each.term.effect)]
    if not breaks:
        return None
    given = attempt.model.observations
    asked = [
        Asked(pool.seen(given, each.derivative[:, None]), 2.0 * attempt.price_of(each, len(each.names)))
        for each in breaks
    ]
    alone = NoiseAlone(attempt, pool, asked, attempt.seed)
    best = int(np.argmax(alone.gained))
    return breaks[best].term if alone.gained[best] > 0.0 and alone.probability(best) < BY_CHANCE else None


def is_noise_instead(study: Study, terms: Sequence[Term], term: Term, alpha: float, seed: int) -> str | None:
    """The order along which noise, estimated without `term`, describes what it does; None where it does not."""
    try:
        without = Attempt(study, [each for each in terms if each != term], seed)
    except UNFIT:
        return None
    if not without.noise.slow or not breaks_level(without, term.effect):
        return None
    order = without.noise.slow[0].order
    scored = without.scored_effect(term.effect)
    return None if scored is not None and is_significant(without, scored, alpha) else order


def breaks_level(attempt: Attempt, effect: str) -> bool:
    """Whether an effect, by id, breaks the level along the order of the data."""
    study, pool = attempt.study, attempt.estimator.whole_pool
    if pool is None or pool.order.name is None or not isinstance(study, HasBreaks):
        return False
    return study.breaks_level(effect, pool.order.name)
