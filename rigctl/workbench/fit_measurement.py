"""The fit of a model as a measurement result: what each source of noise does to what the experiment is for.

Estimates are linear in the whitened data, p = C J' (W d), so that their covariance falls into parts, one for each
pool of noise with its own degrees of freedom, and one for priors. Where noise may be correlated, its part is that of
the noise as it is told beside what was found alone (decision 078).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rigctl.analysis.measurement_result import MeasurementResult, Quantity, Source, checked
from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.noise import orthonormal
from rigctl.workbench.workbench import Workbench

PRIORS = "what was known beforehand"
METHOD = "Weighted least squares of the model to all valid data"

_STEP = 0.05
"""Of a parameter's standard uncertainty: steps in which results are differentiated."""


def fit_measurement(workbench: Workbench) -> MeasurementResult:
    """What the current model's fit says, by `Study.result` or else its parameters; `DataError`, `ProcedureError`."""
    attempt = workbench.attempt(workbench.current)
    covariance = attempt.uncertainty.covariance
    found = _result_of(attempt, attempt.result.values, covariance)
    slopes = _slopes(attempt, covariance, found)
    values = [float(each["value"]) for each in found.values()]
    units = [str(each.get("unit", "")) for each in found.values()]
    sources = [_carried(each, slopes) for each in parameter_sources(attempt)]
    quantities = tuple(Quantity(*each) for each in zip(found, values, units, strict=True))
    plain = MeasurementResult(quantities, tuple(sources), METHOD)
    return checked(_as_reported(plain, np.array([float(each["sigma"]) for each in found.values()])))


def _result_of(attempt: Attempt, values: FloatArray, covariance: FloatArray) -> dict[str, Mapping[str, Any]]:
    """By name what has value and sigma: results of the study that are free, or parameters where there are none."""
    given = attempt.study.result(attempt.model, values, covariance)
    held = {each.name for each in attempt.model.parameters if each.fixed} | attempt.held
    numbers = {
        name: each
        for name, each in given.items()
        if name not in held and isinstance(each, Mapping) and {"value", "sigma"} <= each.keys()
    }
    if numbers:
        return numbers
    rows = zip(attempt.names, values, np.diag(covariance), attempt.model.units, strict=True)
    return {
        name: {"value": value, "sigma": max(variance, 0.0) ** 0.5, "unit": unit}
        for name, value, variance, unit in rows
        if name not in held
    }


def _slopes(attempt: Attempt, covariance: FloatArray, found: Mapping[str, Any]) -> FloatArray:
    """d result / d parameters, (results, parameters), by central differences."""
    values = attempt.result.values
    slopes = np.zeros((len(found), len(values)))
    for place, variance in enumerate(np.diag(covariance)):
        if not variance > 0.0:
            continue
        step = np.zeros(len(values))
        step[place] = _STEP * variance**0.5
        up, down = (_result_of(attempt, values + way * step, covariance) for way in (1.0, -1.0))
        ends = [[side.get(name, each)["value"] for name, each in found.items()] for side in (up, down)]
        slopes[:, place] = (np.array(ends[0]) - np.array(ends[1])) / (2.0 * step[place])
    return slopes


def parameter_sources(attempt: Attempt) -> list[Source]:
    """What each pool of noise, each prior and each known input does to the parameters of a fit; covariances (m, m) in
    their units."""
    covariance, jacobian = np.nan_to_num(attempt.result.covariance), attempt.jacobian
    # A parameter that is not determined makes no other uncertain.
    of_its_own = 0.0 * attempt.result.covariance
    found = []
    for name, kind, rows, dof, origin in _rows(attempt):
        moved = covariance @ jacobian[rows].T if rows.dtype.kind in "iu" else covariance @ (rows @ jacobian).T
        part = moved @ moved.T
        if attempt.noise_beside_fit is not attempt.noise and rows.dtype.kind in "iu" and name != PRIORS:
            weights = np.zeros_like(attempt.weights)
            weights[rows] = attempt.weights[rows]
            part = attempt.noise_beside_fit.variance_of(weights)
        # Readings have noise of their own each time, also where its size is stated.
        found.append(Source(name, kind, part + of_its_own, dof, origin=origin, common=name == PRIORS))
    for inputs, by_inputs in attempt.by_inputs:
        said = ", ".join(f"{u:.3g}" for u in np.sqrt(np.diag(inputs.covariance)))
        found.append(Source(", ".join(inputs.names), "B", by_inputs, inputs.dof, said, "constants of the baseline"))
    return [each for each in found if np.any(each.standard_uncertainty > 0.0)]


def _rows(attempt: Attempt) -> Iterator[tuple[str, Any, Any, float, str]]:
    """Of each source: rows of the whitened Jacobian, or directions in its rows, and its degrees of freedom."""
    given, noise, data = attempt.model.observations, attempt.noise, len(attempt.result.residuals)
    below = len(attempt.left) - data
    between = [(np.vstack([columns, np.zeros((below, columns.shape[1]))]), dof) for columns, dof in noise.between]
    bases = [(orthonormal(columns, 1e-9).T, dof) for columns, dof in between]
    for number, (basis, dof) in enumerate(bases):
        name = given.offsets[number].name if number < len(given.offsets) else f"offset {number + 1}"
        yield f"offsets that readings of one {name} share", "A", basis, dof, "scatter between them"
    outside = np.eye(len(attempt.left))[:data] if bases else None
    for basis, _ in bases:
        assert outside is not None
        outside = outside - (outside @ basis.T) @ basis
    for number, pool in enumerate(given.pools):
        rows = np.flatnonzero(given.pool_of == number)
        if not len(rows):
            continue
        # Of a pool all data have the same noise behind them; the fewest degrees of freedom count.
        dof = float(np.min(noise.dof[rows]))
        stated = pool.stated and pool.dof <= 0.0
        origin = "stated uncertainties" if stated else "scatter about the model" if pool.dof <= 0.0 else "samples"
        name = f"noise of {pool.name}" if pool.name else "noise of the readings"
        yield name, "B" if stated and np.isinf(dof) else "A", rows if outside is None else outside[rows], dof, origin
    if below:
        yield PRIORS, "B", np.arange(data, data + below), np.inf, "priors of the model"


def _carried(source: Source, slopes: FloatArray) -> Source:
    return replace(source, covariance=slopes @ source.covariance @ slopes.T)


def _as_reported(result: MeasurementResult, sigmas: FloatArray) -> MeasurementResult:
    """With the standard uncertainties of the fit: where a likelihood is no parabola they are not its curvature's."""
    here = result.standard_uncertainty
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where((here > 0.0) & np.isfinite(sigmas), sigmas / here, 1.0)
    scaled = tuple(replace(each, covariance=each.covariance * np.outer(scale, scale)) for each in result.sources)
    return MeasurementResult(result.quantities, scaled, result.method, result.remarks)
