"""Effects that the data cannot tell from each other, or from fitted parameters that absorb them."""

from __future__ import annotations

import numpy as np

from rigctl.workbench.findings import Inseparable
from rigctl.workbench.study import DeclaresInseparable
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.score import ABSORBED, contained

SAME = 0.99
"""Canonical correlation above which two effects are one class: these data cannot tell them apart."""

DISTINCT_FALL = 30.0
"""Difference of the falls of chi-square above which two effects are distinct, whatever their correlation."""

ENOUGH_OFFSETS = 5
"""Fewer batches than that say too little of how offsets scatter to judge an effect by (decision 046)."""

_ROUNDING = 1e-9

_SHARE = 0.3
"""Parameters that contribute less, relative to the strongest, are not named as absorbing an effect."""


def equivalent_effects(attempt: Attempt, scored: Scored) -> list[str]:
    """Effects these data cannot tell from this one, and parameters of the baseline that absorb it."""
    if not scored.score.dimension:
        return list(_absorbers(attempt, scored))
    effects = [each.candidate.term.effect for each in attempt.scored]
    place = effects.index(scored.candidate.term.effect)
    return [effects[i] for i in _alike(attempt, place)]


def _alike(attempt: Attempt, place: int) -> list[int]:
    """Effects that do the same to these data: their spans coincide, neither explains more of what is left."""
    # Bounds are cheap for all pairs; bases are compared where they leave it open.
    a, near = attempt.scored[place].score, np.flatnonzero(attempt.likeness_bounds[place] > SAME)
    others = [(int(i), attempt.scored[i].score) for i in near if i != place]
    others = [
        (i, b) for i, b in others if a.dimension == b.dimension > 0 and abs(a.statistic - b.statistic) < DISTINCT_FALL
    ]
    basis = a.basis if others else None
    return [i for i, b in others if basis is not None and contained(basis, b.basis) > SAME]


def inseparable_effects(attempt: Attempt) -> tuple[Inseparable, ...]:
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
    inseparable += _confounded_with_offsets(attempt)
    effects = [scored.candidate.term.effect for scored in attempt.scored]
    for place, effect in enumerate(effects):
        inseparable += [Inseparable(effect, effects[other]) for other in _alike(attempt, place) if other > place]
    return tuple(inseparable)


def _confounded_with_offsets(attempt: Attempt) -> list[Inseparable]:
    """Effects that vary only between a few batches: their offsets, of which each is unknown, may be all there is."""
    confounded = []
    for offset in attempt.model.observations.offsets:
        count = np.bincount(offset.level_of)
        if len(count) >= ENOUGH_OFFSETS:
            continue
        for scored in attempt.scored:
            columns = scored.candidate.derivative
            means = np.stack([np.bincount(offset.level_of, column) / count for column in columns.T], axis=1)
            inside = columns - means[offset.level_of]
            if np.linalg.norm(inside) < _ROUNDING * np.linalg.norm(columns):
                said = f"{len(count)} of them, and it varies between them only"
                confounded.append(Inseparable(scored.candidate.term.effect, f"offset:{offset.name}", said))
    return confounded


def _absorbers(attempt: Attempt, scored: Scored) -> dict[str, str]:
    """Fitted parameters that imitate the absorbed columns of a candidate, with what its typical size does to them."""
    absorbed = scored.score.keep < ABSORBED
    typical = np.where(absorbed, scored.candidate.typical, 0.0)
    column = attempt.columns(scored.candidate) @ typical
    # J^+ G p: what the parameters take up where the effect acts and is not in the model.
    jacobian = attempt.jacobian
    shift = np.nan_to_num(attempt.result.covariance) @ (jacobian.T @ column)
    # In units of the noise, for the parameters' own do not compare.
    strength = np.abs(shift) * np.linalg.norm(jacobian, axis=0)
    shifts: dict[str, str] = {}
    for where in np.argsort(-strength):
        if strength[where] < _SHARE * strength.max() or not strength[where] > 0.0:
            break
        # Without the mounting in brackets: the same parameter of forty mountings is named once.
        name = attempt.model.owners[where] or f"baseline:{attempt.names[where].partition('[')[0]}"
        if name not in shifts:
            shifts[name] = (
                f"its typical size moves {attempt.names[where]} by {shift[where]:.3g}{_unit(attempt, where)}"
            )
    return shifts


def _unit(attempt: Attempt, where: np.intp) -> str:
    unit = attempt.model.units[int(where)]
    return f" {unit}" if unit not in {"", "1"} else ""
