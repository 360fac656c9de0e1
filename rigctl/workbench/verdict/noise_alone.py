"""What correlated noise alone does: effects compared by ordinary likelihood, the noise likeliest beside each of them.

Noise that goes slowly along the order of the data and an effect that goes slowly pass for each other. Where the noise
is estimated, what may be hidden is projected out first, and the slow part of the noise with it: what is left looks
white, and beside so little noise the slow part is significant. So effects are compared with the noise that is
likeliest beside each, and draws of the likeliest noise alone tell how much the best of them all gains by chance.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decomposition import svd
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.groups import Groups
from rigctl.workbench.study import Candidate
from rigctl.workbench.verdict.fitted_model import FittedModel
from rigctl.workbench.verdict.generic import Generic
from rigctl.workbench.verdict.noise import orthonormal
from rigctl.workbench.verdict.noise_pool import WHITE_ODDS, Pool, Whitenings
from rigctl.workbench.verdict.offsets import from_units, in_units
from rigctl.workbench.verdict.scan import inverse_root
from rigctl.workbench.verdict.score import ABSORBED, UNDETERMINED

BATCHES, BATCH = 5, 100
"""Draws: all of them where the first ones do not decide."""

EVERY = 2
"""Of the strengths of a correlation each second is taken: a factor of ten apart they tell likelihoods well enough."""

CORRELATED = 1.0 / (1.0 + WHITE_ODDS)
"""How probable it is beforehand that noise is correlated along an order at all (decision 014)."""

_ENOUGH = 12
"""So many draws that gain as much decide: chance does it often."""

_TAIL = 0.1
"""Of the draws: beyond, gains are taken to fall off exponentially, as those of likelihoods do."""

_SURE = 1e-4
"""Of what the first draws find as rare as that, more of them would say the same."""

DOUBTFUL = (1e-12, 0.05)
"""Corrected p-values that are held to what correlated noise alone shows: of 100 tables of flicker noise, the smallest
that was taken for white came to 1e-8, and draws cost seconds."""

# Of a square sum: what is left beside columns that go through all data.
_NOTHING = 1e-6

# Of a unit vector beside what is fitted: the basis was made where a first fit ended, which differs a little.
_BESIDE = 1e-2


Price = Callable[[Candidate, int], float]
"""What a candidate that adds so many dimensions costs in log evidence."""


@dataclass(frozen=True)
class Asked:
    """An effect: columns (n, k, d) with each of its k choices, and its price in units of -2 log L."""

    columns: FloatArray
    price: float


class NoiseAlone:
    """Effects beside one fit, whose data are one `pool`, each with the noise that is likeliest beside it.

    `seed` fixes the draws.
    """

    def __init__(self, fitted: FittedModel, pool: Pool, asked: Sequence[Asked], seed: int) -> None:
        given = fitted.model.observations
        self.whitenings = pool.tried
        jacobian = in_units(given, pool.where, fitted.model.jacobian(fitted.result.values))
        # Of what is held or has no slope nothing is left here: a determinant of it would be none.
        self._fitted = orthonormal(jacobian, UNDETERMINED)
        self._left = in_units(given, pool.where, fitted.unexplained())
        self._price = np.array([each.price for each in asked])
        self._groups: list[_Group] = []
        for width in sorted({each.columns.shape[2] for each in asked}):
            alike = [(place, each.columns) for place, each in enumerate(asked) if each.columns.shape[2] == width]
            columns = np.concatenate([of_effect for _, of_effect in alike], axis=1)
            flat = in_units(given, pool.where, columns.reshape(len(columns), -1))
            choices = [of_effect.shape[1] for _, of_effect in alike]
            places = np.array([place for place, _ in alike], dtype=np.intp)
            first = np.concatenate([[0], np.cumsum(choices)[:-1]]).astype(np.intp)
            self._groups.append(_Group(places, flat.reshape(columns.shape), first))
        self._rng = np.random.default_rng([seed, 7])
        self._by_chance = np.zeros(0)

    @cached_property
    def gained(self) -> FloatArray:
        """How much less -2 log L is with each effect than without, its price paid, (effects,)."""
        return self.gains(self._left[:, None])[:, 0]

    def probability(self, effect: int) -> float:
        """That the best of all effects gains as much as this one where correlated noise is all there is."""
        gained = float(self.gained[effect])
        while True:
            as_good, p_value = self._found(gained)
            drawn = len(self._by_chance)
            if as_good >= _ENOUGH or drawn >= BATCHES * BATCH or (drawn and p_value < _SURE):
                return p_value
            self._by_chance = np.concatenate([self._by_chance, self._gained_by_chance()])

    def _found(self, gained: float) -> tuple[int, float]:
        """How many of the draws so far gain as much, and the probability of it."""
        drawn = self._by_chance
        as_good = int(np.sum(drawn >= gained))
        beyond = np.sort(drawn)[len(drawn) - int(_TAIL * len(drawn)) :]
        if not len(beyond) or as_good >= len(beyond):
            return as_good, (1 + as_good) / (1 + len(drawn))
        mean = float(np.mean(beyond - beyond[0]))
        return as_good, _TAIL * float(np.exp(-(gained - beyond[0]) / mean)) if mean > 0.0 else 0.0

    def gains(self, residuals: FloatArray, precision: type[np.floating] = np.float64) -> FloatArray:
        """The same in other residuals (n, draws) in units of the given sigma; (effects, draws)."""
        alone = np.full(residuals.shape[1], np.inf)
        beside = np.full((len(self._price), residuals.shape[1]), np.inf)
        for whitenings in self.whitenings:
            fitted, left = whitenings.turned(self._fitted), whitenings.turned(residuals).astype(precision)
            turned = [whitenings.turned(each.columns).astype(precision) for each in self._groups]
            for scale, determinant in itertools.islice(whitenings.strengths(), 0, None, EVERY):
                basis = np.linalg.qr(fitted * scale[:, None])[0].astype(precision)
                factor = scale.astype(precision)
                free = left * factor[:, None]
                free = free - basis @ (basis.T @ free)
                rss = np.sum(free**2, axis=0)
                alone = np.minimum(alone, len(free) * np.log(rss) + determinant)
                for group, columns in zip(self._groups, turned, strict=True):
                    taken = _taken(columns * factor[:, None, None], basis, free)
                    # Of the choices of an effect the one that takes most: they have one price.
                    rest = np.maximum(rss - np.maximum.reduceat(taken, group.first, axis=0), _NOTHING * rss)
                    cost = len(free) * np.log(rest) + determinant
                    beside[group.effects] = np.minimum(beside[group.effects], cost)
        return np.asarray(alone - beside - self._price[:, None], dtype=np.float64)

    def sigma(self, columns: FloatArray) -> FloatArray:
        """Standard uncertainties (d,) of what columns (n, d) in units of the given sigma are multiplied by, in the
        likeliest noise alone; infinite where they are not determined."""
        whitenings, scale = self._likeliest
        fitted = np.linalg.qr(whitenings.turned(self._fitted) * scale[:, None])[0]
        left, free = (whitenings.turned(each) * scale[:, None] for each in (self._left[:, None], columns))
        left, free = left - fitted @ (fitted.T @ left), free - fitted @ (fitted.T @ free)
        noise = float(np.sqrt(np.sum(left**2) / (len(left) - fitted.shape[1])))
        # Parameters' units differ by powers of ten: of columns of unit length it shows what is determined.
        size = np.linalg.norm(free, axis=0)
        unit = free / np.where(size > 0.0, size, 1.0)
        root, determined = inverse_root((unit.T @ unit)[None], (size > 0.0)[None])
        if not determined.all():
            return np.full(len(size), np.inf)
        return np.asarray(noise * np.sqrt(np.sum(root[0] ** 2, axis=1)) / size)

    def _gained_by_chance(self) -> FloatArray:
        """By the best of all effects, in draws of correlated noise like that of the data, (BATCH,)."""
        whitenings, scale = self._likeliest
        # But for its size, on which no gain depends.
        drawn = whitenings.coloured(self._rng.standard_normal((len(scale), BATCH)), scale)
        # In single precision: a gain is compared with that in the data, to which none is as near.
        return np.asarray(self.gains(drawn, np.float32).max(axis=0))

    @cached_property
    def _likeliest(self) -> tuple[Whitenings, FloatArray]:
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


class ChanceOfNoise:
    """How probable it is that noise is correlated and alone shows what effects beside a fit do (`groups`, which cost
    `price_of`), and what plain shapes (`generic`) do."""

    def __init__(
        self, fitted: FittedModel, pool: Pool, groups: Groups, price_of: Price, generic: Generic, seed: int
    ) -> None:
        self._fitted, self._pool, self._seed = fitted, pool, seed
        self._groups, self._price_of, self._generic = groups, price_of, generic

    def of_effect(self, effect: str) -> float:
        """That the best of all effects does as well as this one by chance."""
        alone, places = self._effects
        return CORRELATED * min(alone.probability(place) for place in places[effect])

    def sigma(self, candidate: Candidate) -> FloatArray:
        """Standard uncertainties (d,) of a candidate's parameters in the noise that is likeliest alone."""
        columns = in_units(self._fitted.model.observations, self._pool.where, candidate.derivative)
        return self._effects[0].sigma(columns)

    @cached_property
    def of_shapes(self) -> float:
        """That the best of all plain shapes does as well by chance."""
        columns = self._generic.main_columns(self._pool.where)
        asked = [Asked(column[:, None, None], 0.0) for column in columns.T]
        alone = NoiseAlone(self._fitted, self._pool, asked, self._seed)
        return CORRELATED * alone.probability(int(np.argmax(alone.gained)))

    @cached_property
    def of_projected(self) -> float:
        """That by chance as much goes along all that was projected out before the noise was estimated."""
        given, where, basis = self._fitted.model.observations, self._pool.where, self._pool.basis
        jacobian = in_units(given, where, self._fitted.model.jacobian(self._fitted.result.values))
        fitted = orthonormal(jacobian, UNDETERMINED)
        left, length, _ = svd(basis - fitted @ (fitted.T @ basis))
        columns = from_units(given, where, left[:, length > _BESIDE])
        if not columns.shape[1]:
            return CORRELATED
        alone = NoiseAlone(self._fitted, self._pool, [Asked(columns[:, None], 0.0)], self._seed)
        return CORRELATED * alone.probability(0)

    @cached_property
    def _effects(self) -> tuple[NoiseAlone, dict[str, list[int]]]:
        asked: list[Asked] = []
        places: dict[str, list[int]] = {}
        for effect, groups in self._groups.items():
            for group in groups:
                columns = np.stack([each.derivative for each in group], axis=1)
                places.setdefault(effect, []).append(len(asked))
                asked.append(Asked(columns, 2.0 * self._price_of(group[0], columns.shape[2])))
        return NoiseAlone(self._fitted, self._pool, asked, self._seed), places


