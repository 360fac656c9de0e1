"""What attempts with one study have in common."""

from __future__ import annotations

from collections.abc import Callable, Hashable

import numpy as np

from rigctl.analysis.correlated_groups import Triangle
from rigctl.analysis.relaxation_factor import RelaxationFactor
from rigctl.core.arrays import FloatArray
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.generic import Generic
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.pool_order import PoolOrder, pool_orders
from rigctl.workbench.verdict.trials import Trials

# Of a ratio of sigmas that is the same for all data but for their last digit.
_ROUNDING = 1e-13


class Shared:
    """Plain shapes and orders of the same observations; trials of the same questions in noise of another scale."""

    def __init__(self) -> None:
        self._generic: dict[int, Generic] = {}
        self._orders: dict[int, tuple[Observations, list[PoolOrder]]] = {}
        self._trials: dict[Hashable, list[tuple[Noise, Trials]]] = {}

    def generic(self, given: Observations) -> Generic:
        """The plain shapes of some observations."""
        return self._generic.setdefault(id(given), Generic(given))

    def orders(self, given: Observations) -> list[PoolOrder]:
        """Along which the noise of some observations may be correlated."""
        if id(given) not in self._orders:
            self._orders[id(given)] = given, pool_orders(given)
        return self._orders[id(given)][1]

    def trials(self, asked: Hashable, noise: Noise, count: Callable[[], Trials]) -> Trials:
        """What `count` gives of the questions that are `asked`, once for all noise that differs by a factor: neither
        what a model spans nor what a candidate adds to it changes by that."""
        known = self._trials.setdefault(asked, [])
        for other, counted in known:
            if _differ_by_a_factor(noise, other):
                return counted
        known.append((noise, count()))
        return known[-1][1]


def _differ_by_a_factor(one: Noise, other: Noise) -> bool:
    if len(one.sigma) != len(other.sigma) or len(one.factors) != len(other.factors):
        return False
    factors = zip(one.factors, other.factors, strict=True)
    return common_ratio(one.sigma, other.sigma) is not None and all(
        np.array_equal(mine[0], its[0]) and _are_equal(mine[1], its[1]) for mine, its in factors
    )


def _are_equal(one: Triangle, other: Triangle) -> bool:
    if isinstance(one, RelaxationFactor) or isinstance(other, RelaxationFactor):
        return one is other
    return np.array_equal(one, other)


def common_ratio(one: FloatArray, other: FloatArray) -> float | None:
    """The factor between sigmas where it is the same for all; None where not."""
    ratio = one / other
    return float(ratio[0]) if np.ptp(ratio) <= _ROUNDING * ratio[0] else None
