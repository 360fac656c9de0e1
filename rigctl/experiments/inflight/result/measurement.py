"""What an in-flight calibration, or a study of many, amounts to as a measurement result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigctl.analysis.measurement_result import MeasurementResult, Quantity, Source, checked
from rigctl.experiments.inflight.model.parameters import NAMES, UNITS
from rigctl.experiments.inflight.result.monte_carlo import Draw

METHOD = "Joint estimate from the lines of all sessions (method of Hardy et al., arXiv 1707.07630)"
STUDY = "Monte Carlo study: every draw simulates a satellite and calibrates it, and is compared with the exact truth"


def calibration_measured(
    fit: MeasurementResult, numbers: Mapping[str, Any], sessions: Mapping[str, str]
) -> MeasurementResult:
    """A fit of the sessions with what none of them sees, and delta of sessions of the test; `sessions` by run_id."""
    test = dict(numbers.get("ep") or {})
    count = len(fit.quantities) + len(test)
    names = [each.name for each in fit.quantities]
    sources = [
        replace(each, name=_named(each.name, sessions), covariance=_padded(each.covariance, count))
        for each in fit.sources
    ]
    systematic = np.zeros(count)
    for name, each in numbers["parameters"].items():
        if name in names:
            systematic[names.index(name)] = each["systematic"]
    for place, each in enumerate(test.values(), start=len(names)):
        systematic[place] = each["delta"].get("systematic", 0.0)
    # Signs between parameters are not kept, so that these are taken as independent.
    sources.append(
        Source("star tracker and coupling", "B", np.diag(systematic**2), origin="tracker_bias_rad, coupling_rad")
    )
    deltas = []
    for place, (name, each) in enumerate(test.items(), start=len(names)):
        delta = each["delta"]
        what = "all sessions" if name == "combined" else f"run {name}, {each['session']}"
        deltas.append(Quantity(f"delta ({what})", delta["value"], "1", group="equivalence principle"))
        for part, dof in (("noise", each.get("noise_dof", np.inf)), ("calibration", np.inf)):
            alone = np.zeros((count, count))
            alone[place, place] = delta[f"sigma_{part}"] ** 2
            sources.append(Source(f"{part} of delta ({what})", "A", alone, float(dof), origin="samples"))
    remarks = tuple(str(each) for each in numbers["remarks"])
    return checked(MeasurementResult((*fit.quantities, *deltas), tuple(sources), METHOD, remarks))


def study_measured(draws: Sequence[Draw]) -> MeasurementResult:
    """Mean errors of the joint estimate over all draws; `ProcedureError` with a single one."""
    errors = np.array(
        [[draw.estimates["joint"][name] - draw.truths["exact_truth"][name] for name in NAMES] for draw in draws]
    )
    spread = np.cov(errors.T) / len(draws) if len(draws) > 1 else np.full((len(NAMES), len(NAMES)), np.nan)
    source = Source("spread of the draws", "A", spread, len(draws) - 1.0, origin=f"{len(draws)} draws")
    quantities = tuple(
        Quantity(f"{name}, mean error", float(value), unit)
        for name, value, unit in zip(NAMES, errors.mean(axis=0), UNITS, strict=True)
    )
    remark = "A study of simulated satellites: no item was calibrated, and this certifies none."
    return checked(MeasurementResult(quantities, (source,), STUDY, (remark,), of_model=False))


def _named(name: str, sessions: Mapping[str, str]) -> str:
    run_id = name.removeprefix("noise of ")
    return f"noise of session {sessions[run_id]} (run {run_id})" if run_id in sessions else name


def _padded(covariance: Any, count: int) -> Any:
    wider = np.zeros((count, count))
    wider[: len(covariance), : len(covariance)] = covariance
    return wider
