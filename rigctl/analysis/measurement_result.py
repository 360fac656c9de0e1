"""A measurement result: quantities with everything their uncertainty is made of (JCGM 100:2008; VIM 2.9).

Every source of uncertainty has its own covariance over all quantities: what is common to two of them correlates them,
and a source may be a scalar input of a budget as well as the noise of a fit, which has many directions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rigctl.analysis.budget import COVERAGE, Budget, Contribution, coverage_factors
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError

Kind = Literal["mean", "spread"]
"""What is known of a quantity: Student's t about a value, or the spread of so many values (chi-square)."""


@dataclass(frozen=True)
class Limits:
    """Between which a quantity has to lie, in its unit; None for no limit there. `source` says who wants it."""

    lower: float | None = None
    upper: float | None = None
    source: str = ""


@dataclass(frozen=True)
class Quantity:
    """One quantity of a result: a name, `value` in `unit` ("" and "1" for none), and `limits` where there are some.

    Quantities of one `group` belong together, such as the components of a direction. A magnitude and the phase that
    follows it name the `complex` quantity that they are. A spread whose squares were divided by more than its degrees
    of freedom is too small by the factor `unbiased`: the square of `unbiased` times `value` is that of no bias.
    """

    name: str
    value: float
    unit: str
    kind: Kind = "mean"
    group: str = ""
    limits: Limits | None = None
    complex: str = ""
    unbiased: float = 1.0


@dataclass(frozen=True)
class Source:
    """One source of uncertainty: its `covariance` (m, m) of the quantities, and the degrees of freedom behind it.

    `input` is the input quantity's own standard uncertainty with its unit, in words; `origin` says where it is from.
    `common` is whether another calibration with the same equipment would have the same error; by default what is of
    type B would.
    """

    name: str
    type: Literal["A", "B"]
    covariance: FloatArray
    dof: float = np.inf
    input: str = ""
    origin: str = ""
    common: bool | None = None

    @property
    def in_common(self) -> bool:
        """Whether another calibration with the same equipment would have the same error."""
        return self.type == "B" if self.common is None else self.common

    @property
    def standard_uncertainty(self) -> FloatArray:
        """Its part of the standard uncertainty of each quantity, shape (m,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


@dataclass(frozen=True)
class MeasurementResult:
    """m quantities with the independent sources of their uncertainty.

    `method` says how it was measured, `remarks` what a reader has to know beside the numbers. `of_model` is whether
    the quantities come from the fit of the model, so that a model which fails makes them doubtful.
    """

    quantities: tuple[Quantity, ...]
    sources: tuple[Source, ...]
    method: str
    remarks: tuple[str, ...] = ()
    of_model: bool = True

    @property
    def values(self) -> FloatArray:
        """Shape (m,), each in its quantity's unit."""
        return np.array([each.value for each in self.quantities])

    @property
    def covariance(self) -> FloatArray:
        """Of all quantities, shape (m, m)."""
        m = len(self.quantities)
        return np.asarray(sum((each.covariance for each in self.sources), np.zeros((m, m))))

    @property
    def standard_uncertainty(self) -> FloatArray:
        """Combined standard uncertainty of each quantity, shape (m,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def effective_dof(self) -> FloatArray:
        """Welch-Satterthwaite degrees of freedom of each quantity (GUM eq. G.2b), shape (m,)."""
        total = np.diag(self.covariance)
        inverse = np.zeros(len(total))
        for each in self.sources:
            share = np.diag(each.covariance) / np.where(total > 0.0, total, 1.0)
            inverse += share**2 / each.dof
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / inverse)

    @property
    def coverage_factor(self) -> FloatArray:
        """Student's t for 95 % at the effective degrees of freedom, truncated to an integer (GUM G.4.1), (m,)."""
        return coverage_factors(self.effective_dof)

    @property
    def coverage_interval(self) -> FloatArray:
        """Ends of the probabilistically symmetric 95 % interval of each quantity, shape (m, 2)."""
        half = self.coverage_factor * self.standard_uncertainty
        found = self.values[:, None] + half[:, None] * np.array([-1.0, 1.0])
        for place, each in enumerate(self.quantities):
            if each.kind == "spread":
                found[place] = spread_interval(each.unbiased * each.value, self.effective_dof[place])
        return np.asarray(found)


def spread_interval(value: float, dof: float) -> FloatArray:
    """Ends (2,) of the 95 % interval of a standard deviation, or a multiple of one, known from so many values."""
    from scipy.special import chdtri

    tail = 0.5 * (1.0 - COVERAGE)
    # chdtri is of the upper tail: the larger chi-square belongs to the smaller spread.
    return np.asarray(value * np.sqrt(dof / chdtri(dof, np.array([tail, 1.0 - tail]))))


def spread_source(name: str, place: int, count: int, value: float, dof: float) -> Source:
    """What quantity number `place` of `count` is uncertain by, the spread of values: u / value = 1 / sqrt(2 dof)."""
    covariance = np.zeros((count, count))
    covariance[place, place] = value**2 / (2.0 * dof)
    return Source(name, "A", covariance, dof, origin="a standard deviation of few values (GUM E.4.3)")


def common_sources(count: int, parts: Iterable[tuple[str, Contribution, slice, FloatArray]]) -> list[Source]:
    """Contributions to parts of `count` quantities: name, contribution, which quantities, and what it adds to them.

    What has one name is one input, whatever it contributes to.
    """
    columns: dict[str, FloatArray] = {}
    known: dict[str, Contribution] = {}
    for name, contribution, where, components in parts:
        columns.setdefault(name, np.zeros(count))[where] += components
        known[name] = contribution
    return [_of_column(name, known[name], column) for name, column in columns.items()]


def sources_of(budget: Budget) -> list[Source]:
    """The contributions of a budget over its outputs."""
    columns = zip(budget.contributions, budget.components.T, strict=True)
    return [_of_column(each.name, each, column) for each, column in columns]


def _of_column(name: str, given: Contribution, column: FloatArray) -> Source:
    said = f"{given.standard_uncertainty:.3g} {given.unit}".rstrip()
    return Source(name, given.type, np.outer(column, column), given.dof, said, given.source)


def checked(result: MeasurementResult) -> MeasurementResult:
    """The same result; `ProcedureError` where a value or an uncertainty is not finite, named."""
    if not result.quantities:
        raise ProcedureError("these runs give no quantity that could be certified; see `rigctl result`")
    for each, u in zip(result.quantities, result.standard_uncertainty, strict=True):
        if not (np.isfinite(each.value) and np.isfinite(u)):
            raise ProcedureError(f"{each.name} is not determined by these runs; measure more or remove its effect")
    return result
