"""Results of the workbench as data, for JSON, tables, figures and reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from rigctl.core.arrays import FloatArray
from rigctl.workbench.hidden import HiddenInNoise
from rigctl.workbench.scatter import FarReading, LackOfFit, StatedSigma, UnevenScatter
from rigctl.workbench.study import Observations, Term

Verdict = Literal["adequate", "effect", "ambiguous", "unknown"]

MOST_TERMS = 8
"""So many effects a diagnosis suggests at most: it has to end, well beyond the three that it is tried on."""


@dataclass(frozen=True)
class Estimate:
    """A parameter's value with its standard uncertainty; `interval` of 68 % where that is no fair picture of it."""

    value: float
    sigma: float
    unit: str
    interval: tuple[float, float] | None = None

    def as_json(self) -> dict[str, Any]:
        """With the keys of every command."""
        further = {} if self.interval is None else {"interval_68": list(self.interval)}
        return {"value": self.value, "sigma": self.sigma, "unit": self.unit, **further}


@dataclass(frozen=True)
class NoiseEntry:
    """The noise of one series: how it was modelled, how large it is, and from what that is known.

    `sigma` is the standard deviation, rms where it differs by row, from `dof` degrees of freedom; `scale` what a
    stated sigma was multiplied by. Correlated noise goes along `order`, as a power law with an `exponent` or a
    relaxation with a `time_constant`, and is `correlated_share` of the variance in the mean of laws that data are
    whitened with, of which `model` is the likeliest. `resolution` is that of the data where it tells the noise, and
    not their scatter.
    """

    channel: str
    component: str
    model: str
    sigma: float
    unit: str
    dof: float
    order: str | None
    source: str
    scale: float
    exponent: float | None = None
    time_constant: float | None = None
    correlated_share: float = 0.0
    batches: Mapping[str, float] = field(default_factory=dict)
    resolution: float | None = None

    def as_json(self) -> dict[str, Any]:
        """Keys of `noise` in every command."""
        return {**vars(self), "batches": dict(self.batches)}


@dataclass(frozen=True)
class ChannelFit:
    """One series: rms of its residuals beside the noise expected, in `unit`; chi-square over its data."""

    channel: str
    component: str
    rms: float
    noise: float
    unit: str
    data: int
    chi2: float

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl compare --json`."""
        return {**vars(self)}


@dataclass(frozen=True)
class Trend:
    """How strongly a series' residuals follow a covariate: an F test, corrected for its trials."""

    channel: str
    component: str
    covariate: str
    p_value: float
    p_value_corrected: float
    rms_explained: float


@dataclass(frozen=True)
class Outlier:
    """A datum far from the model, in sigma."""

    run_id: str
    channel: str
    component: str
    sigma: float


@dataclass(frozen=True)
class Comparison:
    """The current model beside the data; `residuals` whitened one by one, (n,), in the order of `observations`."""

    version: int
    terms: tuple[Term, ...]
    chi2: float
    dof: int
    p_value: float
    channels: tuple[ChannelFit, ...]
    worst: tuple[Outlier, ...]
    trends: tuple[Trend, ...]
    lines: tuple[Mapping[str, Any], ...]
    noise: tuple[NoiseEntry, ...]
    lack_of_fit: LackOfFit | None
    scatter: tuple[UnevenScatter, ...]
    stated_sigma: StatedSigma | None
    far_reading: FarReading | None
    observations: Observations
    residuals: FloatArray

    @property
    def chi2_per_dof(self) -> float:
        """NaN without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl compare --json`."""
        return {
            "model": {"version": self.version, "effects": [term.effect for term in self.terms]},
            "chi2_per_dof": self.chi2_per_dof,
            "dof": self.dof,
            "p_value": self.p_value,
            "channels": [each.as_json() for each in self.channels],
            "worst": [vars(each) for each in self.worst],
            "trends": [vars(each) for each in self.trends],
            "lines": [dict(each) for each in self.lines],
            "noise": [each.as_json() for each in self.noise],
            "lack_of_fit": None if self.lack_of_fit is None else vars(self.lack_of_fit),
            "scatter": [each.as_json() for each in self.scatter],
            "stated_sigma": None if self.stated_sigma is None else self.stated_sigma.as_json(),
            "far_reading": None if self.far_reading is None else vars(self.far_reading),
            **_said_of_excluded(self.observations.excluded),
        }


def _said_of_excluded(excluded: Mapping[str, str]) -> dict[str, Any]:
    return {"excluded": dict(excluded)} if excluded else {}


@dataclass(frozen=True)
class Rank:
    """One effect of the catalogue, as it stands beside the model the diagnosis ended with.

    `statistic` is the fall of chi-square it would bring (for one that was suggested: brings), `keep` the share of it
    that no fitted parameter imitates, `detectable` by parameter the size these data would have revealed (power .95).
    """

    term: Term
    p_value: float
    p_value_corrected: float
    parameters: Mapping[str, Estimate]
    held_out_error_ratio: float
    equivalent_to: tuple[str, ...]
    statistic: float
    keep: float
    detectable: Mapping[str, float]

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl diagnose --json`."""
        return {
            "effect": self.term.effect,
            "choice": dict(self.term.choice),
            "p_value": self.p_value,
            "p_value_corrected": self.p_value_corrected,
            "parameters": {name: each.as_json() for name, each in self.parameters.items()},
            "held_out_error_ratio": self.held_out_error_ratio,
            "equivalent_to": list(self.equivalent_to),
            "chi2_fall": self.statistic,
            "keep": self.keep,
            "smallest_detectable": dict(self.detectable),
        }


