"""Along which order the data of a pool may be correlated: what is the same of every model of these data."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from rigctl.analysis.correlated_groups import Factor
from rigctl.analysis.relaxation_factor import RelaxationFactor
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import DataError
from rigctl.workbench.scatter import LEAST_DOF
from rigctl.workbench.study import NoisePool, Observations
from rigctl.workbench.verdict.kernels import LARGEST_MATRIX, Strengths, kernel, summed
from rigctl.workbench.verdict.neighbours import Neighbours, blocks, stretch
from rigctl.workbench.verdict.saturated import SATURATED_SHARE

EXPONENTS = (1.0, 1.64, 2.4)
"""Of power laws 1/f^a: flicker; what precision accelerometers show; near a random walk."""

TIME_CONSTANTS = 6

LARGEST_POOL = LARGEST_MATRIX
"""Beyond, the correlation is looked for in a stretch of so many data, and in so many means of neighbours: kernels are
decomposed at a cost that grows as the cube."""

MOST_CORRELATED = 200_000
"""Data that are correlated with each other: more than a gigabyte for each model that is kept."""

MOST_MIXED = 2000
"""Data with shared offsets whose slow noise is worked out as it is in the data, with matrices of all of them."""

STEP = 100
"""Of that number, where what is projected out asks for more."""


class PoolOrder:
    """The data `where` of one pool along the covariate `name`, None for a pool that has no order."""

    def __init__(self, given: Observations, where: IntArray, name: str | None) -> None:
        self.where = where
        self.name = name
        self.group = given.group_of[where]
        self._at = _usable(given.of_runs(name)[where]) if name is not None else None
        # What is slow is so in the data themselves: in what they are without the offsets that they share it is mixed.
        mixed = given.offsets and len(where) == len(given.value) <= MOST_MIXED
        self._offsets = given.correlated if mixed else None
        self._scatters: dict[str, float] = {}
        self._own = 1.0 - sum(each.share**2 for each in given.offsets)
        self._made: dict[tuple[str, bytes], FloatArray] = {}
        self._looked_at: dict[int, list[Neighbours]] = {}
        self._last: tuple[Strengths, list[Factor]] | None = None
        self._decomposed: dict[tuple[str, Neighbours], tuple[FloatArray, FloatArray]] = {}

    @property
    def correlated(self) -> bool:
        """Whether there is an order along which to be correlated."""
        # Of fewer times no correlation can be told from a level.
        return self._at is not None and len(np.unique(self._at)) >= 4

    @cached_property
    def kernels(self) -> list[str]:
        """Names of those that are tried."""
        if not self.correlated:
            return []
        constants = np.geomspace(*self.time_scales, TIME_CONSTANTS)
        return [f"exp {constant!r}" for constant in map(float, constants)] + [f"power {a:g}" for a in EXPONENTS]

    def kernel(self, name: str, members: IntArray) -> FloatArray:
        """What a kernel adds to R per strength: its correlation, or, beside offsets that all data share, what that
        puts in the place of white noise."""
        if name not in self.kernels:
            return self._make(name, members)
        key = (name, members.tobytes())
        if key not in self._made:
            self._made[key] = self._make(name, members)
        return self._made[key]

    def looked_at(self, fitted: int) -> list[Neighbours]:
        """In what a correlation is looked for beside so many columns: in all data, or, of many, in a stretch of them
        and then in blocks of all, which show what is slow."""
        # Models of the same data that differ by a few columns share what was decomposed.
        data, most = len(self.where), max(LARGEST_POOL, -(-3 * fitted // STEP) * STEP)
        if most not in self._looked_at:
            self._looked_at[most] = [stretch(data, min(data, most))]
            if data > most and self.correlated:
                assert self._at is not None
                self._looked_at[most].append(blocks(self._at, self.group, -(-data // most)))
        return self._looked_at[most]

    def decomposed(self, name: str, neighbours: Neighbours) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues and eigenvectors of that kernel between blocks of neighbours."""
        known = self._decomposed.get((name, neighbours))
        if known is None:
            assert self._at is not None
            known = np.linalg.eigh(self._between(name, neighbours))
            if len(neighbours.first) <= LARGEST_POOL:
                self._decomposed[name, neighbours] = known
        return known

    def _between(self, name: str, neighbours: Neighbours) -> FloatArray:
        assert self._at is not None
        if self._offsets is not None:
            of_all = self.kernel(name, np.arange(len(self.where)))
            return neighbours.of(neighbours.of(of_all).T)
        group = self.group[neighbours.members][neighbours.first]
        correlation = neighbours.kernel(name, self._at, self.time_scales)
        return np.where(group[:, None] == group[None, :], correlation, 0.0)

    def factors(self, strengths: Strengths) -> list[Factor]:
        """Cholesky factors of R = 1 + sum of strength * kernel, group by group; none of white noise."""
        last = self._last
        if last is None or last[0] != strengths:
            # Models of the same data often have the same noise.
            groups = [np.flatnonzero(self.group == group) for group in np.unique(self.group)]
            # Offsets may be shared across groups.
            parts = groups if self._offsets is None else [np.arange(len(self.where))]
            last = self._last = strengths, [self._factor(strengths, members) for members in parts if strengths]
        return last[1]

    def _factor(self, strengths: Strengths, members: IntArray) -> Factor:
        if len(members) > MOST_CORRELATED:
            raise DataError(
                f"the noise of {len(members)} data is correlated along {self.name}, which is worked out for "
                f"{MOST_CORRELATED} at most: average neighbouring ones, or leave out the order to take them as "
                "independent"
            )
        if len(members) > LARGEST_MATRIX and self._offsets is None:
            assert self._at is not None
            rising = members[np.argsort(self._at[members], kind="stable")]
            return rising, RelaxationFactor(self._at[rising], summed(strengths, self.time_scales))
        mean: FloatArray = np.eye(len(members), dtype=np.float64)
        for name, strength in strengths:
            mean = np.asarray(mean + strength * self.kernel(name, members), dtype=np.float64)
        return members, np.asarray(np.linalg.cholesky(mean), dtype=np.float64)

    @cached_property
    def time_scales(self) -> tuple[float, float]:
        """The shortest and the longest time between the data."""
        assert self._at is not None
        ordered = np.unique(self._at)
        return float(np.median(np.diff(ordered))), float(ordered[-1] - ordered[0])

    def _make(self, name: str, members: IntArray) -> FloatArray:
        found = self._correlation(name, members)
        if self._offsets is None:
            return found
        # In place of a part of what is each datum's own: offsets stay as they are beside it.
        own = self._own * (found - _scatter(found) * np.eye(len(found)))
        return np.asarray(self._offsets.solve(self._offsets.solve(own).T))

    def _correlation(self, name: str, members: IntArray) -> FloatArray:
        """Of unit variance between data of one group, 0 between groups."""
        assert self._at is not None
        apart = np.abs(self._at[members][:, None] - self._at[members][None, :])
        same = self.group[members][:, None] == self.group[members][None, :]
        return np.where(same, kernel(name, apart, self.time_scales), 0.0)

    def strength(self, name: str, ratio: float) -> float:
        """How strong a kernel is in R where slow noise has this ratio to white noise."""
        if self._offsets is None or not name:
            return ratio
        if name not in self._scatters:
            self._scatters[name] = _scatter(self._correlation(name, np.arange(len(self.where))))
        # Where offsets were told slow noise was counted by what it scatters over all data.
        return ratio / (1.0 + ratio * self._scatters[name])


def _scatter(correlation: FloatArray) -> float:
    """Variance that noise of this correlation has about its mean."""
    return 1.0 - float(np.mean(correlation))


def pool_orders(given: Observations) -> list[PoolOrder]:
    """Of those pools whose noise comes from the scatter."""
    members = [np.flatnonzero(given.pool_of == number) for number in range(len(given.pools))]
    return [
        PoolOrder(given, where, pool.order)
        for pool, where in zip(given.pools, members, strict=True)
        if pool.dof <= 0.0 and len(where) and not stays_as_stated(pool, len(where))
    ]


def stays_as_stated(pool: NoisePool, data: int) -> bool:
    """Whether the scatter of so many data says too little to correct sigmas that are stated.

    By the data that are left once all is projected out that might be hidden: the same for every model.
    """
    return pool.stated and SATURATED_SHARE * data < LEAST_DOF


def _usable(order: FloatArray) -> FloatArray | None:
    """Times along which noise is correlated; None when some are unknown."""
    return order if np.isfinite(order).all() else None
