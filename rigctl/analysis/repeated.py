"""Values of one quantity from calibrations of one item: do they agree, do they drift, does the newest fit the others?

Each has an independent uncertainty, estimated with so many degrees of freedom, and a part from inputs which several
calibrations have in common (the same reference, the same certificate). What is common to all shifts all alike and is
in no difference: it is part of the covariance, never of the scatter.

Means and lines are fitted by generalised least squares. Consistency is tested by chi-square (Cox 2002, Metrologia 39,
589, procedure A; the Birge ratio is the square root of it over its degrees of freedom), in the form of Johansen
(1980, Biometrika 67, 85), which allows for uncertainties that are estimates themselves: of a mean it is Welch's test
(1951, Biometrika 38, 330), of two values Welch-Satterthwaite's t. Uncertainties of what is fitted allow for weights
that are estimates (Kackar and Harville 1984, J. Am. Stat. Assoc. 79, 853).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import chdtrc, chdtri, fdtr, fdtrc, stdtr, stdtrit

from rigctl.core.arrays import FloatArray

LEVEL = 0.01
"""Of all tests of one kind: what is rarer among consistent calibrations is told."""

DRIFT_OF = 3
"""A line through fewer former values is no prediction."""

DRIFT_LEVEL = LEVEL / 10.0
"""A line through the former values replaces their mean only where it is this certain: one that chance has tilted
misses the newest more often than `LEVEL` says."""

SHORTEST_A = 1.0 / 365.25
"""A drift takes a day."""

COVERAGE = 0.95

Model = Literal["mean", "drift", "spread"]


@dataclass(frozen=True)
class Repeated:
    """n values of one quantity, oldest first, in its unit; all arrays (n,) but `common`.

    `time_a` are years from any instant; `independent` standard uncertainties with `dof` degrees of freedom; `common`
    (n, inputs) is what a standard deviation of each common input adds to each value, zero where it does not act.
    """

    time_a: FloatArray
    value: FloatArray
    independent: FloatArray
    dof: FloatArray
    common: FloatArray

    @property
    def former(self) -> Repeated:
        """Without the newest."""
        return Repeated(self.time_a[:-1], self.value[:-1], self.independent[:-1], self.dof[:-1], self.common[:-1])

    @property
    def dated(self) -> bool:
        """Whether they are so far apart in time that a drift can be told from what changes by the hour."""
        return bool(np.ptp(self.time_a) >= SHORTEST_A)

    def line(self) -> FloatArray:
        """Columns of a constant and of a slope per year about the mean time, (n, 2)."""
        return np.stack([np.ones_like(self.time_a), self.time_a - self.time_a.mean()], axis=1)


@dataclass(frozen=True)
class Estimate:
    """A number with its standard uncertainty and the degrees of freedom of that."""

    value: float
    standard_uncertainty: float
    dof: float

    @property
    def p_value(self) -> float:
        """Two-sided, of its being zero: Student's t."""
        return float(2.0 * stdtr(_finite(self.dof), -abs(self.value) / self.standard_uncertainty))

    @property
    def expanded(self) -> float:
        """Half the 95 % interval."""
        return float(stdtrit(_finite(self.dof), 0.5 * (1.0 + COVERAGE))) * self.standard_uncertainty

    def widened(self, scatter: Scatter) -> Estimate:
        """With the uncertainty that the values' scatter asks for, where they do not agree within theirs."""
        if scatter.p_value >= LEVEL:
            return self
        return replace(
            self, standard_uncertainty=self.standard_uncertainty * scatter.birge_ratio, dof=float(scatter.dof)
        )


@dataclass(frozen=True)
class Scatter:
    """How values scatter about what was fitted: `chi2` of `dof`; `p_value` allows for estimated uncertainties."""

    chi2: float
    dof: int
    p_value: float

    @property
    def birge_ratio(self) -> float:
        """sqrt(chi2 / dof): the factor by which stated uncertainties are too small; 1 without degrees of freedom."""
        return float(np.sqrt(self.chi2 / self.dof)) if self.dof else 1.0


@dataclass(frozen=True)
class Consistency:
    """The newest value against what the former ones predict by `model`.

    `difference` is the newest less the prediction, with the uncertainty of that difference. `former` is how the
    former values scatter; where that is beyond their uncertainties, the difference's is widened by the Birge ratio.
    """

    model: Model
    predicted: float
    difference: Estimate
    former: Scatter
    p_value: float

    @property
    def normalised_difference(self) -> float:
        """Difference over its standard uncertainty, with its sign."""
        return self.difference.value / self.difference.standard_uncertainty

    @property
    def e_n(self) -> float:
        """Difference over its expanded uncertainty for 95 %: beyond 1 is unsatisfactory (ISO 13528:2022, 9.7)."""
        return self.difference.value / self.difference.expanded


@dataclass(frozen=True)
class Drift:
    """A line through all values: its `slope` per year and how they scatter about it."""

    slope: Estimate
    scatter: Scatter


def consistency(values: Repeated) -> Consistency:
    """Of two values or more: the newest against the mean of the former, or their line where they drift."""
    model: Model = "drift" if _drifts(values.former) else "mean"
    columns = values.line() if model == "drift" else np.ones((len(values.value), 1))
    # A shift of the newest alone, beside what all share: with it the newest says nothing about the others.
    newest = np.zeros(len(values.value))
    newest[-1] = 1.0
    estimates, scatter = _fitted(values, np.column_stack([columns, newest]))
    difference = estimates[-1].widened(scatter)
    predicted = float(values.value[-1] - difference.value)
    return Consistency(model, predicted, difference, scatter, difference.p_value)