@dataclass(frozen=True)
class Inseparable:
    """`effect` cannot be told from `other` ("baseline:theta0" or an id); `shift` says what it does to the result."""

    effect: str
    other: str
    shift: str = ""

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl diagnose --json`."""
        return {"effect": self.effect, "from": self.other, "shift": self.shift}


@dataclass(frozen=True)
class Unexplained:
    """What no known effect describes: where it is, in words and numbers."""

    channel: str
    component: str
    description: str
    p_value: float
    details: Mapping[str, Any] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl diagnose --json`."""
        return {**vars(self), "details": dict(self.details)}


@dataclass(frozen=True)
class Step:
    """A model on the way: after adding `added` (None: the start) or dropping `dropped`."""

    terms: tuple[Term, ...]
    added: str | None
    dropped: tuple[str, ...]
    chi2_per_dof: float
    p_value: float
    error_fit: float
    error_held_out: float


@dataclass(frozen=True)
class JointFit:
    """What was suggested, fitted as a whole: `terms` with their choices, and what adding them brings.

    `held` parameters are imitated by others and stay at zero.
    """

    terms: tuple[Term, ...]
    chi2_fall: float
    minus_2_log_l: float
    parameters: Mapping[str, Estimate]
    held: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Keys of `joint_fit` in `rigctl diagnose --json`."""
        return {
            "terms": [term.as_json() for term in self.terms],
            "chi2_fall": self.chi2_fall,
            "minus_2_log_l": self.minus_2_log_l,
            "parameters": {name: each.as_json() for name, each in self.parameters.items()},
            "held": list(self.held),
        }


