"""Are stated uncertainties wrong by a factor, or is something added to each in quadrature (jitter)?"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy import special

from rigctl.core.arrays import FloatArray
from rigctl.workbench.scatter import LEAST_DOF, StatedSigma
from rigctl.workbench.verdict.account import Account
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.uneven_scatter import independent_residuals

SIGNIFICANT = 0.01
TOLD = 3.0
"""Difference of log likelihoods from which one is said to be the likelier, twenty to one: both have one parameter."""

# Of the mean stated variance: what is added is looked for between.
_LEAST, _MOST = 1e-6, 1e6


def stated_sigma_beside_all(attempt: Attempt, account: Account) -> StatedSigma | None:
    """The same beside all that is found: what a version lacks is no fault of what is stated."""
    if account.known is not None or not _is_stated(attempt):
        return stated_sigma(account.richest)
    # Where the noise stays as stated the account has looked for nothing.
    search = account.search(attempt.study, attempt.terms, seed=attempt.seed, fitted=attempt)
    return stated_sigma(search.attempt(search.terms))


def stated_sigma(attempt: Attempt) -> StatedSigma | None:
    """What the scatter says of uncertainties that are stated; None where it does not contradict them.

    Nor where none are stated, where readings are correlated, or where no degree of freedom is left. Where the noise
    stays as stated, chi-square says it, and what the model lacks is among the scatter.
    """
    given, noise = attempt.model.observations, attempt.noise
    kept = not attempt.estimator.from_scatter
    if not _is_stated(attempt) or attempt.result.dof < (1 if kept else LEAST_DOF):
        return None
    # In units of what is stated; as if no reading had drawn the fit to it.
    square = (independent_residuals(attempt) * noise.sigma / given.sigma) ** 2
    count, mean = len(square), float(square.mean())
    # By the scatter of the squares where tails are heavy: normal noise has 2.
    spread = np.sqrt(max(2.0, float(square.var()) / mean**2) / count)
    p_value = _p_of_chi2(attempt) if kept else float(2.0 * special.ndtr(-abs(np.log(mean)) / spread))
    if not p_value < SIGNIFICANT:
        return None
    factor = (float(np.sqrt(mean)), float(0.5 * np.sqrt(mean) * spread))
    unit = given.series[0].unit
    if mean < 1.0:
        return StatedSigma(factor, None, unit, p_value, "factor", np.inf)
    added = _Added(square, given.sigma)
    # Both at their best, one parameter each.
    gained = float(0.5 * (count * np.log(mean) + count - added.cost))
    likelier: Literal["factor", "added"] | None = None
    if abs(gained) > TOLD:
        likelier = "added" if gained > 0.0 else "factor"
    return StatedSigma(factor, (added.size, added.sigma), unit, p_value, likelier, gained)


def _is_stated(attempt: Attempt) -> bool:
    pools = attempt.model.observations.pools
    return len(pools) == 1 and pools[0].stated and not attempt.noise.factors


def _p_of_chi2(attempt: Attempt) -> float:
    """Of a chi-square as far from its degrees of freedom, two-sided."""
    chi2, dof = attempt.result.chi2, attempt.result.dof
    return float(min(1.0, 2.0 * min(special.chdtr(dof, chi2), special.chdtrc(dof, chi2))))


class _Added:
    """What is added in quadrature to `stated` sigmas (n,), where squares in their units (n,) are likeliest."""

    def __init__(self, square: FloatArray, stated: FloatArray) -> None:
        from scipy import optimize

        typical = float(np.sqrt(np.mean(stated**2)))

        def cost(log: float) -> float:
            """-2 log L less that of the stated sigmas' own logarithms."""
            more = 1.0 + (np.exp(log) * typical / stated) ** 2
            return float(np.sum(np.log(more) + square / more))

        bounds = (0.5 * np.log(_LEAST), 0.5 * np.log(_MOST))
        found = optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-6})
        self.cost, self.size = float(found.fun), float(np.exp(found.x) * typical)
        more = 1.0 + (self.size / stated) ** 2
        # Expected information about the logarithm of what is added.
        information = 2.0 * float(np.sum(((more - 1.0) / more) ** 2))
        self.sigma = self.size / float(np.sqrt(max(information, np.finfo(float).tiny)))
