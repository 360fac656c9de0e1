"""What residuals say of their own scatter, as data: among repeats, along conditions, beside what is stated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

LEVEL = "fitted level"
"""What the model predicts, as a condition along which scatter may change."""

LEAST_DOF = 20
"""With fewer degrees of freedom a scatter says too little of itself."""


@dataclass(frozen=True)
class LackOfFit:
    """What a model leaves beyond the scatter of readings at one setting, `pure_error` in `unit`: F with `dof` and
    `pure_dof` degrees of freedom."""

    f: float
    dof: int
    pure_dof: int
    p_value: float
    pure_error: float
    channel: str
    unit: str


@dataclass(frozen=True)
class UnevenScatter:
    """Scatter that changes along a condition: a column of numbers, one of words, or the `LEVEL`.

    `low` and `high` are (value, sigma) at the ends of the condition, `ratio` of the latter with its standard
    uncertainty; of words `by_word` has the sigma of each. `law` is the standard deviation as an expression to weigh
    readings by. `of_stated`: sigmas multiply the uncertainties that are stated. `same_as` are conditions in the
    same order as this one.
    """

    along: str
    same_as: tuple[str, ...]
    p_value: float
    p_value_corrected: float
    unit: str
    of_stated: bool
    low: tuple[float, float] | None = None
    high: tuple[float, float] | None = None
    ratio: tuple[float, float] | None = None
    law: str | None = None
    by_word: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Within `scatter` of `compare` and `diagnose`."""
        ends = {"low": self.low, "high": self.high}
        ratio = None if self.ratio is None else dict(zip(("value", "sigma"), self.ratio, strict=True))
        return {
            **vars(self),
            "same_as": list(self.same_as),
            "by_word": dict(self.by_word),
            "ratio": ratio,
            **{name: None if end is None else {"at": end[0], "sigma": end[1]} for name, end in ends.items()},
        }


@dataclass(frozen=True)
class FarReading:
    """A reading that is off from what all others say by `sigmas` times their `scatter`; the next is by `following`.

    The scatter, in `unit`, is a reading's own, beside what readings share; `p_value` that of the farthest of so many.
    """

    run_id: str
    sigmas: float
    following: float
    p_value: float
    scatter: float
    unit: str


@dataclass(frozen=True)
class StatedSigma:
    """Stated uncertainties beside the scatter: each times `factor`, or `added` to each in quadrature.

    Values with their standard uncertainties, `added` in `unit`; None where nothing can be added, for the scatter is
    smaller than stated. `likelier` by `log_likelihood_ratio`; None where these data do not tell which.
    """

    factor: tuple[float, float]
    added: tuple[float, float] | None
    unit: str
    p_value: float
    likelier: Literal["factor", "added"] | None
    log_likelihood_ratio: float

    def as_json(self) -> dict[str, Any]:
        """`stated_sigma` of `compare` and `diagnose`."""
        added = None if self.added is None else {"value": self.added[0], "sigma": self.added[1], "unit": self.unit}
        return {
            "factor": {"value": self.factor[0], "sigma": self.factor[1]},
            "added": added,
            "p_value": self.p_value,
            "likelier": self.likelier,
            "log_likelihood_ratio": self.log_likelihood_ratio,
        }
