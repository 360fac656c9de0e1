"""Errors of many simulated calibrations: the paper's tables 2 and 3."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.inflight.model.parameters import NAMES, UNITS
from rigctl.experiments.inflight.result.missions import summary
from rigctl.experiments.inflight.result.published import published
from rigctl.experiments.inflight.result.unseen import unseen_covariance

DRAW = "calibration-draw"
"""Kind of the documents that hold one draw each: see `Draw.as_json`."""

_KEPT = ("estimates", "sigmas", "truths", "tests", "covariance")
ESTIMATES, TRUTHS = ("paper", "joint"), ("paper_truth", "exact_truth")


@dataclass(frozen=True)
class Draw:
    """One simulated calibration: estimates with their sigmas and truths, each by parameter name.

    `estimates` has "paper" and "joint", `truths` "paper_truth" and "exact_truth".
    """

    number: int
    estimates: Mapping[str, Mapping[str, float]]
    sigmas: Mapping[str, Mapping[str, float]]
    truths: Mapping[str, Mapping[str, float]]
    tests: Mapping[str, Any] = field(default_factory=dict)
    """By session of the test, as `missions.tested` says."""
    covariance: Sequence[Sequence[float]] = ()
    """Of the joint estimate, by noise, (10, 10); none in studies of before it was kept."""

    def as_json(self) -> dict[str, Any]:
        """As a store keeps it."""
        return {"draw": self.number, **{name: getattr(self, name) for name in _KEPT}}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Draw:
        """The draw that `as_json` wrote; `DataError` when something is missing."""
        try:
            told = (data["estimates"], data["sigmas"], data["truths"])
            return cls(int(data["draw"]), *told, data.get("tests", {}), data.get("covariance", ()))
        except KeyError as error:
            raise DataError(f"a draw of the study has no {error.args[0]}; run it again") from error


def tables(draws: Sequence[Draw], constants: Mapping[str, float] = MappingProxyType({})) -> dict[str, Any]:
    """Keys of `rigctl result --json` for a Monte Carlo study; `DataError` without draws.

    `constants` of the recording may say how well the star tracker stands.

    Errors are |estimate - truth|: their worst, mean and standard deviation. `analytic_sigma` beside each row is the
    mean of the estimates' own sigmas, `rms` the root mean square of the joint and the paper's errors.
    """
    if not draws:
        raise DataError("the study has no draws yet; run it")
    errors = {(estimate, truth): errors_of(draws, estimate, truth) for estimate in ESTIMATES for truth in TRUTHS}
    sigmas = {estimate: np.nanmean(_values(draws, "sigmas", estimate), axis=0) for estimate in ESTIMATES}
    return {
        "draws": len(draws),
        "table2": {
            name: {
                "unit": unit,
                "objective": published().rows[name].objective,
                "reference": {key: getattr(published().rows[name], key) for key in ("worst", "mean", "std")},
                **{
                    estimate: {
                        **{truth: _summary(errors[estimate, truth][:, place]) for truth in TRUTHS},
                        "analytic_sigma": float(sigmas[estimate][place]),
                    }
                    for estimate in ESTIMATES
                },
                "over_objective": float(
                    np.mean(errors["paper", "paper_truth"][:, place] > published().rows[name].objective)
                ),
            }
            for place, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
        },
        "table3": budget(errors["paper", "paper_truth"]),
        **_pulls(draws, constants),
        **_tests(draws),
    }


def errors_of(draws: Sequence[Draw], estimate: str, truth: str) -> FloatArray:
    """|estimate - truth|, shape (draws, 10), of one of `ESTIMATES` and of `TRUTHS`; NaN without an estimate."""
    return np.abs(_values(draws, "estimates", estimate) - _values(draws, "truths", truth))


def _pulls(draws: Sequence[Draw], constants: Mapping[str, float]) -> dict[str, Any]:
    """Keys `pulls` and `chi2`: errors of the joint estimate, exact truth, by the budget of each draw.

    `chi2` is that of the ten errors with their covariance: 10 in the mean where the correlations are right too.
    """
    if not all(draw.covariance for draw in draws):
        return {}
    estimates = _values(draws, "estimates", "joint")
    errors = estimates - _values(draws, "truths", "exact_truth")
    covariances = np.array([draw.covariance for draw in draws])
    covariances += [
        unseen_covariance(values, covariance, constants)
        for values, covariance in zip(estimates, covariances, strict=True)
    ]
    sigmas = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    pulls = errors / sigmas
    # Scaled: sizes of the parameters are twelve powers of ten apart.
    correlations = covariances / (sigmas[:, :, None] * sigmas[:, None, :])
    chi2 = np.einsum("di,di->d", pulls, np.linalg.solve(correlations, pulls[:, :, None])[:, :, 0])
    return {
        "pulls": {
            name: {"mean": float(np.mean(each)), "rms": float(np.sqrt(np.mean(each**2)))}
            for name, each in zip(NAMES, pulls.T, strict=True)
        },
        "chi2": {"mean": float(np.mean(chi2)), "expected": len(NAMES)},
    }


def _tests(draws: Sequence[Draw]) -> dict[str, Any]:
    """Key `test`, where sessions of the test were flown."""
    truth = draws[0].truths.get("test_truth", {}).get("delta", 0.0)
    made = {session: summary([draw.tests[session] for draw in draws], truth) for session in draws[0].tests}
    return {"test": made} if made else {}


def budget(errors: FloatArray) -> dict[str, Any]:
    """Table 3 from errors (draws, 10): each times its driver, and their linear totals; before calibration beside."""
    paper = published()
    scale = np.array([paper.rows[name].per_unit_m_s2 for name in NAMES])
    worst, mean = errors.max(axis=0) * scale, errors.mean(axis=0) * scale
    return {
        # The paper adds the rows linearly, as if all errors conspired.
        "total_worst_m_s2": float(worst.sum()),
        "total_mean_m_s2": float(mean.sum()),
        "reference": {"total_worst_m_s2": paper.total_worst_m_s2, "total_mean_m_s2": paper.total_mean_m_s2},
        "limit_m_s2": paper.limit_m_s2,
        "before_m_s2": paper.before_m_s2,
        "rows": {
            name: {
                "worst_m_s2": float(worst[place]),
                "mean_m_s2": float(mean[place]),
                "before_m_s2": paper.rows[name].before_m_s2,
                "term": paper.rows[name].term,
            }
            for place, name in enumerate(NAMES)
        },
    }


def _values(draws: Sequence[Draw], group: str, which: str) -> FloatArray:
    """Shape (draws, 10)."""
    try:
        return np.array([[float(getattr(draw, group)[which][name]) for name in NAMES] for draw in draws])
    except KeyError as error:
        raise DataError(f"a draw of the study has no {which} of {error.args[0]}; run it again") from error


def _summary(errors: FloatArray) -> dict[str, float]:
    return {
        "worst": float(errors.max()),
        "mean": float(errors.mean()),
        "std": float(errors.std()),
        "rms": float(np.sqrt(np.mean(errors**2))),
    }
