"""Uncertainty budgets after the GUM (JCGM 100:2008), checked by Monte Carlo (JCGM 101:2008).

The measurement is a function from named quantities to a vector of outputs. The budget propagates standard
uncertainties to first order; `monte_carlo` propagates the distributions themselves; `compare` says whether
the first order was good enough.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError

Measurement = Callable[[Mapping[str, Any]], FloatArray]

COVERAGE = 0.95
"""Probability of expanded uncertainties."""
# Of a comparison: more outputs have more ends that chance moves.
_FALSE_ALARM = 0.01
# Small beside the range over which the first order is trusted, large beside rounding.
_STEP_IN_U = 0.1


@dataclass(frozen=True)
class Contribution:
    """One input quantity: its value, standard uncertainty and what is known of its distribution.

    `standard_uncertainty` is the distribution's standard deviation (rectangular: half width / sqrt(3));
    for "t" it is the experimental one with `dof` degrees of freedom, as the GUM takes it. Type "A" comes
    from statistics, "B" from a certificate or judgement; `source` says which.
    """

    name: str
    value: float
    standard_uncertainty: float
    unit: str
    type: Literal["A", "B"] = "B"
    distribution: Literal["normal", "rectangular", "t"] = "normal"
    dof: float = np.inf
    source: str = ""

    @classmethod
    def from_limits(cls, name: str, value: float, half_width: float, unit: str, *, source: str) -> Contribution:
        """Make a type B contribution that lies anywhere within `value` +- `half_width`."""
        return cls(name, value, half_width / np.sqrt(3.0), unit, "B", "rectangular", source=source)

    def draw(self, rng: np.random.Generator, draws: int) -> FloatArray:
        """Draw from the state-of-knowledge distribution (JCGM 101, table 1), shape (draws,)."""
        if self.distribution == "rectangular":
            unit = rng.uniform(-np.sqrt(3.0), np.sqrt(3.0), draws)
        elif self.distribution == "t":
            # Scaled by u, not brought to the standard deviation u, which it then exceeds (JCGM 101, 6.4.9).
            unit = rng.standard_t(self.dof, draws)
        else:
            unit = rng.standard_normal(draws)
        return np.asarray(self.value + self.standard_uncertainty * unit)


def coverage_factors(dof: FloatArray) -> FloatArray:
    """Student's t for 95 % at degrees of freedom truncated to an integer (GUM G.4.1), of the shape of `dof`."""
    from scipy.special import stdtrit

    # The factor keeps rounding from truncating a whole number to the next lower one.
    whole = np.maximum(np.floor(np.minimum(dof, 1e9) * (1.0 + 1e-12)), 1.0)
    return np.asarray(stdtrit(whole, 0.5 * (1.0 + COVERAGE)))


@dataclass(frozen=True)
class Budget:
    """The budget of a vector of m outputs over n contributions.

    `sensitivities` (m, n) are d output / d input, `components` (m, n) their products with the standard
    uncertainties (signed), `share` (m, n) each one's part of the variance. `standard_uncertainty` (m,) is the
    combined one, `effective_dof` (m,) after Welch-Satterthwaite, `coverage_factor` and `expanded` (m,) for 95 %.
    """

    outputs: tuple[str, ...]
    contributions: tuple[Contribution, ...]
    values: FloatArray
    sensitivities: FloatArray

    @property
    def components(self) -> FloatArray:
        """Signed uncertainty contributions c_i u_i, shape (m, n)."""
        u = np.array([each.standard_uncertainty for each in self.contributions])
        return np.asarray(self.sensitivities * u)

    @property
    def standard_uncertainty(self) -> FloatArray:
        """Combined standard uncertainty of each output, shape (m,)."""
        return np.asarray(np.sqrt(np.sum(self.components**2, axis=1)))

    @property
    def share(self) -> FloatArray:
        """Part of each output's variance due to each contribution, shape (m, n); 0 where nothing contributes."""
        total = np.sum(self.components**2, axis=1, keepdims=True)
        return np.asarray(self.components**2 / np.where(total > 0.0, total, 1.0))

    @property
    def effective_dof(self) -> FloatArray:
        """Welch-Satterthwaite degrees of freedom of each output (GUM eq. G.2b), shape (m,)."""
        inverse = np.sum(self.share**2 / np.array([each.dof for each in self.contributions]), axis=1)
        # Type B alone: no term has finite degrees of freedom, and infinity is the right answer.
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / inverse)

    @property
    def coverage_factor(self) -> FloatArray:
        """Student's t for 95 % at the effective degrees of freedom truncated to an integer (GUM G.4.1)."""
        return coverage_factors(self.effective_dof)

    @property
    def expanded(self) -> FloatArray:
        """Expanded uncertainty for 95 %, shape (m,)."""
        return self.coverage_factor * self.standard_uncertainty


@dataclass(frozen=True)
class MonteCarlo:
    """What propagating the distributions gave: `samples` of shape (draws, m)."""

    samples: FloatArray

    @property
    def interval(self) -> FloatArray:
        """Probabilistically symmetric 95 % coverage interval of each output, shape (m, 2)."""
        tail = 0.5 * (1.0 - COVERAGE)
        return np.asarray(np.quantile(self.samples, [tail, 1.0 - tail], axis=0).T)


@dataclass(frozen=True)
class Comparison:
    """Whether the first-order budget is validated by Monte Carlo (JCGM 101, clause 8), per output.

    `reason` names the outputs that fail.
    """

    validated: tuple[bool, ...]
    reason: str


