"""What slow noise may hide: effects that would be significant if the noise were white, and are not as it is.

Noise that is correlated along an order (flicker noise, along time) imitates whatever goes slowly along it. The same
residuals are judged twice, with the noise as it was estimated and with their whole scatter taken for white; what only
the latter finds is neither excluded nor shown by these data, and other measurements would tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.hidden import HiddenInNoise
from rigctl.workbench.verdict.attempt import Attempt, Scored
from rigctl.workbench.verdict.ranking import detectable
from rigctl.workbench.verdict.score import Projector, Score
from rigctl.workbench.verdict.significance import CATALOGUE_SHARE, corrected_for, is_significant, p_of_scored

MOST = 4
"""So many are named at most: with more, what is slow in these data is described by whatever there is."""


def hidden_in_slow_noise(attempt: Attempt, alpha: float) -> tuple[HiddenInNoise, ...]:
    """The fewest effects that would explain what is slow if the noise were white, the strongest first."""
    orders = _orders(attempt)
    if not orders:
        return ()
    white = _Whitened(attempt)
    waiting = [each for each in attempt.scored if not is_significant(attempt, each, alpha)]
    found: list[HiddenInNoise] = []
    while len(found) < MOST:
        scored = {id(each): Scored(each.candidate, white.score(each)) for each in waiting}
        shown = [
            each
            for each in waiting
            if _corrected(attempt, scored[id(each)]) < CATALOGUE_SHARE * alpha
            and (_costs(each, scored[id(each)]) or _is_as_noise(attempt, each, alpha))
        ]
        if not shown:
            break
        best = max(shown, key=lambda each: attempt.evidence(scored[id(each)]))
        found.append(_hidden(attempt, best, scored[id(best)], ", ".join(orders), alpha))
        # What one of them explains needs no second.
        white = white.beside(best)
        waiting = [each for each in waiting if each is not best]
    return tuple(found)


class _Whitened:
    """What a fit leaves, with all scatter taken for white noise, and columns `more` fitted too."""

    def __init__(self, attempt: Attempt, more: FloatArray | None = None) -> None:
        self._attempt = attempt
        self._noise = attempt.estimator.as_if_white(attempt.unexplained())
        data = len(attempt.result.residuals)
        fitted = self._noise.whiten(attempt.model.jacobian(attempt.result.values))
        left = np.concatenate([self._noise.whiten(attempt.unexplained()), attempt.left[data:]])
        self._more = np.zeros((len(left), 0)) if more is None else more
        jacobian = np.hstack([np.vstack([fitted, attempt.jacobian[data:]]), self._more])
        self._projector = Projector(jacobian, left, self._noise.dof, data, self._noise.between)

    def score(self, scored: Scored) -> Score:
        """Of a candidate."""
        return self._projector.score(self._columns(scored))

    def beside(self, scored: Scored) -> _Whitened:
        """The same with a candidate in the model."""
        return _Whitened(self._attempt, np.hstack([self._more, self._columns(scored)]))

    def _columns(self, scored: Scored) -> FloatArray:
        return self._attempt.padded(self._noise.whiten(scored.candidate.derivative))


def _costs(now: Scored, white: Scored) -> bool:
    """Whether the correlation makes it harder to see: what is fast is seen better between correlated data.

    By more than the standard uncertainty, 1 / sqrt(2 dof), of the scale of white noise itself.
    """
    unsure = 1.0 / np.sqrt(2.0 * white.score.dof)
    return bool(np.all(now.score.sigma > (1.0 + unsure) * white.score.sigma))


def _is_as_noise(attempt: Attempt, scored: Scored, alpha: float) -> bool:
    """Whether an effect is not significant only because noise that is correlated does as well alone."""
    chance, p_value = attempt.chance_of_noise, _corrected(attempt, scored)
    if chance is None or not chance.in_doubt(p_value) or p_value >= CATALOGUE_SHARE * alpha:
        return False
    return chance.of_effect(scored.candidate) >= CATALOGUE_SHARE * alpha


def _orders(attempt: Attempt) -> list[str]:
    """Along what noise that comes from the scatter is correlated here, or may be."""
    if (pool := attempt.estimator.whole_pool) is not None and pool.order.name is not None:
        return [pool.order.name]
    given, noise = attempt.model.observations, attempt.noise
    correlated = np.zeros(len(given.value), dtype=np.bool_)
    # Those known beforehand come first, and are no slow noise.
    for where, _ in noise.factors[len(given.factors) :]:
        correlated[where] = True
    pools = [given.pools[number] for number in np.unique(given.pool_of[correlated])]
    return list(dict.fromkeys(pool.order for pool in pools if pool.order is not None))


def _corrected(attempt: Attempt, scored: Scored) -> float:
    return attempt.corrected(scored.score.p_value, scored.candidate.term.effect)


def _hidden(attempt: Attempt, now: Scored, white: Scored, order: str, alpha: float) -> HiddenInNoise:
    candidate, effect = now.candidate, now.candidate.term.effect
    p_value = p_of_scored(attempt, now)
    if _is_as_noise(attempt, now, alpha) and attempt.chance_of_noise is not None:
        # The noise looks white: how large the effect would have to be, the noise that imitates it says.
        now = Scored(candidate, replace(now.score, sigma=attempt.chance_of_noise.sigma(candidate)))
    return HiddenInNoise(
        term=candidate.term,
        order=order,
        p_value_corrected=corrected_for(attempt, p_value, effect),
        p_value_if_white=corrected_for(attempt, white.score.p_value, effect),
        detectable=detectable(attempt, now, alpha),
        detectable_if_white=detectable(attempt, white, alpha),
        units=dict(zip(candidate.names, candidate.units, strict=True)),
    )
