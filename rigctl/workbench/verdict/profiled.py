"""Uncertainties where a place that was scanned for (a delay, a time constant) is left open by the data.

A fit keeps such a place near the value of its scan by a prior, which is no knowledge, and the curvature at a minimum
says nothing of a likelihood that goes on flat beside it. So the place is set to values one after another, all else is
fitted, and chi-square of the data alone weighs them: what a parameter is known to is the spread of its estimates
over all places, and of each estimate at its place. Its interval is where chi-square, all else fitted, is no more than
1 above the least (profile likelihood, as MINOS has it; James and Roos, Comput. Phys. Commun. 10 (1975) 343).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from rigctl.analysis.least_squares import FitResult, Parameter
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import UNFIT
from rigctl.workbench.study import ScansWithin, Term
from rigctl.workbench.verdict.fitted_model import FittedModel, Uncertainty
from rigctl.workbench.verdict.whitened_fit import whitened_least_squares

ITS_OWN = 0.2
"""Of the prior's sigma: data that know a place that well owe the prior 4 % at most, and see no more than they use."""

_FIRST_STEP, _LARGEST_STEP, _GROWTH = 0.5, 0.25, 1.15
"""In sigma of the place, in its logarithm, and from one step to the next."""
_AWAY = 9.0
"""Rise of chi-square beyond which a place counts for nothing."""
_MOST_STEPS = 30


def profiled(fitted: FittedModel, study: ScansWithin) -> Uncertainty:
    """The uncertainties of a fit, with those places profiled that its data leave open."""
    covariance, intervals = fitted.result.covariance.copy(), dict[int, tuple[float, float]]()
    for place in _scanned(fitted):
        narrow = _is_narrow(fitted, place)
        if narrow and not _goes_on_flat(fitted, place):
            continue
        found = list(_walk(fitted, place, _range(fitted, study, place), narrow))
        covariance += _spread(fitted, found) - fitted.result.covariance
        intervals |= _intervals(fitted, found, place)
    return Uncertainty(covariance, intervals)


def _scanned(fitted: FittedModel) -> list[int]:
    """Scanned parameters that are free."""
    return [
        place
        for place, each in enumerate(fitted.model.parameters)
        if each.name in fitted.scanned and each.name not in fitted.held and each.prior is not None
    ]


def _is_narrow(fitted: FittedModel, place: int) -> bool:
    """Whether the minimum is so narrow that the prior has next to no part in it."""
    prior = fitted.model.parameters[place].prior
    assert prior is not None
    return bool(np.sqrt(fitted.result.covariance[place, place]) <= ITS_OWN * prior.sigma)


def _goes_on_flat(fitted: FittedModel, place: int) -> bool:
    """Whether the data leave room beside a narrow minimum: one that ends where the next sample comes in is as narrow
    as that step, however little is known of the place."""
    value, least = float(fitted.result.values[place]), fitted.result.chi2
    for away in (-_LARGEST_STEP, _LARGEST_STEP):
        beside = _fit_at(fitted, place, value * float(np.exp(away)), fitted.result.values)
        if beside is not None and beside.chi2 <= least + _AWAY:
            return True
    return False


def _range(fitted: FittedModel, study: ScansWithin, place: int) -> tuple[float, float]:
    """Where a scan looks for the parameter; the fit may have ended beyond."""
    name, value = fitted.names[place], float(fitted.result.values[place])
    term: Term = next(each for each in fitted.model.terms if each.effect == fitted.model.owners[place])
    low, high = study.within(term)[name.rpartition(".")[2]]
    return min(low, value), max(high, value)


def _walk(
    fitted: FittedModel, place: int, within: tuple[float, float], narrow: bool
) -> Iterator[tuple[float, FitResult]]:
    """Fits with the parameter set to values outwards on both sides, each with the length it stands for (of ln)."""
    value = float(fitted.result.values[place])
    if not value > 0.0:
        return
    sigma = float(np.sqrt(fitted.result.covariance[place, place])) / value
    first = min(_FIRST_STEP * sigma, _LARGEST_STEP)
    there = _fit_at(fitted, place, value, fitted.result.values)
    if there is None:
        return
    yield first, there
    for way in (-1.0, 1.0):
        step = _LARGEST_STEP if narrow else first
        log, start, least = float(np.log(value)), there.values, there.chi2
        for _ in range(_MOST_STEPS):
            log += way * step
            if not within[0] <= np.exp(log) <= within[1]:
                break
            found = _fit_at(fitted, place, float(np.exp(log)), start)
            if found is None or found.chi2 > least + _AWAY:
                break
            step = min(step * _GROWTH, _LARGEST_STEP)
            yield step, found
            start, least = found.values, min(least, found.chi2)


def _fit_at(fitted: FittedModel, place: int, value: float, start: FloatArray) -> FitResult | None:
    """Everything but one parameter fitted; None where these data do not determine it."""
    parameters: list[Parameter] = []
    for number, each in enumerate(fitted.model.parameters):
        fixed = each.fixed or each.name in fitted.held or number == place
        at = value if number == place else float(np.clip(start[number], each.lower, each.upper))
        parameters.append(replace(each, start=at, fixed=fixed))
    try:
        found = whitened_least_squares(fitted.model, fitted.noise, parameters)
    except UNFIT:
        return None
    return found if np.isfinite(found.values).all() and np.isfinite(found.covariance).all() else None


def _spread(fitted: FittedModel, found: list[tuple[float, FitResult]]) -> FloatArray:
    """Mean square about the values of the fit, every place with the likelihood of the data there."""
    if len(found) < 2:  # nothing could be fitted beside it
        return fitted.result.covariance
    least = min(each.chi2 for _, each in found)
    weights = np.array([length * np.exp(-0.5 * (each.chi2 - least)) for length, each in found])
    away = [each.values - fitted.result.values for _, each in found]
    parts = [each.covariance + np.outer(d, d) for (_, each), d in zip(found, away, strict=True)]
    return np.asarray(np.einsum("k,kij->ij", weights / weights.sum(), np.array(parts)))


def _intervals(
    fitted: FittedModel, found: list[tuple[float, FitResult]], place: int
) -> dict[int, tuple[float, float]]:
    """Of the parameters of the effect whose place this is."""
    if len(found) < 2:
        return {}
    least = min(each.chi2 for _, each in found)
    near = [each for _, each in found if each.chi2 <= least + 1.0]
    edges = _edges(sorted((each for _, each in found), key=lambda each: each.values[place]), least + 1.0)
    owner, intervals = fitted.model.owners[place], {}
    for number, other in enumerate(fitted.model.owners):
        if other != owner or fitted.names[number] in fitted.held:
            continue
        # At a place the likelihood of all others is nearly Gaussian: what is left of the rise by 1 is theirs.
        half = [np.sqrt(each.covariance[number, number] * (least + 1.0 - each.chi2)) for each in near]
        ends = [each.values[number] + way * h for each, h in zip(near, half, strict=True) for way in (-1.0, 1.0)]
        ends += [edge[number] for edge in edges]
        intervals[number] = (float(min(ends)), float(max(ends)))
    return intervals


def _edges(ordered: Sequence[FitResult], level: float) -> list[FloatArray]:
    """All parameters where chi-square passes the level between one place and the next."""
    edges = []
    for one, other in pairwise(ordered):
        if (one.chi2 <= level) != (other.chi2 <= level):
            share = (level - one.chi2) / (other.chi2 - one.chi2)
            edges.append(np.asarray(one.values + share * (other.values - one.values)))
    return edges
