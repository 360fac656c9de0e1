"""What correlated noise alone does: effects compared by ordinary likelihood, the noise likeliest beside each of them.

Noise that goes slowly along the order of the data and an effect that goes slowly pass for each other. Where the noise
is estimated, what may be hidden is projected out first, and the slow part of the noise with it: what is left looks
white, and beside so little noise the slow part is significant. So effects are compared with the noise that is
likeliest beside each, and draws of noise alone, of every law as often as the data leave it probable, tell how much
the best of them all gains by chance.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decomposition import svd
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.groups import Groups
from rigctl.workbench.study import Candidate, Observations
from rigctl.workbench.verdict.fitted_model import FittedModel
from rigctl.workbench.verdict.generic import Generic
from rigctl.workbench.verdict.noise import orthonormal
from rigctl.workbench.verdict.noise_pool import WHITE_ODDS, Pool, Whitenings
from rigctl.workbench.verdict.offsets import from_units, in_units
from rigctl.workbench.verdict.scan import inverse_root
from rigctl.workbench.verdict.score import ABSORBED, UNDETERMINED

DRAWS = (100, 400)
"""So many, and so many more where the first ones do not decide: most of the work is the same for all of a batch."""

EVERY = 2
"""Of the strengths of a correlation each second is taken: a factor of ten apart they tell likelihoods well enough."""

CORRELATED = 1.0 / (1.0 + WHITE_ODDS)
"""How probable it is beforehand that noise is correlated along an order at all (decision 014)."""

_ENOUGH = 12
"""So many draws that gain as much decide: chance does it often."""

_TAIL = 0.1
"""Of the draws: beyond, gains are taken to fall off exponentially, as those of likelihoods do."""

DOUBTFUL = 0.05
"""Corrected p-values below are held to what correlated noise alone shows, however small: a walk that is taken for
white shows steps at 1e-13 in four hundred readings."""

_BEYOND = 50.0
"""Of -2 log L for each column, more than correlated noise comes to: in one draw of a hundred the best of all effects
gains 10 to 15."""

_LEAST = float(np.finfo(np.float64).tiny)

# Of a square sum: what is left beside columns that go through all data.
_NOTHING = 1e-6

# Of a square sum: a wave of which a period is three and a half blocks long keeps so much.
_SHOWN = 0.75

# Of the derivatives of a scan, made at once.
_NUMBERS = 1 << 22

# Amplitude and phase: scans have no more.
_FEW_COLUMNS = 2

# Of a unit vector beside what is fitted: the basis was made where a first fit ended, which differs a little.
_BESIDE = 1e-2


Price = Callable[[Candidate, int], float]
"""What a candidate that adds so many dimensions costs in log evidence."""


@dataclass(frozen=True)
class Asked:
    """An effect: columns (seen, k, d) with each of its k choices as `Pool.seen` has them, and its price in units of
    -2 log L."""

    columns: FloatArray
    price: float


class NoiseAlone:
    """Effects beside one fit, whose data are one `pool`, each with the noise that is likeliest beside it.

    `seed` fixes the draws.
    """

    def __init__(self, fitted: FittedModel, pool: Pool, asked: Sequence[Asked], seed: int) -> None:
        given = fitted.model.observations
        self.whitenings = pool.tried
        # Of what is held or has no slope nothing is left here: a determinant of it would be none.
        self._fitted = orthonormal(pool.seen(given, fitted.model.jacobian(fitted.result.values)), UNDETERMINED)
        self._left = pool.seen(given, fitted.unexplained())
        self._price = np.array([each.price for each in asked])
        # Gains fall off by the degrees that are left: of few data even noise leaves next to nothing beside an effect.
        data, taken = self._fitted.shape
        widths = np.array([each.columns.shape[2] for each in asked])
        self._beyond = _BEYOND * widths * data / np.maximum(data - taken - widths, 1)
        self._groups: list[_Group] = []
        for width in sorted({each.columns.shape[2] for each in asked}):
            alike = [(place, each.columns) for place, each in enumerate(asked) if each.columns.shape[2] == width]
            columns = np.concatenate([of_effect for _, of_effect in alike], axis=1)
            # No gain depends on their size, of which the square may be too large for single precision.
            size = np.linalg.norm(columns, axis=0)
            columns = columns / np.where(size > 0.0, size, 1.0)
            choices = [of_effect.shape[1] for _, of_effect in alike]
            places = np.array([place for place, _ in alike], dtype=np.intp)
            first = np.concatenate([[0], np.cumsum(choices)[:-1]]).astype(np.intp)
            self._groups.append(_Group(places, columns, first))
        self._rng = np.random.default_rng([seed, 7])
        self._batches: list[FloatArray] = []

    @cached_property
    def gained(self) -> FloatArray:
        """How much less -2 log L is with each effect than without, its price paid, (effects,)."""
        return self.gains(self._left[:, None])[:, 0]

    def probability(self, effect: int) -> float:
        """That the best of all effects gains as much as this one where correlated noise is all there is."""
        gained = float(self.gained[effect])
        if gained > self._beyond[effect]:
            return 0.0
        as_good, p_value = self._found(gained)
        while as_good < _ENOUGH and len(self._batches) < len(DRAWS):
            self._batches.append(self._gained_by_chance(DRAWS[len(self._batches)]))
            as_good, p_value = self._found(gained)
        return p_value

    def _found(self, gained: float) -> tuple[int, float]:
        """How many of the draws so far gain as much, and the probability of it."""
        drawn = np.concatenate([np.zeros(0), *self._batches])
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
        narrow = [each.columns.reshape(len(residuals), -1).T.astype(precision) for each in self._groups]
        # Nor does any gain depend on theirs: squares of what a fit leaves of an exact curve would be none.
        residuals = residuals / np.maximum(np.linalg.norm(residuals, axis=0), _LEAST)
        for whitenings, laws in itertools.groupby(self._tried, lambda law: law.whitenings):
            turned = whitenings.turned(residuals.astype(precision))
            for law in laws:
                scale, basis = law.scale.astype(precision)[:, None], law.basis.astype(precision)
                left = turned * scale
                left = left - basis @ (basis.T @ left)
                rss = np.maximum(np.sum(left**2, axis=0), np.finfo(precision).tiny)
                alone = np.minimum(alone, len(left) * np.log(rss) + law.determinant)
                weighted = whitenings.turned_back(left * scale)
                for group, columns, root in zip(self._groups, narrow, law.roots, strict=True):
                    taken = _taken((columns @ weighted).reshape(*root.shape[:2], -1), root.astype(precision))
                    # Of the choices of an effect the one that takes most: they have one price.
                    rest = np.maximum(
                        rss - np.maximum.reduceat(taken, group.first, axis=0),
                        np.maximum(_NOTHING * rss, np.finfo(precision).tiny),
                    )
                    cost = len(left) * np.log(rest) + law.determinant
                    beside[group.effects] = np.minimum(beside[group.effects], cost)
        return np.asarray(alone - beside - self._price[:, None], dtype=np.float64)

    @cached_property
    def _tried(self) -> list[_Law]:
        """The correlations that effects are compared in."""
        tried = []
        for whitenings in self.whitenings:
            fitted = whitenings.turned(self._fitted)
            turned = [_Turned.of(whitenings.turned(each.columns)) for each in self._groups]
            for scale, determinant in itertools.islice(whitenings.strengths(), 0, None, EVERY):
                basis = np.linalg.qr(fitted * scale[:, None])[0]
                roots = tuple(each.root(scale, basis) for each in turned)
                tried.append(_Law(whitenings, scale, determinant, basis, roots))
        return tried

    def sigma(self, columns: FloatArray) -> FloatArray:
        """Standard uncertainties (d,) of what columns (seen, d) are multiplied by, in the
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

    def _gained_by_chance(self, count: int) -> FloatArray:
        """By the best of all effects, in draws of correlated noise as the data leave it possible, (count,)."""
        laws, weights = self._laws
        drawn = [
            # But for its size, on which no gain depends.
            whitenings.coloured(self._rng.standard_normal((len(scale), times)), scale)
            for (whitenings, scale), times in zip(laws, self._rng.multinomial(count, weights), strict=True)
            if times
        ]
        # In single precision: a gain is compared with that in the data, to which none is as near.
        return np.asarray(self.gains(np.hstack(drawn), np.float32).max(axis=0))

    @property
    def _likeliest(self) -> tuple[Whitenings, FloatArray]:
        """The likeliest correlation where nothing is hidden, and what makes it white."""
        laws, weights = self._laws
        return laws[int(np.argmax(weights))]

    @cached_property
    def _laws(self) -> tuple[list[tuple[Whitenings, FloatArray]], FloatArray]:
        """Every correlation, with what makes it white, and how probable each is where nothing is hidden.

        By restricted likelihood: data tell little of how slow noise is, and draws of the likeliest law alone are
        tamer than a walk.
        """
        laws, costs = [], list[float]()
        for whitenings in self.whitenings:
            for scale, determinant in whitenings.strengths():
                fitted, root = np.linalg.qr(whitenings.turned(self._fitted) * scale[:, None])
                left = whitenings.turned(self._left) * scale
                left = left - fitted @ (fitted.T @ left)
                free = len(left) - fitted.shape[1]
                laws.append((whitenings, scale))
                costs.append(
                    free * np.log(max(float(left @ left), _LEAST))
                    + determinant
                    + 2.0 * np.sum(np.log(np.abs(np.diag(root))))
                )
        weights = np.exp(-0.5 * (np.array(costs) - min(costs)))
        return laws, weights / weights.sum()


