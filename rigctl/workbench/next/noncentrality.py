"""Power of a test from its noncentrality lambda, and the lambda that a wanted power takes."""

from __future__ import annotations

import numpy as np

# Not scipy.stats, whose import takes longer than what is worked out here.
from scipy import optimize, special

SEPARATING_LAMBDA = 25.0
"""Lambda that separates: one question at half the default level, any one or two parameters, power 0.95."""

# Half the default alpha: it is one question, asked of two named effects.
LEVEL = 0.005
POWER = 0.95


def power(noncentrality: float, dimension: int, level: float = LEVEL) -> float:
    """Probability that noncentral chi-square exceeds its threshold at a level, by default that of one question."""
    threshold = special.chdtri(max(dimension, 1), level)
    return 1.0 - float(special.chndtr(threshold, max(dimension, 1), max(noncentrality, 1e-12)))


def needed_noncentrality(level: float, dof: float = np.inf) -> float:
    """Noncentrality at which one parameter is significant at `level` with power 0.95; `dof` is that of the noise."""
    if not np.isfinite(dof):
        return float((special.ndtri(POWER) - special.ndtri(level / 2.0)) ** 2)
    threshold = float(special.fdtri(1, dof, 1.0 - level))

    def lacking(size: float) -> float:
        return 1.0 - float(special.ncfdtr(1, dof, size, threshold)) - POWER

    # At twenty times the threshold the power is 1 at any degrees of freedom: an upper end for the search.
    return float(optimize.brentq(lacking, 1e-3, 20.0 * threshold))
