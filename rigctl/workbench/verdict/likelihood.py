"""-2 log L of a model by ordinary maximum likelihood, within one family of noise for a whole ladder.

Restricted likelihoods of different designs do not compare. Here the form of the noise is the account's, and its scale
and correlation are maximised with the parameters, for every model anew. Each step lowers -2 log L, so that a search
that starts from the optimum of a model with fewer terms ends no higher than that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.study import Model
from rigctl.workbench.verdict.fitted_model import FittedModel, refitted_values
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.noise_estimate import NoiseEstimator

# The tolerance is far below the 1e-6 by which the ladder's -2 log L may rise at most.
_ROUNDS, _TOLERANCE = 30, 1e-9


@dataclass(frozen=True)
class Optimum:
    """Where -2 log L of a model is least: its parameters by name, and the noise there."""

    minus_2_log_l: float
    values: Mapping[str, float]
    noise: Noise


def maximum_likelihood(fitted: FittedModel, estimator: NoiseEstimator, parents: Sequence[Optimum] = ()) -> Optimum:
    """The least -2 log L from the fit, and from optima of models with fewer terms, the new ones at zero."""
    starts = [(fitted.values, estimator.likeliest(fitted.unexplained(), fitted.noise))]
    # From there the search only descends: a model with more terms ends no higher than one with fewer.
    starts += [(_with_nothing_new(fitted.model, parent.values), parent.noise) for parent in parents]
    found = [_descended(fitted, estimator, values, noise) for values, noise in starts]
    return min(found, key=lambda optimum: optimum.minus_2_log_l)


def _descended(fitted: FittedModel, estimator: NoiseEstimator, values: Mapping[str, float], noise: Noise) -> Optimum:
    """Noise and parameters improved in turn from a start."""
    best = Optimum(_minus_2_log_l(fitted, values, noise), values, noise)
    for _ in range(_ROUNDS):
        left = _left(fitted.model, best.values)
        likelier = estimator.likeliest(left, best.noise)
        moved = refitted_values(fitted.model, likelier, fitted.held, best.values)
        # A refit may end in another minimum; the values it began with are kept then, so that -2 log L never rises.
        now = min(
            (Optimum(_minus_2_log_l(fitted, v, likelier), v, likelier) for v in (best.values, moved)),
            key=lambda optimum: optimum.minus_2_log_l,
        )
        if now.minus_2_log_l >= best.minus_2_log_l - _TOLERANCE:
            return min((best, now), key=lambda optimum: optimum.minus_2_log_l)
        best = now
    return best


def _minus_2_log_l(fitted: FittedModel, values: Mapping[str, float], noise: Noise) -> float:
    """With the pulls of the priors, which count as data."""
    white = noise.whiten(_left(fitted.model, values))
    pulls = [
        (each.prior.mean - values[each.name]) / each.prior.sigma
        for each in fitted.model.parameters
        if each.prior is not None and not each.fixed and each.name not in fitted.held
    ]
    constant = len(white) * float(np.log(2.0 * np.pi))
    return float(white @ white + np.sum(np.square(pulls))) + noise.log_determinant() + constant


def _left(model: Model, values: Mapping[str, float]) -> FloatArray:
    at = np.array([values[each.name] for each in model.parameters])
    return np.asarray(model.observations.value - model.predict(at))


def _with_nothing_new(model: Model, known: Mapping[str, float]) -> dict[str, float]:
    """A parent's parameters; those of new terms at zero, but for what a scan has chosen."""
    chosen = {f"{term.effect}.{name}" for term in model.terms for name in term.choice}
    new = {
        each.name: 0.0 if owner and each.name not in chosen and not each.fixed and each.prior is None else each.start
        for each, owner in zip(model.parameters, model.owners, strict=True)
    }
    return {name: known.get(name, value) for name, value in new.items()}