class ChanceOfNoise:
    """How probable it is that noise is correlated and alone shows what effects beside a fit do (`groups`, which cost
    `price_of`), and what plain shapes (`generic`) do."""

    def __init__(
        self, fitted: FittedModel, pool: Pool, groups: Groups, price_of: Price, generic: Generic, seed: int
    ) -> None:
        self._fitted, self._pool, self._seed = fitted, pool, seed
        self._groups, self._price_of, self._generic = groups, price_of, generic

    def in_doubt(self, p_value: float) -> bool:
        """Whether a corrected p-value is to be held to what correlated noise alone shows."""
        return p_value < DOUBTFUL

    def of_effect(self, candidate: Candidate) -> float:
        """That the best of all effects does as well as a candidate's by chance; 0 for what slow noise never does."""
        if not self._is_shown(candidate.derivative):
            return 0.0
        alone, places = self._effects
        return CORRELATED * min(alone.probability(place) for place in places[candidate.term.effect])

    def sigma(self, candidate: Candidate) -> FloatArray:
        """Standard uncertainties (d,) of a candidate's parameters in the noise that is likeliest alone."""
        return self._effects[0].sigma(self._pool.seen(self._given, candidate.derivative))

    def of_shape(self, columns: FloatArray) -> float:
        """That the best of all plain shapes does as well as this one, (n, k), by chance."""
        return self._of_shapes if self._is_shown(columns) else 0.0

    @cached_property
    def of_projected(self) -> float:
        """That by chance as much goes along all that was projected out before the noise was estimated."""
        basis = self._pool.basis
        left, length, _ = svd(basis - self._beside @ (self._beside.T @ basis))
        left = left[:, length > _BESIDE]
        if not left.shape[1]:
            return CORRELATED
        along = left @ (left.T @ in_units(self._given, self._pool.where, self._fitted.unexplained()))
        if not self._is_shown(from_units(self._given, self._pool.where, along[:, None])):
            return 0.0
        return CORRELATED * self._alone([self._asked(from_units(self._given, self._pool.where, left))]).probability(0)

    def _price(self, candidate: Candidate) -> float:
        return 2.0 * self._price_of(candidate, len(candidate.names))

    def _is_shown(self, columns: FloatArray) -> bool:
        """Whether blocks of neighbours, where the noise is looked for in these, show most of what columns (n, d) are
        beside the fit: what is faster is no matter of slow noise."""
        if self._pool.sees_all:
            return True
        beside = in_units(self._given, self._pool.where, columns)
        beside = beside - self._beside @ (self._beside.T @ beside)
        seen = self._pool.seen(self._given, from_units(self._given, self._pool.where, beside))
        return float(np.sum(seen**2)) >= _SHOWN * float(np.sum(beside**2))

    @cached_property
    def _given(self) -> Observations:
        return self._fitted.model.observations

    @cached_property
    def _beside(self) -> FloatArray:
        """Orthonormal basis of what is fitted, in units of the given sigma."""
        jacobian = self._fitted.model.jacobian(self._fitted.result.values)
        return orthonormal(in_units(self._given, self._pool.where, jacobian), UNDETERMINED)

    @cached_property
    def _of_shapes(self) -> float:
        shapes = self._generic.main_columns(self._pool.where)
        alone = self._alone([self._asked(column[:, None]) for column in shapes.T])
        return CORRELATED * alone.probability(int(np.argmax(alone.gained)))

    @cached_property
    def _effects(self) -> tuple[NoiseAlone, dict[str, list[int]]]:
        asked: list[Asked] = []
        places: dict[str, list[int]] = {}
        for effect, groups in self._groups.items():
            for group in groups:
                width = len(group[0].names)
                together = max(_NUMBERS // (len(self._given.value) * width), 1)
                parts = [
                    np.stack([each.derivative for each in group[first : first + together]], axis=1)
                    for first in range(0, len(group), together)
                ]
                columns = np.concatenate([self._pool.seen(self._given, part) for part in parts], axis=1)
                places.setdefault(effect, []).append(len(asked))
                asked.append(Asked(columns, self._price(group[0])))
        return self._alone(asked), places

    def _asked(self, columns: FloatArray) -> Asked:
        """Columns (n, d) that cost nothing, with one choice."""
        return Asked(self._pool.seen(self._given, columns[:, None]), 0.0)

    def _alone(self, asked: Sequence[Asked]) -> NoiseAlone:
        return NoiseAlone(self._fitted, self._pool, asked, self._seed)


@dataclass(frozen=True)
class _Group:
    """Effects with columns of equal number: their places, the columns (seen, choices of all, d) at unit length, and
    where the choices of each begin."""

    effects: IntArray
    columns: FloatArray
    first: IntArray


@dataclass(frozen=True)
class _Law:
    """A correlation: what makes turned data white, the logarithm of its determinant, an orthonormal `basis` (seen, m)
    of what is fitted in white data, and of each group what makes columns beside it orthonormal, (choices, d, d)."""

    whitenings: Whitenings
    scale: FloatArray
    determinant: float
    basis: FloatArray
    roots: tuple[FloatArray, ...]


@dataclass(frozen=True)
class _Turned:
    """Columns (seen, choices, d) and, where these are few, products of each two of a choice, (choices, seen)."""

    columns: FloatArray
    products: Mapping[tuple[int, int], FloatArray]

    @classmethod
    def of(cls, columns: FloatArray) -> _Turned:
        """With their products, which many choices share between laws; wide ones are few choices."""
        few = columns.shape[2] if columns.shape[2] <= _FEW_COLUMNS else 0
        pairs = itertools.combinations_with_replacement(range(few), 2)
        return cls(columns, {(i, j): (columns[:, :, i] * columns[:, :, j]).T for i, j in pairs})

    def root(self, scale: FloatArray, fitted: FloatArray) -> FloatArray:
        """What makes columns that `scale` (seen,) whitens orthonormal beside what is `fitted`, (choices, d, d)."""
        _, count, width = self.columns.shape
        gram = np.empty((count, width, width))
        for (i, j), product in self.products.items():
            gram[:, i, j] = gram[:, j, i] = product @ scale**2
        if not self.products:
            white = self.columns * scale[:, None, None]
            gram = white.transpose(1, 2, 0) @ white.transpose(1, 0, 2)
        size = np.einsum("kii->ki", gram).copy()
        along = np.tensordot(fitted * scale[:, None], self.columns, axes=(0, 0))
        gram -= np.einsum("mki,mkj->kij", along, along, optimize=True)
        free = np.einsum("kii->ki", gram)
        seen = free > ABSORBED**2 * size
        unit = np.where(seen, 1.0 / np.sqrt(np.where(seen, free, 1.0)), 0.0)
        if width == 1:
            return unit[:, :, None]
        return unit[:, :, None] * inverse_root(gram * unit[:, :, None] * unit[:, None, :], seen)[0]


def _taken(along: NDArray[np.floating], root: NDArray[np.floating]) -> NDArray[np.floating]:
    """By how much columns lower the square sums of what is left, (k, draws), whose products with it are `along`."""
    if along.shape[1] == 1:
        return np.asarray((along[:, 0] * root[:, 0]) ** 2)
    return np.asarray(np.sum((root.transpose(0, 2, 1) @ along) ** 2, axis=1))