@dataclass(frozen=True)
class Diagnosis:
    """The answer to: which physical effect is missing?"""

    verdict: Verdict
    alpha: float
    terms: tuple[Term, ...]
    suggested: tuple[Term, ...]
    ranking: tuple[Rank, ...]
    inseparable: tuple[Inseparable, ...]
    unexplained: Unexplained | None
    not_testable: Mapping[str, str]
    steps: tuple[Step, ...]
    n_eff: float
    noise: tuple[NoiseEntry, ...] = ()
    joint_fit: JointFit | None = None
    hidden_in_slow_noise: tuple[HiddenInNoise, ...] = ()
    or_correlated_noise: tuple[tuple[str, str], ...] = ()
    """An effect, given or suggested, that noise correlated along a column describes as well, and that column."""
    """Where noise that is slower than this tells may pass for an effect along the order."""
    scatter: tuple[UnevenScatter, ...] = ()
    stated_sigma: StatedSigma | None = None
    far_reading: FarReading | None = None
    next_measurement: Mapping[str, Any] | None = None
    impossible: Mapping[str, str] = field(default_factory=dict)
    """Effects that explain the data by values that nature never has, and which."""
    excluded: Mapping[str, str] = field(default_factory=dict)
    """Readings that were marked invalid where they were recorded, and why."""

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl diagnose --json`."""
        return {
            "verdict": self.verdict,
            "alpha": self.alpha,
            "model": {"effects": [term.effect for term in self.terms]},
            "suggested": [term.effect for term in self.suggested],
            "ranking": [each.as_json() for each in self.ranking],
            "inseparable": [each.as_json() for each in self.inseparable],
            "unexplained": None if self.unexplained is None else self.unexplained.as_json(),
            "not_testable": dict(self.not_testable),
            "impossible": dict(self.impossible),
            "steps": [
                {**vars(step), "terms": [term.effect for term in step.terms], "dropped": list(step.dropped)}
                for step in self.steps
            ],
            "trials": self.n_eff,
            "noise": [each.as_json() for each in self.noise],
            "joint_fit": None if self.joint_fit is None else self.joint_fit.as_json(),
            "hidden_in_slow_noise": [each.as_json() for each in self.hidden_in_slow_noise],
            "or_correlated_noise": [{"effect": effect, "order": order} for effect, order in self.or_correlated_noise],
            "scatter": [each.as_json() for each in self.scatter],
            "stated_sigma": None if self.stated_sigma is None else self.stated_sigma.as_json(),
            "far_reading": None if self.far_reading is None else vars(self.far_reading),
            "next_measurement": dict(self.next_measurement or {}),
            **_said_of_excluded(self.excluded),
        }


@dataclass(frozen=True)
class Rms:
    """What a model leaves of a channel, in the channel's unit."""

    value: float
    unit: str


@dataclass(frozen=True)
class ModelFit:
    """A model fitted to its observations; whitened residuals (n,), errors with 1.00 = noise.

    `minus_2_log_l` is at its least within the ladder's family of noise, `held_out_log_score` per datum, `held` are
    parameters at zero that others imitate, `warnings` what speaks against the fit, `excluded` readings that were
    marked invalid where they were recorded, and why.
    """

    terms: tuple[Term, ...]
    parameters: Mapping[str, Estimate]
    chi2: float
    dof: int
    p_value: float
    error_fit: float
    error_held_out: float
    residuals: FloatArray
    result: Mapping[str, Any]
    rms: Mapping[str, Rms]
    minus_2_log_l: float
    held_out_log_score: float
    noise: tuple[NoiseEntry, ...]
    stated_sigma: StatedSigma | None = None
    held: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    excluded: Mapping[str, str] = field(default_factory=dict)

    @property
    def chi2_per_dof(self) -> float:
        """NaN without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl fit --json`."""
        return {
            "effects": [term.effect for term in self.terms],
            "chi2_per_dof": self.chi2_per_dof,
            "dof": self.dof,
            "p_value": self.p_value,
            "error_fit": self.error_fit,
            "error_held_out": self.error_held_out,
            "parameters": {name: each.as_json() for name, each in self.parameters.items()},
            "result": dict(self.result),
            "rms": {channel: vars(each) for channel, each in self.rms.items()},
            "minus_2_log_l": self.minus_2_log_l,
            "held_out_log_score": self.held_out_log_score,
            "noise": [each.as_json() for each in self.noise],
            "stated_sigma": None if self.stated_sigma is None else self.stated_sigma.as_json(),
            "held": list(self.held),
            "warnings": list(self.warnings),
            **_said_of_excluded(self.excluded),
        }
