"""P-values where what is left has heavier tails than a normal distribution: the residuals are permuted.

A single wild reading at the end of a column is an exponential, or a step, to a test that expects normal noise. Where
readings are exchangeable, what the same residuals would show in any other order tells how often chance does it
(Freedman and Lane, J. Business and Economic Statistics 1 (1983) 292: residuals of the model without the effect).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import special

from rigctl.analysis.column_sums import LARGE
from rigctl.core.arrays import FloatArray

PERMUTATIONS = 2000
HEAVY_FROM = 0.05
"""Level of the test of kurtosis (Anscombe and Glynn) at which tails count as heavy."""

# Below, the test of kurtosis does not hold.
_ROWS = 20
_EXCESS = 0.5
"""Of the kurtosis: less of it changes no p-value worth mentioning, and in long columns the test sees far less."""
# The share of the permutations in whose tail smaller probabilities are looked for.
_TAIL = 0.025

_MANY, _PERMUTATIONS_LEAST = 100_000_000, 200
"""Numbers permuted in all of long columns, and the least permutations of them."""

_AT_ONCE = 1 << 22

Smallest = Callable[[NDArray[np.float32]], FloatArray]
"""The smallest p of some questions in draws (draws, n) of what is left."""


def is_heavy_tailed(left: FloatArray) -> bool:
    """Whether residuals (n,) have more in their tails than a normal distribution would."""
    if len(left) < _ROWS or not np.ptp(left) > 0.0:
        return False
    kurtosis = _kurtosis(left)
    if len(left) > LARGE and kurtosis < 3.0 + _EXCESS:
        return False
    return p_of_kurtosis(len(left), kurtosis) < HEAVY_FROM


def _kurtosis(left: FloatArray) -> float:
    squares = (left - left.mean()) ** 2
    return float(np.mean(squares**2) / np.mean(squares) ** 2)


def p_of_kurtosis(count: int, kurtosis: float) -> float:
    """That so many normal numbers have as large a kurtosis (Anscombe and Glynn, Biometrika 70 (1983) 227).

    As `scipy.stats.kurtosistest`, whose import takes longer than most comparisons.
    """
    n = float(count)
    variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) ** 2 * (n + 3.0) * (n + 5.0))
    standard = (kurtosis - 3.0 * (n - 1.0) / (n + 1.0)) / np.sqrt(variance)
    skewness = 6.0 * (n**2 - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0))
    skewness *= np.sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)))
    degrees = 6.0 + 8.0 / skewness * (2.0 / skewness + np.sqrt(1.0 + 4.0 / skewness**2))
    below = 1.0 + standard * np.sqrt(2.0 / (degrees - 4.0))
    normal = (1.0 - 2.0 / (9.0 * degrees) - np.cbrt((1.0 - 2.0 / degrees) / below)) / np.sqrt(2.0 / (9.0 * degrees))
    return float(special.ndtr(-normal))


@dataclass(frozen=True)
class Tail:
    """How small the smallest p of a family is by chance: its values in permutations, sorted, (permutations,)."""

    smallest: FloatArray

    def probability(self, p_value: float) -> float:
        """Of one as small as that; beyond the permutations' tail by the power law that the tail follows (Hill)."""
        count = int(_TAIL * len(self.smallest))
        edge = max(float(self.smallest[count]), np.finfo(float).tiny)
        if p_value >= edge:
            return float(np.mean(self.smallest <= p_value))
        below = np.log(edge / np.maximum(self.smallest[:count], np.finfo(float).tiny))
        # At most 1, as of normal noise.
        power = 1.0 / max(float(np.mean(below)), 1.0)
        return _TAIL * float((max(p_value, np.finfo(float).tiny) / edge) ** power)


class Permuted:
    """Residuals `left` (n,), whitened and exchangeable, in other orders; `seed` fixes them."""

    def __init__(self, left: FloatArray, seed: int) -> None:
        self._left, self._seed = left, seed
        self._tails: dict[str, Tail] = {}
        # Orders of long columns are drawn anew whenever they are asked for, a few at a time.
        self._kept = list(self._drawn()) if len(left) <= LARGE else None

    def probability(self, of: str, smallest: Smallest, statistic: float, dimension: int) -> float:
        """That a family or kind (`of`), which gives its `smallest` p in draws, shows as much by chance."""
        if of not in self._tails:
            found = [smallest(draws) for draws in self._kept or self._drawn()]
            self._tails[of] = Tail(np.sort(np.concatenate(found)))
        return self._tails[of].probability(float(special.chdtrc(dimension, statistic)))

    def p_of_share(self, frame: FloatArray, fitted: FloatArray) -> float:
        """That what is left goes as far along `frame` (n, p), outside of what is `fitted` (n, m), by chance."""
        wide, narrow = frame.astype(np.float32), fitted.astype(np.float32)
        total, here = float(self._left @ self._left), float(np.sum(np.square(frame.T @ self._left)))
        as_far, count = 0, 0
        for draws in self._kept or self._drawn():
            within = np.sum(np.square(draws @ wide), axis=1)
            along = within - np.sum(np.square(draws @ narrow), axis=1)
            as_far += int(np.sum(along / (total - within) >= here / (total - here)))
            count += len(draws)
        return (1 + as_far) / (1 + count)

    def _drawn(self) -> Iterator[NDArray[np.float32]]:
        """Permutations (draws, n), together fewer of long columns."""
        n, left = len(self._left), self._left.astype(np.float32)
        count = int(np.clip(_MANY // n, _PERMUTATIONS_LEAST, PERMUTATIONS))
        if n <= LARGE:
            yield left[_orders(self._seed, count, n)]
            return
        rng, at_once = _stream(self._seed), max(_AT_ONCE // n, 1)
        for first in range(0, count, at_once):
            yield rng.permuted(np.tile(left, (min(at_once, count - first), 1)), axis=1)


# All models of a table leave as many residuals: kept for the next one.
@lru_cache(maxsize=1)
def _orders(seed: int, count: int, n: int) -> NDArray[np.uint16]:
    """So many orders of n residuals, (count, n)."""
    return _stream(seed).permuted(np.tile(np.arange(n, dtype=np.uint16), (count, 1)), axis=1)


def _stream(seed: int) -> np.random.Generator:
    """A stream of its own, see `trials`."""
    return np.random.default_rng([seed, 5])