def budget(measurement: Measurement, contributions: Sequence[Contribution], outputs: Sequence[str]) -> Budget:
    """Make the budget of `measurement(values)`, shape (len(outputs),), by central differences of u / 10.

    Contributions are independent. Raises `ProcedureError` for bad contributions or outputs that are not
    finite, named.
    """
    _check(contributions)
    nominal = {each.name: each.value for each in contributions}
    values = _evaluate(measurement, nominal, outputs)
    sensitivities = np.zeros((len(outputs), len(contributions)))
    for i, each in enumerate(contributions):
        # A contribution without uncertainty still has a sensitivity, which a reader of the budget may ask for.
        step = _STEP_IN_U * each.standard_uncertainty or 1e-6 * max(abs(each.value), 1.0)
        up = _evaluate(measurement, {**nominal, each.name: each.value + step}, outputs)
        down = _evaluate(measurement, {**nominal, each.name: each.value - step}, outputs)
        sensitivities[:, i] = (up - down) / (2.0 * step)
    return Budget(tuple(outputs), tuple(contributions), values, sensitivities)


def monte_carlo(
    measurement: Measurement,
    contributions: Sequence[Contribution],
    outputs: Sequence[str],
    *,
    draws: int,
    seed: int,
    together: bool = False,
) -> MonteCarlo:
    """Propagate the distributions of independent contributions through `measurement`.

    With `together` it is asked once: values are arrays (draws,), and it gives shape (draws, len(outputs)).
    """
    _check(contributions)
    # A stream each: a contribution appended to the list leaves the others' draws as they were.
    streams = np.random.default_rng(seed).spawn(len(contributions))
    columns = {each.name: each.draw(rng, draws) for each, rng in zip(contributions, streams, strict=True)}
    if together:
        return MonteCarlo(
            _checked(np.asarray(measurement(columns)), (draws, len(outputs)), outputs, "one of the draws")
        )
    samples = [
        _evaluate(measurement, {name: float(column[k]) for name, column in columns.items()}, outputs)
        for k in range(draws)
    ]
    return MonteCarlo(np.array(samples).reshape(draws, len(outputs)))


def compare(first_order: Budget, check: MonteCarlo, *, significant_digits: int = 2) -> Comparison:
    """Compare the budget's 95 % intervals with those of Monte Carlo at the given significant digits.

    The tolerance is half the last significant digit of the standard uncertainty (JCGM 101, 7.9.2) plus what chance
    makes of all intervals' ends in one comparison of a hundred.
    """
    from scipy.special import ndtri

    u = first_order.standard_uncertainty
    nominal = first_order.values[:, None] + first_order.expanded[:, None] * np.array([-1.0, 1.0])
    difference = np.abs(nominal - check.interval)
    last_digit = 10.0 ** (np.floor(np.log10(np.where(u > 0.0, u, 1.0))) - significant_digits + 1)
    by_chance = float(ndtri(1.0 - 0.5 * _FALSE_ALARM / check.interval.size))
    tolerance = 0.5 * last_digit + by_chance * _end_uncertainty(check)
    validated = (difference <= tolerance[:, None]).all(axis=1)
    failing = [name for name, good in zip(first_order.outputs, validated, strict=True) if not good]
    reason = (
        f"the first order is not good enough for {', '.join(failing)}: take the Monte Carlo interval"
        if failing
        else "the first order agrees with Monte Carlo"
    )
    return Comparison(tuple(bool(good) for good in validated), reason)


def _end_uncertainty(check: MonteCarlo) -> FloatArray:
    """Standard deviation of an interval's end from order statistics: half the spread of ranks +- 1 sigma."""
    draws = check.samples.shape[0]
    tail = 0.5 * (1.0 - COVERAGE)
    rank = np.sqrt(tail * (1.0 - tail) / draws)
    ends = np.array([tail - rank, tail + rank, 1.0 - tail - rank, 1.0 - tail + rank])
    q = np.quantile(check.samples, np.clip(ends, 0.0, 1.0), axis=0)
    return np.asarray(np.maximum(q[1] - q[0], q[3] - q[2]) / 2.0)


def _evaluate(measurement: Measurement, values: Mapping[str, float], outputs: Sequence[str]) -> FloatArray:
    result = np.atleast_1d(np.asarray(measurement(values), dtype=np.float64))
    return _checked(result, (len(outputs),), outputs, values)


def _checked(result: FloatArray, shape: tuple[int, ...], outputs: Sequence[str], where: object) -> FloatArray:
    if result.shape != shape:
        raise ProcedureError(f"the measurement gave shape {result.shape} for {len(outputs)} outputs")
    bad = np.argwhere(~np.isfinite(result))
    if bad.size:
        raise ProcedureError(f"the measurement gave no finite {outputs[int(bad[0, -1])]} at {where}")
    return result


def _check(contributions: Sequence[Contribution]) -> None:
    names = [each.name for each in contributions]
    if not names or len(set(names)) < len(names):
        raise ProcedureError("a budget needs contributions, each of its own name")
    for each in contributions:
        if not (np.isfinite(each.value) and 0.0 <= each.standard_uncertainty < np.inf and each.dof > 0.0):
            raise ProcedureError(f"contribution {each.name}: value, uncertainty or dof makes no sense")
        if each.distribution == "t" and not np.isfinite(each.dof):
            raise ProcedureError(f"contribution {each.name}: a t distribution needs its degrees of freedom")
