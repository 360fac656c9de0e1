"""Equivalent degrees of freedom of the Allan family, which make its confidence intervals.

C. A. Greenhall and W. J. Riley, "Uncertainty of stability variances based on finite differences", Proc. 35th PTTI
(2003), pp. 267-278, which W. J. Riley, NIST Special Publication 1065 (2008), section 5.4, recommends. `alpha` is the
exponent of the spectral density of the samples, from 2 to -4, `order` that of the difference: 2 Allan, 3 Hadamard.

The paper's phase is averaged over one sample, as an instrument of limited bandwidth does. At an averaging factor of 1
discrete noise has up to a quarter more or fewer degrees of freedom, above 3 the difference is a few per cent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, comb, inf, log

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError

_LONGEST_SUM = 100
"""Terms of a sum that are still taken one by one."""

# The paper's Tables 1 (modified) and 2 (unmodified): a0, a1 of 1/edf = (a0 - a1 / r) / r.
_MODIFIED = {
    2: {2: (7 / 9, 1 / 2), 1: (0.997, 0.616), 0: (1.033, 0.607), -1: (1.048, 0.534), -2: (1.302, 0.535)},
    3: {
        2: (22 / 25, 2 / 3),
        1: (1.141, 0.843),
        0: (1.184, 0.848),
        -1: (1.180, 0.816),
        -2: (1.175, 0.777),
        -3: (1.194, 0.703),
        -4: (1.489, 0.702),
    },
}
_UNMODIFIED = {
    2: {1: (790.0, 410.0), 0: (2 / 3, 1 / 3), -1: (0.852, 0.375), -2: (1.079, 0.368)},
    3: {
        1: (9950.0, 6520.0),
        0: (7 / 9, 1 / 2),
        -1: (0.997, 0.617),
        -2: (1.033, 0.607),
        -3: (1.053, 0.553),
        -4: (1.302, 0.535),
    },
}
# Table 3: b0, b1 of the flicker phase correction.
_FLICKER_PHASE = {2: (15.23, 12.0), 3: (47.8, 40.0)}


@dataclass(frozen=True)
class Estimate:
    """An overlapping estimate: order of the difference, averaging factor, number of integrated samples."""

    order: int
    factor: int
    points: int
    modified: bool = False

    @property
    def terms(self) -> int:
        """Differences that are averaged: the estimator stride is one sample."""
        # The length of the filter on the integrated samples: L = m / F + m d with F = 1 or m.
        length = self.factor * (self.order + 1) if self.modified else self.factor * self.order + 1
        return 1 + self.points - length


@lru_cache(maxsize=1024)
def degrees_of_freedom(alpha: int, estimate: Estimate) -> float:
    """The equivalent degrees of freedom of an overlapping estimate in noise of a density f^`alpha`.

    `DataError` where noise so steep has no such variance (alpha + 2 order <= 1), or there are no differences.
    """
    if estimate.terms < 1 or alpha + 2 * estimate.order <= 1 or alpha > 2:
        raise DataError(f"no degrees of freedom of a difference of order {estimate.order} in noise f^{alpha}")
    if not estimate.modified and alpha == 2:
        return _white_phase(estimate)
    terms, span = estimate.terms, estimate.terms / estimate.factor
    if min(terms, (estimate.order + 1) * estimate.factor) <= _LONGEST_SUM:
        return _summed(alpha, estimate)
    scale = 1.0
    if not estimate.modified and alpha == 1:
        b0, b1 = _FLICKER_PHASE[estimate.order]
        scale = (b0 + b1 * log(estimate.factor)) ** 2
    if span > estimate.order + 1:
        a0, a1 = (_MODIFIED if estimate.modified else _UNMODIFIED)[estimate.order][alpha]
        return scale * span**2 / (a0 * span - a1)
    return _coarse(alpha, estimate, span, scale)


def _white_phase(estimate: Estimate) -> float:
    """Case 4 of the paper: unmodified, alpha = 2."""
    order, span = estimate.order, estimate.terms / estimate.factor
    blocks, middle = ceil(span), comb(2 * order, order) ** 2
    if blocks > order:
        inverse = comb(4 * order, 2 * order) / middle - order / (2.0 * span)
    else:
        covered = range(1, blocks)
        inverse = 1.0 + 2.0 / middle * sum((1.0 - k / span) * comb(2 * order, order - k) ** 2 for k in covered)
    return estimate.terms / inverse


def _summed(alpha: int, estimate: Estimate) -> float:
    """Equations 10 and 11: all lags at which the differences are correlated, one by one."""
    terms, factor = estimate.terms, float(estimate.factor)
    last = min(terms, (estimate.order + 1) * estimate.factor)
    inner = 1.0 if estimate.modified else factor
    # A large factor would lose all digits in a second difference over 1/factor; the limit is its derivative.
    if not estimate.modified and alpha <= 0 and factor * (estimate.order + 1) > _LONGEST_SUM:
        inner = inf
    return _edf(last, terms, factor, inner, alpha, estimate.order)


def _coarse(alpha: int, estimate: Estimate, span: float, scale: float) -> float:
    """Few long averages: the same sum on a coarser grid of lags."""
    stride = _LONGEST_SUM / span
    if estimate.modified:
        return _edf(_LONGEST_SUM, _LONGEST_SUM, stride, 1.0, alpha, estimate.order)
    if alpha <= 0:
        return _edf(_LONGEST_SUM, _LONGEST_SUM, stride, inf, alpha, estimate.order)
    squares = _sum_of_squares(_LONGEST_SUM, _LONGEST_SUM, stride, stride, alpha, estimate.order)
    return scale * _LONGEST_SUM / squares


def _edf(last: int, terms: int, stride: float, inner: float, alpha: int, order: int) -> float:
    variance = float(_differenced(np.zeros(1), inner, alpha, order)[0])
    return variance**2 * terms / _sum_of_squares(last, terms, stride, inner, alpha, order)


def _sum_of_squares(last: int, terms: int, stride: float, inner: float, alpha: int, order: int) -> float:
    """Equation 10, BasicSum."""
    lag = np.arange(last + 1)
    weight = 2.0 * (1.0 - lag / terms)
    weight[0], weight[-1] = 1.0, 1.0 - last / terms
    return float(weight @ _differenced(lag / stride, inner, alpha, order) ** 2)


def _differenced(lag: FloatArray, inner: float, alpha: int, order: int) -> FloatArray:
    """Equation 9: the covariance of the differences, up to a factor."""
    steps = range(-order, order + 1)
    parts = [(-1.0) ** k * comb(2 * order, order + k) * _averaged(lag + k, inner, alpha) for k in steps]
    return np.asarray(np.sum(parts, axis=0))


def _averaged(lag: FloatArray, inner: float, alpha: int) -> FloatArray:
    """Equation 8: of the filtered integral."""
    if inner == inf:
        return _generalised(lag, alpha + 2)
    step = 1.0 / inner
    second = 2.0 * _generalised(lag, alpha) - _generalised(lag - step, alpha) - _generalised(lag + step, alpha)
    return inner**2 * second


def _generalised(lag: FloatArray, alpha: int) -> FloatArray:
    """Equation 7, the generalised autocovariance of the integral; its sign cancels."""
    size, power = np.abs(lag), 3 - alpha
    if alpha % 2:
        return size**power * np.log(np.where(size > 0.0, size, 1.0))
    return np.asarray(size**power)