def in_doubt(p_value: float) -> bool:
    """Whether a corrected p-value is to be held to what correlated noise alone shows."""
    return DOUBTFUL[0] < p_value < DOUBTFUL[1]


@dataclass(frozen=True)
class _Group:
    """Effects with columns of equal number: their places, the columns (n, choices of all, d) in units of the given
    sigma, and where the choices of each begin."""

    effects: IntArray
    columns: FloatArray
    first: IntArray


def _taken(
    columns: NDArray[np.floating], fitted: NDArray[np.floating], left: NDArray[np.floating]
) -> NDArray[np.floating]:
    """By how much columns (n, k, d) beside what is fitted lower the square sums of what is left (n, draws).

    Shape (k, draws).
    """
    data, count, width = columns.shape
    flat = columns.reshape(data, -1)
    size = np.linalg.norm(flat, axis=0)
    flat = flat - fitted @ (fitted.T @ flat)
    free = np.linalg.norm(flat, axis=0)
    seen = free > ABSORBED * size
    flat = flat * np.where(seen, 1.0 / np.where(seen, free, 1.0), 0.0).astype(columns.dtype)
    along = (flat.T @ left).reshape(count, width, -1)
    if width == 1:
        return np.asarray(along[:, 0] ** 2)
    stack = flat.reshape(data, count, width)
    gram = np.einsum("nki,nkj->kij", stack, stack, optimize=True).astype(np.float64)
    root = inverse_root(gram, seen.reshape(count, width))[0].astype(columns.dtype)
    return np.asarray(np.sum((root.transpose(0, 2, 1) @ along) ** 2, axis=1))
