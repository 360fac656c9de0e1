"""The noise estimated from residuals: never assumed white, never assumed known.

Sigmas that come from a run's own spectrum are taken as they are, with their degrees of freedom. Where a pool of data
has none (a mean, a table's readings), its scale and its correlation from run to run come from the scatter: restricted
maximum likelihood after everything that could be a signal has been projected out, so that a hidden effect neither
inflates the noise nor poses as red noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.groups import Groups
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.fitted_model import FittedModel
from rigctl.workbench.verdict.generic import Generic
from rigctl.workbench.verdict.kernels import SlowNoise
from rigctl.workbench.verdict.noise import Correlation, Noise
from rigctl.workbench.verdict.noise_pool import EVEN_ODDS, WHITE, Pool
from rigctl.workbench.verdict.offsets import in_units, with_offsets
from rigctl.workbench.verdict.pool_order import PoolOrder, pool_orders
from rigctl.workbench.verdict.saturated import Hidden, above_rounding

ROUNDS = 2
"""Fit, noise from what is left, fit again with that noise."""

# An effect with more choices is a scan: all of them together would span everything.
_SCANNED = 3
# Data of independent noise beyond which nothing hidden is projected out: what is just significant adds less than a
# part in five hundred to their variance, and what is more is found, and the noise told anew.
_SATURATED = 20_000


class NoiseEstimator:
    """Estimates the noise of one set of observations from the residuals of any fit.

    `required` (n, m) are the derivatives of what is fitted, `possible` gives those of what might be hidden at
    some of the data, in order of precedence; both are projected out of each pool that needs its
    scatter, the latter as far as there is room. `orders` are those of the pools, where they have been made.
    """

    def __init__(
        self,
        observations: Observations,
        required: FloatArray,
        possible: Callable[[IntArray], Sequence[Hidden]],
        orders: Sequence[PoolOrder] | None = None,
    ) -> None:
        self._given = observations
        orders = pool_orders(observations) if orders is None else orders
        self._pools = [Pool(observations, order, required, possible) for order in orders]
        dof = np.array([pool.dof for pool in observations.pools])[observations.pool_of]
        self._dof = np.where(dof > 0.0, dof, np.inf)
        self._beside = np.array([not pool.of_these for pool in observations.pools])[observations.pool_of]

    @property
    def from_scatter(self) -> bool:
        """True when some sigma is not known beforehand."""
        return bool(self._pools)

    @property
    def correlated(self) -> bool:
        """True when some noise may be correlated from run to run."""
        return any(pool.order.correlated for pool in self._pools)

    @property
    def saturated(self) -> FloatArray | None:
        """Basis of all that was projected out, (n, p), where one pool of independent noise holds all data."""
        return self._pools[0].basis if self.of_one_pool and not self.correlated else None

    @property
    def of_one_pool(self) -> bool:
        """True when one pool holds all data, which share no offset: whitened, none of them is unlike the others."""
        return len(self._pools) == 1 and not self._given.offsets and len(self._pools[0].where) == len(self._dof)

    @property
    def whole_pool(self) -> Pool | None:
        """The pool that holds all data, where they may be correlated along an order."""
        if len(self._pools) != 1 or len(self._pools[0].where) < len(self._dof):
            return None
        return self._pools[0] if self.correlated else None

    @property
    def dof(self) -> float:
        """Degrees of freedom of all scales together that come from the scatter."""
        return float(sum(pool.dof for pool in self._pools))

    @property
    def rows(self) -> IntArray:
        """Data whose noise comes from the scatter."""
        return np.concatenate([np.zeros(0, dtype=np.intp), *(pool.where for pool in self._pools)])

    def estimate(self, residuals: FloatArray) -> Noise:
        """The noise estimated from residuals (n,) of a fit."""
        return next(self.estimates(residuals[:, None]))

    def estimates(self, several: FloatArray) -> Iterator[Noise]:
        """The same from `several` residuals (n, k), one after the other."""
        of_pools = [pool.estimates(in_units(self._given, pool.where, several[pool.where])) for pool in self._pools]
        for _ in range(several.shape[1]):
            yield self._noise([next(each) for each in of_pools])

    def _noise(self, estimated: Sequence[tuple[float, list[tuple[float, Correlation]]]]) -> Noise:
        """The noise where pools have these scales and weighted correlations."""
        sigma, dof = self._given.sigma.copy(), self._dof.copy()
        # Below, the factor under the root runs away: such sigmas stay as they are, and their degrees say the rest.
        known = np.isfinite(dof) & (dof > 4.0) & self._beside
        # A sigma from few degrees of freedom understates: Student's t has the variance nu / (nu - 2). One that these
        # data told went up and down with them: their square sum over it has no such tail.
        sigma[known] *= np.sqrt(dof[known] / (dof[known] - 2.0))
        factors = list(self._given.factors)
        correlations, slow = [], list[SlowNoise]()
        for pool, (scale, weighted) in zip(self._pools, estimated, strict=True):
            sigma[pool.where] *= scale
            dof[pool.where] = pool.dof
            # Told is the likeliest; whitened is with their weighted mean (decision 014).
            correlations.append(max(weighted, key=lambda pair: pair[0])[1])
            # Built from all of them: a single best correlation jumps from white to red by chance.
            factors += pool.factors(weighted)
            slow += [law for law in [pool.slow(weighted)] if law is not None]
        least = (self._pools[0].least_scale / estimated[0][0]) ** 2 if len(self._pools) == 1 else 0.0
        noise = Noise(sigma, dof, tuple(factors), tuple(correlations), slow=tuple(slow), least=least)
        return with_offsets(self._given, noise)

    def beside_fit(self, jacobian: FloatArray, residuals: FloatArray, now: Noise) -> Noise:
        """The noise as what a fit leaves tells it beside nothing but the fit's own `jacobian` (n, m).

        Of pools that may be correlated; all else is as `now`.
        What might be hidden takes most of what data know of slow noise with it: what is found beside it is a fair
        measure to search with, but of a parameter that goes slowly it gives too small an uncertainty (decision 078).
        """
        asked = [pool for pool in self._pools if pool.order.correlated]
        if not asked:
            return now
        sigma, factors = now.sigma.copy(), list(self._given.factors)
        for pool in asked:
            alone = Pool(self._given, pool.order, jacobian, lambda _: ())
            scale, weighted = alone.estimate(in_units(self._given, pool.where, residuals[pool.where]), EVEN_ODDS)
            sigma[pool.where] = self._given.sigma[pool.where] * scale
            factors += alone.factors(weighted)
        return Noise(sigma, now.dof, tuple(factors), now.correlations)

    def as_if_white(self, residuals: FloatArray) -> Noise:
        """The noise if all scatter were white: what of `estimate` correlations along an order are left out of."""
        noise = self.estimate(residuals)
        sigma = noise.sigma.copy()
        for pool in self._pools:
            left = in_units(self._given, pool.where, residuals[pool.where])
            sigma[pool.where] = self._given.sigma[pool.where] * pool.white_scale(left)
        white = Noise(sigma, noise.dof, self._given.factors, tuple(WHITE for _ in self._pools))
        return with_offsets(self._given, white)

    def likeliest(self, left: FloatArray, now: Noise) -> Noise:
        """The noise of residuals (n,) by ordinary maximum likelihood: scale and correlation in the form that pools
        have `now`, sigmas that are known beforehand as they are now."""
        sigma, factors, correlations = now.sigma.copy(), list(self._given.factors), []
        for pool, correlation in zip(self._pools, now.correlations, strict=True):
            weights = self._given.sigma[pool.where]
            scale, likelier = pool.likeliest(in_units(self._given, pool.where, left[pool.where]), correlation)
            sigma[pool.where] = weights * scale
            correlations.append(likelier)
            factors += pool.factors([(1.0, likelier)])
        return Noise(sigma, now.dof, tuple(factors), tuple(correlations))


def estimator_of(
    fitted: FittedModel, asked: Callable[[], Groups], generic: Generic, orders: Sequence[PoolOrder]
) -> NoiseEstimator:
    """What is hidden may be in the catalogue, or of any plain shape; scans are too many to project out."""
    given = fitted.model.observations

    @cache
    def few() -> Hidden:
        candidates = [
            each
            for groups in asked().values()
            if sum(map(len, groups)) <= _SCANNED
            for each in itertools.chain(*groups)
        ]
        named = [(each.whole() if each.whole else each.derivative, each.whole is not None) for each in candidates]
        return Hidden.of(named, len(given.value))

    def possible(where: IntArray) -> list[Hidden]:
        if len(where) > _SATURATED and all(pool.order is None for pool in given.pools):
            return []
        named, shapes = few(), generic.main_columns(where)
        large = above_rounding(named.columns, where, given.sigma)
        return [named.keep(named.columns[where], large), Hidden(shapes, np.arange(shapes.shape[1]))]

    return NoiseEstimator(given, fitted.model.jacobian(fitted.result.values), possible, orders)


def with_estimated_noise(fitted: FittedModel, estimator: NoiseEstimator) -> list[FittedModel]:
    """Fitted again with the noise of what is left, where that is not known beforehand: all the fits, in order."""
    if not estimator.from_scatter and not np.isfinite(estimator.estimate(fitted.unexplained()).dof).any():
        return [fitted]
    fits = [fitted]
    for _ in range(ROUNDS if estimator.from_scatter else 1):
        fits.append(fits[-1].with_noise(estimator.estimate(fits[-1].unexplained())))
    return fits


def with_estimated_noise_again(
    fitted: FittedModel, estimator: NoiseEstimator, ends: Sequence[Mapping[str, float]]
) -> list[FittedModel]:
    """The same fits from the values where those after the first have ended."""
    fits = [fitted]
    for values in ends:
        noise = estimator.estimate(fits[-1].unexplained())
        fits.append(FittedModel.where_it_ended(fitted.model, noise, fitted.held, values))
    return fits