def drift(values: Repeated) -> Drift | None:
    """The line through all values; None where all are of one day."""
    if not values.dated:
        return None
    estimates, scatter = _fitted(values, values.line())
    return Drift(estimates[1].widened(scatter), scatter)


def _drifts(former: Repeated) -> bool:
    if len(former.value) < DRIFT_OF:
        return False
    found = drift(former)
    return found is not None and found.slope.p_value < DRIFT_LEVEL


def _fitted(values: Repeated, design: FloatArray) -> tuple[list[Estimate], Scatter]:
    """Generalised least squares of `design` (n, p): every coefficient, and the scatter about the fit."""
    n, p = design.shape
    # In units of the independent uncertainties: a reference may be a thousand times less well known than they are.
    y, x = values.value / values.independent, design / values.independent[:, None]
    shared = values.common / values.independent[:, None]
    weight = np.linalg.inv(np.eye(n) + shared @ shared.T)
    size = np.sqrt(np.einsum("ij,ik,kj->j", x, weight, x))
    x = x / size
    covariance = np.linalg.inv(x.T @ weight @ x)
    gain = covariance @ x.T @ weight
    coefficients = gain @ y
    # What of a change of each value is left as residual, and counts in chi-square.
    left = weight - weight @ x @ gain
    over = 1.0 / values.dof
    moved = (x.T @ weight) * np.sqrt(4.0 * over * np.clip(np.diag(left), 0.0, None))
    corrected = covariance + covariance @ moved @ moved.T @ covariance
    estimates = [
        Estimate(float(c / s), float(np.sqrt(u2) / s), _satterthwaite(row**2 / plain, over))
        for c, s, u2, row, plain in zip(
            coefficients, size, np.diag(corrected), gain, np.diag(covariance), strict=True
        )
    ]
    return estimates, _scatter(float(y @ left @ y), n - p, float(np.diag(left) ** 2 @ over))


def _satterthwaite(shares: FloatArray, over: FloatArray) -> float:
    """Degrees of freedom of a variance from the `shares` of estimated ones; `over` are one over theirs."""
    total = float(shares**2 @ over)
    return 1.0 / total if total > 0.0 else np.inf


def _scatter(chi2: float, dof: int, a: float) -> Scatter:
    """Johansen's approximation: chi2 over a factor is F, `a` being his A."""
    chi2 = max(chi2, 0.0)
    if dof == 0:
        return Scatter(0.0, 0, 1.0)
    if a == 0.0:
        return Scatter(chi2, dof, float(chdtrc(dof, chi2)))
    factor = dof + 2.0 * a - 6.0 * a / (dof + 2.0)
    return Scatter(chi2, dof, float(fdtrc(dof, dof * (dof + 2.0) / (3.0 * a), chi2 / factor)))


def spread_consistency(value: FloatArray, dof: FloatArray) -> Consistency:
    """As `consistency`, of standard deviations of normal values, oldest first, (n,): the newest by the F test against
    the former ones pooled, those among each other by Bartlett's test."""
    former, dof_former = value[:-1], dof[:-1]
    pooled_dof = float(dof_former.sum())
    pooled = float(np.sqrt(dof_former @ former**2 / pooled_dof))
    ratio = float(value[-1] / pooled) ** 2
    below = float(fdtr(dof[-1], pooled_dof, ratio))
    p_value = 2.0 * min(below, float(fdtrc(dof[-1], pooled_dof, ratio)))
    u = pooled * float(np.sqrt(0.5 / dof[-1] + 0.5 / pooled_dof))
    difference = Estimate(float(value[-1]) - pooled, u, np.inf)
    return Consistency("spread", pooled, difference, _bartlett(former, dof_former, pooled), min(p_value, 1.0))


def _bartlett(value: FloatArray, dof: FloatArray, pooled: float) -> Scatter:
    """Bartlett (1937): chi-square of standard deviations against their pooled one."""
    k, total = len(value), float(dof.sum())
    if k < 2:
        return Scatter(0.0, 0, 1.0)
    factor = 1.0 + (float((1.0 / dof).sum()) - 1.0 / total) / (3.0 * (k - 1))
    chi2 = max(-2.0 * float(dof @ np.log(value / pooled)) / factor, 0.0)
    return Scatter(chi2, k - 1, float(chdtrc(k - 1, chi2)))


def sigmas(p_value: float) -> float:
    """How many standard deviations of a normal distribution a two-sided p-value is."""
    # chdtri is of the upper tail of chi-square, here of one degree of freedom.
    return float(np.sqrt(chdtri(1, max(p_value, 1e-300))))


def unwrapped(angles: Sequence[float] | FloatArray, uncertainties: FloatArray, turn: float) -> FloatArray:
    """Angles each moved by whole turns to where they are nearest to their weighted mean direction, (n,)."""
    given = np.asarray(angles, dtype=float)
    phasors = np.exp(2j * np.pi * given / turn) / uncertainties**2
    mean = float(np.angle(phasors.sum())) * turn / (2.0 * np.pi)
    return given - turn * np.round((given - mean) / turn)


def _finite(dof: float) -> float:
    # Student's t of infinitely many is not a number in scipy; of so many it is the normal distribution.
    return min(dof, 1e12)
