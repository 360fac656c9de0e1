"""Power of a test from its noncentrality lambda, and the lambda that a wanted power takes."""

from __future__ import annotations

import numpy as np
from scipy import optimize, stats

SEPARATING_LAMBDA = 25.0
"""Lambda that separates: one question at half the default level, any one or two parameters, power 0.95."""

# Half the default alpha: it is one question, asked of two named effects.
LEVEL = 0.005
POWER = 0.95


def power(noncentrality: float, dimension: int, level: float = LEVEL) -> float:
    """Probability that noncentral chi-square exceeds its threshold at a level, by default that of one question."""
    threshold = stats.chi2.isf(level, max(dimension, 1))
    return float(stats.ncx2.sf(threshold, max(dimension, 1), max(noncentrality, 1e-12)))


def needed_noncentrality(level: float, dof: float = np.inf) -> float:
    """Noncentrality at which one parameter is significant at `level` with power 0.95; `dof` is that of the noise."""
    if not np.isfinite(dof):
        return float((stats.norm.isf(level / 2.0) + stats.norm.ppf(POWER)) ** 2)
    threshold = stats.f.isf(level, 1, dof)

    def lacking(size: float) -> float:
        return float(stats.ncf.sf(threshold, 1, dof, size)) - POWER

    # At twenty times the threshold the power is 1 at any degrees of freedom: an upper end for the search.
    return float(optimize.brentq(lacking, 1e-3, 20.0 * threshold))
