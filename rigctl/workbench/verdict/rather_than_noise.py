"""A break of the level where correlated noise does as well: a step of the years, or years that hang together?

Noise that is estimated from what a model leaves takes a break for correlation along the order, and beside so much
noise the break is not significant: two descriptions, each of which agrees with itself. They are compared by ordinary
likelihood, the noise estimated anew beside every break, and draws of correlated noise alone tell how much better a
break does by chance. Nothing in the data tells which of the two it is: both are said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import UNFIT
from rigctl.workbench.study import Candidate, HasBreaks, Study, Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.noise_pool import Pool, Whitenings
from rigctl.workbench.verdict.offsets import in_units
from rigctl.workbench.verdict.scan import inverse_root
from rigctl.workbench.verdict.score import ABSORBED
from rigctl.workbench.verdict.significance import is_significant

BY_CHANCE = 0.05
"""What correlated noise alone does more often than this is no break."""

# Where chance does as well often, the first draws show it; all of them tell a probability of 1 / 1000.
BATCHES, BATCH = 5, 200
_ENOUGH = 12
# Of a square sum: what is left beside a break that goes through all data.
_NOTHING = 1e-12


def break_rather_than_noise(attempt: Attempt) -> Term | None:
    """The break of the level that describes the data better than noise correlated along their order.

    By Schwarz's criterion, and by more than such noise does by chance. None where there is none, and where the data
    are not one pool of at most `LARGEST_POOL` with an order.
    """
    pool = attempt.estimator.whole_pool
    if pool is None:
        return None
    breaks = [each for each in attempt.candidates if breaks_level(attempt, each.term.effect)]
    if not breaks:
        return None
    question = Question(attempt, pool, breaks)
    term, gained = question.best()
    return term if gained > 0.0 and question.by_chance(gained, attempt.seed) < BY_CHANCE else None


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
    if pool is None or pool.order is None or not isinstance(study, HasBreaks):
        return False
    return study.breaks_level(effect, pool.order)


@dataclass(frozen=True)
class _Alike:
    """Candidates with as many parameters: columns (n, k, d) in units of the given sigma, and what each costs (k,)."""

    columns: FloatArray
    price: FloatArray


class Question:
    """Candidates beside one fit, each with the noise that is likeliest beside it."""

    def __init__(self, attempt: Attempt, pool: Pool, candidates: Sequence[Candidate]) -> None:
        given = attempt.model.observations
        self.whitenings = pool.tried
        self._fitted = in_units(given, pool.where, attempt.model.jacobian(attempt.result.values))
        self._left = in_units(given, pool.where, attempt.unexplained())
        self.candidates: list[Candidate] = []
        self._alike: list[_Alike] = []
        by_width: dict[int, list[Candidate]] = {}
        for each in candidates:
            by_width.setdefault(len(each.names), []).append(each)
        for width, alike in by_width.items():
            columns = np.stack([each.derivative for each in alike], axis=1)
            flat = in_units(given, pool.where, columns.reshape(len(columns), -1))
            prices = np.array([2.0 * attempt.price_of(each, width) for each in alike])
            self._alike.append(_Alike(flat.reshape(columns.shape), prices))
            self.candidates += alike

    def best(self) -> tuple[Term, float]:
        """What gains most, and how much."""
        gained = self.gains(self._left[:, None])[:, 0]
        place = int(np.argmax(gained))
        return self.candidates[place].term, float(gained[place])

    def by_chance(self, gained: float, seed: int) -> float:
        """How often the best of the candidates gains as much where correlated noise is all there is."""
        rng, as_good, drawn = np.random.default_rng([seed, 7]), 0, 0
        while drawn < BATCHES * BATCH and as_good < _ENOUGH:
            as_good += int(np.sum(self.gains(self._drawn(rng)).max(axis=0) >= gained))
            drawn += BATCH
        return (1 + as_good) / (1 + drawn)

    def gains(self, residuals: FloatArray) -> FloatArray:
        """How much less -2 log L is with each candidate than without, less its price; (candidates, draws).

        `residuals` (n, draws) in units of the given sigma.
        """
        alone = np.full(residuals.shape[1], np.inf)
        beside = np.full((len(self.candidates), residuals.shape[1]), np.inf)
        for whitenings in self.whitenings:
            for scale, determinant in whitenings.strengths():
                fitted = np.linalg.qr(whitenings.turned(self._fitted) * scale[:, None])[0]
                left = whitenings.turned(residuals) * scale[:, None]
                left -= fitted @ (fitted.T @ left)
                rss = np.sum(left**2, axis=0)
                alone = np.minimum(alone, len(left) * np.log(rss) + determinant)
                first = 0
                for alike in self._alike:
                    taken = _taken(whitenings.turned(alike.columns) * scale[:, None, None], fitted, left)
                    now = slice(first, first + len(alike.price))
                    rest = np.maximum(rss - taken, _NOTHING * rss)
                    beside[now] = np.minimum(beside[now], len(left) * np.log(rest) + determinant)
                    first = now.stop
        return np.asarray(alone - beside - np.concatenate([each.price for each in self._alike])[:, None])

    def _drawn(self, rng: np.random.Generator) -> FloatArray:
        """Draws of correlated noise like that of the data, (n, BATCH), but for its size, on which no gain depends."""
        whitenings, scale = self._noise_alone
        return whitenings.turned_back(rng.standard_normal((len(scale), BATCH)) / scale[:, None])

    @cached_property
    def _noise_alone(self) -> tuple[Whitenings, FloatArray]:
        """The likeliest correlation where nothing is hidden, by restricted likelihood, and what makes it white."""
        best, chosen = np.inf, None
        for whitenings in self.whitenings:
            for scale, determinant in whitenings.strengths():
                fitted, root = np.linalg.qr(whitenings.turned(self._fitted) * scale[:, None])
                left = whitenings.turned(self._left) * scale
                left = left - fitted @ (fitted.T @ left)
                free = len(left) - fitted.shape[1]
                cost = free * np.log(left @ left) + determinant + 2.0 * np.sum(np.log(np.abs(np.diag(root))))
                if cost < best:
                    best, chosen = float(cost), (whitenings, scale)
        assert chosen is not None
        return chosen


def _taken(columns: FloatArray, fitted: FloatArray, left: FloatArray) -> FloatArray:
    """By how much columns (n, k, d) beside what is fitted lower the square sums of what is left (n, draws).

    Shape (k, draws).
    """
    data, count, width = columns.shape
    flat = columns.reshape(data, -1)
    size = np.linalg.norm(flat, axis=0)
    flat = flat - fitted @ (fitted.T @ flat)
    free = np.linalg.norm(flat, axis=0)
    seen = free > ABSORBED * size
    flat = flat * np.where(seen, 1.0 / np.where(seen, free, 1.0), 0.0)
    along = (flat.T @ left).reshape(count, width, -1)
    if width == 1:
        return np.asarray(along[:, 0] ** 2)
    stack = flat.reshape(data, count, width)
    gram = np.einsum("nki,nkj->kij", stack, stack, optimize=True)
    root, _ = inverse_root(gram, seen.reshape(count, width))
    return np.asarray(np.sum(np.einsum("kij,kib->kjb", root, along, optimize=True) ** 2, axis=1))
