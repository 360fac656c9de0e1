"""Is an effect of the catalogue still needed where plain shapes, which have no physics, are in the model too?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.generic import Best
from rigctl.workbench.verdict.score import corrected
from rigctl.workbench.verdict.significance import CATALOGUE_SHARE, SHAPES_SHARE

MOST_SHAPES = 4
"""Plain shapes beside which an effect must be needed."""


def replaced_by_shape(attempt: Attempt, best: Scored, alpha: float) -> bool:
    """Whether the strongest plain shape makes the best effect needless, and not the other way round."""
    shape = attempt.best_shape
    if shape is None or shape.p_value_corrected >= SHAPES_SHARE * alpha:
        return False
    shape_columns = attempt.whitened_columns(shape.columns)
    columns = attempt.columns(best.candidate)
    # An effect that is itself a plain shape is safe: neither needs the other, and the catalogue goes first.
    p_value = attempt.projector_with(shape_columns).score(columns).p_value
    effect = attempt.corrected(p_value, best.candidate.term.effect)
    beside = corrected(attempt.projector_with(columns).score(shape_columns).p_value, shape.n_eff)
    # That something is there is settled, at its share of the level: which of the two it is, is one more question.
    return effect >= CATALOGUE_SHARE * alpha and beside < alpha


def significant_beside_shape(attempt: Attempt, alpha: float) -> set[str]:
    """Effects that are significant with the strongest plain shape in the model."""
    assert attempt.best_shape is not None
    projector = attempt.projector_with(attempt.whitened_columns(attempt.best_shape.columns))
    return {
        each.candidate.term.effect
        for each in attempt.scored
        if attempt.corrected(projector.score(attempt.columns(each.candidate)).p_value, each.candidate.term.effect)
        < CATALOGUE_SHARE * alpha
    }


def needless_beside_shapes(attempt: Attempt, scored: Scored, shapes: Sequence[Best], alpha: float) -> bool:
    """Whether a candidate is not significant beside the plain `shapes` that are left with it in the model."""
    if not shapes:
        return False
    columns = np.hstack([attempt.whitened_columns(shape.columns) for shape in shapes])
    beside = attempt.projector_with(columns).score(attempt.columns(scored.candidate))
    return attempt.corrected(beside.p_value, scored.candidate.term.effect) >= CATALOGUE_SHARE * alpha


def shapes_left(attempt: Attempt, alpha: float, seed: int) -> list[Best]:
    """Plain shapes that are significant one after another, the strongest first."""
    shapes: list[Best] = []
    shape = attempt.best_shape
    while shape is not None and shape.p_value_corrected < SHAPES_SHARE * alpha:
        shapes.append(shape)
        if len(shapes) == MOST_SHAPES:
            break
        # Those found before are fitted along: the next one is of what they leave.
        columns = np.hstack([attempt.whitened_columns(each.columns) for each in shapes])
        shape = attempt.generic.best(attempt.noise, attempt.projector_with(columns), (seed, 4), len(shapes) - 1)
    return shapes
