"""What a lambda promises: a noncentral chi-square against the threshold of one question."""

from __future__ import annotations

import numpy as np
from scipy import optimize, stats

PROMISE = 25.0
"""Lambda that separates: one question at half the default level, any one or two parameters, power 0.95."""

LEVEL = 0.005
POWER = 0.95


def power(noncentrality: float, dimension: int) -> float:
    """Probability that an effect of this lambda is seen at the level of one question."""
    threshold = stats.chi2.isf(LEVEL, max(dimension, 1))
    return float(stats.ncx2.sf(threshold, max(dimension, 1), max(noncentrality, 1e-12)))


def needed(level: float, dof: float = np.inf) -> float:
    """Lambda of one parameter that is significant at a level with power 0.95, the noise being known with `dof`."""
    if not np.isfinite(dof):
        return float((stats.norm.isf(level / 2.0) + stats.norm.ppf(POWER)) ** 2)
    threshold = stats.f.isf(level, 1, dof)

    def lacking(size: float) -> float:
        return float(stats.ncf.sf(threshold, 1, dof, size)) - POWER

    return float(optimize.brentq(lacking, 1e-3, 20.0 * threshold))
