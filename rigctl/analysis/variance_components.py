"""Variance components by restricted maximum likelihood: readings that share unknown offsets.

y = X b + sum_k Z_k u_k + e with independent u_k ~ N(0, r_k sigma^2) and e ~ N(0, sigma^2) (Patterson and Thompson,
Biometrika 58, 1971). With X projected out, the likelihood needs the Gram matrix of the Z alone, whose size is that of
the levels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from rigctl.analysis.triangle_solve import solve_lower
from rigctl.core.arrays import FloatArray, IntArray

Cost = Callable[[FloatArray], float]

# Of variances: below 6e-6 there is no offset to be seen, above 9e6 no scatter within.
_LOG_RATIO = (-12.0, 16.0)
# Restricted likelihood may have more than one maximum.
_STARTS = (0.1, 1.0, 10.0)
_GRID = 113
_SIMPLEX: Any = {"xatol": 1e-4, "fatol": 1e-8, "maxiter": 400}


@dataclass(frozen=True)
class Components:
    """`ratios` r_k of the offsets' variances to that of single readings, `sigma` of the latter.

    `p_values` are those of each component's likelihood ratio, the others in; half of the null's mass is at zero.
    """

    ratios: FloatArray
    sigma: float
    p_values: FloatArray


def variance_components(residuals: FloatArray, design: FloatArray, levels: Sequence[IntArray]) -> Components:
    """Components of residuals (n,) of which an orthonormal `design` (n, p) is free; `levels` (n,) count from 0."""
    indicators = [np.equal.outer(level, np.arange(level.max() + 1)).astype(np.float64) for level in levels]
    sizes = np.array([each.shape[1] for each in indicators])
    joined = np.hstack(indicators)
    left = residuals - design @ (design.T @ residuals)
    inside = design.T @ joined
    gram, along = joined.T @ joined - inside.T @ inside, joined.T @ left
    square, dof = float(left @ left), len(residuals) - design.shape[1]

    # Of one component, and of all alike, the likelihood goes by the eigenvalues: a sum for each ratio.
    values, vectors = np.linalg.eigh(gram)
    turned_once = (vectors.T @ along) ** 2

    def cost(ratios: FloatArray) -> float:
        quadratic, determinant = _quadratic(ratios)
        # Minus twice the restricted log likelihood at the best sigma, but for a constant.
        return float(dof * np.log(quadratic) + determinant)

    def _quadratic(ratios: FloatArray) -> tuple[float, float]:
        if np.ptp(ratios) == 0.0:
            scaled = 1.0 + ratios[0] * np.maximum(values, 0.0)
            quadratic = square - float(np.sum(ratios[0] * turned_once / scaled))
            return max(quadratic, np.finfo(float).tiny), float(np.sum(np.log(scaled)))
        # Woodbury: what is factorised has the size of the levels and not of the readings.
        root = np.sqrt(np.repeat(ratios, sizes))
        factor = np.asarray(np.linalg.cholesky(np.eye(len(root)) + root[:, None] * gram * root), dtype=np.float64)
        turned = solve_lower(factor, np.asarray(root * along, dtype=np.float64))
        quadratic = max(square - float(turned @ turned), np.finfo(float).tiny)
        return quadratic, 2.0 * float(np.sum(np.log(np.diag(factor))))

    found = _least(cost, len(levels))
    falls = [
        cost(np.insert(_least(_without(cost, place), len(levels) - 1), place, 0.0)) - cost(found)
        for place in range(len(levels))
    ]
    p_values = np.array([0.5 * special.chdtrc(1, fall) if fall > 0.0 else 1.0 for fall in falls])
    return Components(found, float(np.sqrt(_quadratic(found)[0] / dof)), p_values)


def _without(cost: Cost, place: int) -> Cost:
    return lambda ratios: cost(np.insert(ratios, place, 0.0))


def _least(cost: Cost, count: int) -> FloatArray:
    """Ratios of least cost, zero among what is tried."""
    none = np.zeros(count)
    if not count:
        return none
    from scipy import optimize

    def of_logs(logs: FloatArray) -> float:
        return cost(np.exp(np.clip(logs, *_LOG_RATIO)))

    tried = [none]
    if count == 1:
        # One ratio costs next to nothing: all of its range, then between the neighbours of the best.
        grid = np.linspace(*_LOG_RATIO, _GRID)
        place = int(np.argmin([of_logs(np.array([each])) for each in grid]))
        within = grid[max(place - 1, 0)], grid[min(place + 1, _GRID - 1)]
        found = optimize.minimize_scalar(
            lambda log: of_logs(np.array([log])), bounds=within, method="bounded", options={"xatol": 1e-9}
        )
        tried.append(np.exp(np.array([found.x])))
    for start in _STARTS if count > 1 else ():
        at = np.full(count, np.log(start), dtype=np.float64)
        minimum = optimize.minimize(of_logs, at, method="Nelder-Mead", options=_SIMPLEX)
        tried.append(np.exp(np.clip(minimum.x, *_LOG_RATIO)))
    best = min(tried, key=cost)
    # The search is in logarithms, which reach zero nowhere.
    return np.where(best > 1e-5, best, 0.0)
