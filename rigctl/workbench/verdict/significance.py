"""Which effects and shapes are significant, and how the level over all trials is shared between the questions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.generic import Best
from rigctl.workbench.verdict.score import corrected, single
from rigctl.workbench.verdict.trials import smallest_of

CATALOGUE_SHARE, SHAPES_SHARE, LINES_SHARE = 0.6, 0.3, 0.1
"""How the level over all trials is shared between the catalogue, the shapes without physics and the lines."""

REPEATS_SHARE = 0.5 * LINES_SHARE
"""Of that of the lines, which are looked for in samples: repeats are readings of a table, which has none."""

CONFIRM_FROM = 0.05
"""Corrected p-values below are confirmed by bootstrap where noise comes from the scatter."""


def p_of_scored(attempt: Attempt, scored: Scored) -> float:
    """P-value of a candidate, by bootstrap where it matters and its noise comes from the scatter."""
    p_value, score, effect = scored.score.p_value, scored.score, scored.candidate.term.effect
    if attempt.corrected(p_value, effect) >= CONFIRM_FROM:
        return p_value
    p_value = max(p_value, _permuted_p_of_scored(attempt, scored), _rotated_p_of_scored(attempt, scored))
    chance = attempt.chance_of_noise
    if chance is not None and chance.in_doubt(attempt.corrected(p_value, effect)):
        by_noise = chance.of_effect(scored.candidate)
        p_value = max(p_value, single(by_noise, attempt.trials_of(effect)))
        # How the noise was estimated matters neither to what is beyond slow noise nor to what is as it does.
        if not by_noise or attempt.corrected(p_value, effect) >= CONFIRM_FROM:
            return p_value
    if attempt.to_be_drawn(score.basis):
        law = attempt.bootstrap.law(effect)
        # The larger: that the noise is estimated can only make an effect less sure.
        p_value = max(p_value, law.p_value(score.statistic, score.dimension))
    return p_value


def is_significant(attempt: Attempt, scored: Scored, alpha: float) -> bool:
    """At the catalogue's share of the level, confirmed where the noise is not known beforehand."""
    effect = scored.candidate.term.effect
    return attempt.corrected(p_of_scored(attempt, scored), effect) < CATALOGUE_SHARE * alpha


def significant_shape(attempt: Attempt, alpha: float) -> Best | None:
    """The strongest plain shape left, where it is significant."""
    return attempt.best_shape if p_of_shape(attempt) < SHAPES_SHARE * alpha else None


def p_of_shape(attempt: Attempt) -> float:
    """Corrected p-value of the strongest plain shape left, by bootstrap where it matters; 1 where there is none."""
    shape = attempt.best_shape
    if shape is None:
        return 1.0
    p_value = shape.p_value_corrected
    if p_value < CONFIRM_FROM:
        p_value = max(p_value, _permuted_p_of_shape(attempt, shape))
    if (chance := attempt.chance_of_noise) is not None and chance.in_doubt(p_value):
        by_noise = chance.of_shape(shape.columns)
        p_value = max(p_value, by_noise)
        if not by_noise:
            return p_value
    if p_value < CONFIRM_FROM and attempt.to_be_drawn(shape.columns):
        law = attempt.bootstrap.shapes
        p_value = max(p_value, corrected(law.p_value(shape.statistic, shape.dimension), shape.n_eff))
    return p_value


def _permuted_p_of_scored(attempt: Attempt, scored: Scored) -> float:
    """The least p-value of a candidate where what is left has heavy tails, from permutations; 0 where not."""
    permuted, score = attempt.permuted, scored.score
    if permuted is None or not score.dimension:
        return 0.0
    name = attempt.family_of(scored.candidate.term.effect)
    family = attempt.family(name)

    def smallest(draws: NDArray[np.float32]) -> FloatArray:
        # Under a new name each time: permutations of long columns come in pieces.
        return smallest_of(family, draws, object())

    found = permuted.probability(name, smallest, score.statistic, score.dimension)
    return single(found, attempt.trials.within[name])


def _rotated_p_of_scored(attempt: Attempt, scored: Scored) -> float:
    """The least p-value of a candidate where few degrees of freedom are left, from rotations; 0 where not."""
    rotated, effect = attempt.rotated, scored.candidate.term.effect
    if rotated is None or not scored.score.dimension:
        return 0.0
    # Between the choices of a scan the rotations are not looked at either: like is compared with like.
    found = rotated.corrected(attempt.family_of(effect), attempt.least_p_of(effect))
    return single(found, attempt.trials_of(effect))


def _permuted_p_of_shape(attempt: Attempt, shape: Best) -> float:
    """The same of the strongest plain shape, all shapes counted."""
    if attempt.permuted is None:
        return 0.0

    def smallest(draws: NDArray[np.float32]) -> FloatArray:
        return attempt.generic.smallest(attempt.noise, attempt.projector, draws)

    return attempt.permuted.probability("plain shapes", smallest, shape.statistic, shape.dimension)


def is_adequate(attempt: Attempt, alpha: float) -> bool:
    """Nothing in the catalogue or of a plain shape is significant beside these terms."""
    return not any(is_significant(attempt, each, alpha) for each in attempt.scored) and (
        significant_shape(attempt, alpha) is None
    )


def corrected_for(attempt: Attempt, p_value: float, effect: str) -> float:
    """The p-value of an effect of the catalogue at the level over all trials together, shares included."""
    # Divided by the share, so that it compares with alpha itself.
    return min(attempt.corrected(p_value, effect) / CATALOGUE_SHARE, 1.0)
