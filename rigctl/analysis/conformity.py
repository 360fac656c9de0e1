"""Is a requirement met? Decisions with uncertainty, and how often they are wrong (JCGM 106:2012).

What is known of the quantity is the state-of-knowledge distribution of its measurement: Student's t with the budget's
effective degrees of freedom, scaled by the combined standard uncertainty (JCGM 101, 6.4.9), or, for the spread of so
many values, that of unbiased * value * sqrt(dof / chi-square). Nothing is assumed of the quantity beforehand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from rigctl.analysis.measurement_result import Kind, Limits

Rule = Literal["guard band", "simple acceptance"]
Verdict = Literal["pass", "fail", "undecided"]


@dataclass(frozen=True)
class Knowledge:
    """What a measurement says of a quantity; `unbiased` as that of `Quantity`."""

    value: float
    standard_uncertainty: float
    dof: float
    kind: Kind = "mean"
    unbiased: float = 1.0

    def below(self, limit: float) -> float:
        """Probability that the quantity is no larger than `limit`."""
        from scipy.special import chdtrc, ndtr, stdtr

        if self.kind == "spread":
            # The quantity is this times sqrt(dof / chi2): no larger than the limit where chi2 is at least so much.
            estimate = self.unbiased * self.value
            return float(chdtrc(self.dof, self.dof * (estimate / limit) ** 2)) if limit > 0.0 else 0.0
        if self.standard_uncertainty == 0.0:
            return float(self.value <= limit)
        t = (limit - self.value) / self.standard_uncertainty
        return float(ndtr(t) if math.isinf(self.dof) else stdtr(self.dof, t))

    def inside(self, limits: Limits) -> float:
        """Probability that the quantity is within its limits: the conformance probability (JCGM 106, 7)."""
        above_lower = 1.0 if limits.lower is None else 1.0 - self.below(limits.lower)
        below_upper = 1.0 if limits.upper is None else self.below(limits.upper)
        return max(above_lower + below_upper - 1.0, 0.0)


@dataclass(frozen=True)
class Conformity:
    """The decision on one quantity.

    `probability` of conformance; `false_accept` is the probability that it does not conform where it passed,
    `false_reject` that it does where it failed; each None where the decision was another. `acceptance` are the limits
    between which a measured value passes (JCGM 106, 8.3): the requirement's less the guard band.
    """

    limits: Limits
    rule: Rule
    largest_risk: float
    verdict: Verdict
    probability: float
    acceptance: Limits

    @property
    def false_accept(self) -> float | None:
        """Probability that what passed does not conform."""
        return 1.0 - self.probability if self.verdict == "pass" else None

    @property
    def false_reject(self) -> float | None:
        """Probability that what failed does conform."""
        return self.probability if self.verdict == "fail" else None


def decide(known: Knowledge, limits: Limits, rule: Rule, largest_risk: float) -> Conformity:
    """Decide whether a requirement is met.

    With a guard band a quantity passes where it does not conform with a probability of `largest_risk` at most, fails
    where it conforms with no more than that, and is undecided between (a three-way rule; JCGM 106, 8.3.2 and 8.3.3).
    With simple acceptance a measured value within the limits passes, whatever its uncertainty (8.2).
    """
    probability = known.inside(limits)
    if rule == "simple acceptance":
        within = (limits.lower is None or known.value >= limits.lower) and (
            limits.upper is None or known.value <= limits.upper
        )
        return Conformity(limits, rule, largest_risk, "pass" if within else "fail", probability, limits)
    verdict: Verdict = "undecided"
    if 1.0 - probability <= largest_risk:
        verdict = "pass"
    elif probability <= largest_risk:
        verdict = "fail"
    return Conformity(limits, rule, largest_risk, verdict, probability, _guarded(known, limits, largest_risk))


def _guarded(known: Knowledge, limits: Limits, risk: float) -> Limits:
    """Acceptance limits, each for the risk at its own limit alone; the verdict counts both."""
    from scipy.special import chdtri, ndtri, stdtrit

    if known.kind == "spread":
        # chdtrc(dof, dof (unbiased v / limit)^2) = 1 - risk, solved for v.
        lower, upper = (
            None if limit is None else limit * math.sqrt(chdtri(known.dof, p) / known.dof) / known.unbiased
            for limit, p in ((limits.lower, risk), (limits.upper, 1.0 - risk))
        )
        return Limits(lower, upper, limits.source)
    t = float(ndtri(1.0 - risk) if math.isinf(known.dof) else stdtrit(known.dof, 1.0 - risk))
    band = t * known.standard_uncertainty
    return Limits(
        None if limits.lower is None else limits.lower + band,
        None if limits.upper is None else limits.upper - band,
        limits.source,
    )
