"""Parameters of effects that other parameters imitate: held at zero, so that the fit of the rest is not singular."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError
from rigctl.workbench.study import ExactlyLinear, Model
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.score import ABSORBED

# Of an eigenvalue of the Gram matrix of unit columns.
_ROUNDING = 1e-14
_ALIKE = 1e-3
"""Shares that differ by no more are the same: by the last digit, which processors round each their own way."""
_OF_EXACT = 1e-5
"""Share below which a parameter that enters exactly linearly is absorbed: a square of years is almost a line."""


def absorbed_parameters(
    model: Model, noise: Noise, scanned: Collection[str], start: Mapping[str, float]
) -> frozenset[str]:
    """Names of those to hold at zero, found at `start`; `ProcedureError` where all of a term are among them.

    `scanned` parameters have priors, so that no fit is singular with them: they are not held, and do not count among
    what imitates.
    """
    names = [each.name for each in model.parameters]
    slopes = _slopes(model, noise, start)
    size = np.linalg.norm(slopes, axis=0)
    size[[name in scanned for name in names]] = 0.0
    gram = slopes.T @ slopes / np.outer(*2 * [np.where(size > 0.0, size, 1.0)])
    free = [
        place
        for place, owner in enumerate(model.owners)
        if owner and not model.parameters[place].fixed and names[place] not in scanned
    ]
    exact = model.exactly_linear if isinstance(model, ExactlyLinear) else frozenset()
    least_keep = np.array([_OF_EXACT if name in exact else ABSORBED for name in names])
    # One at a time, the most imitated first: with it held, the others may be determined again.
    held: list[int] = []
    while free:
        keep = _kept_shares(gram, np.setdiff1d(np.flatnonzero(size > 0.0), held), len(size))
        share = keep / least_keep
        smallest = min(share[free])
        if smallest >= 1.0:
            break
        # Of equals one whose effect has other parts, and the last, so that what was in the model before stays fitted.
        equals = [place for place in free if share[place] <= (1.0 + _ALIKE) * smallest]
        parts = Counter(model.owners[place] for place in free)
        least = max(equals, key=lambda place: (parts[model.owners[place]] > 1, place))
        held.append(least)
        free.remove(least)
    _require_a_part_of_each(model, held, scanned)
    return frozenset(names[place] for place in held)


def _slopes(model: Model, noise: Noise, start: Mapping[str, float]) -> FloatArray:
    """Whitened derivatives at `start`, with a row for each parameter's prior below, shape (n + m, m)."""
    values = [start.get(each.name, each.start) for each in model.parameters]
    slopes = noise.whiten(model.jacobian(np.array(values, dtype=np.float64)))
    weights = [0.0 if each.prior is None else 1.0 / each.prior.sigma for each in model.parameters]
    return np.vstack([slopes, np.diag(weights)])


def _kept_shares(gram: FloatArray, rest: np.ndarray, count: int) -> FloatArray:
    """What no other of the columns `rest` imitates of each, as a share of its length; 0 for the others."""
    values, vectors = np.linalg.eigh(gram[np.ix_(rest, rest)])
    keep = np.zeros(count)
    # The root of the inverse's diagonal is the inverse of that share.
    keep[rest] = 1.0 / np.sqrt(np.sum(vectors**2 / np.maximum(values, _ROUNDING), axis=1))
    return keep


def _require_a_part_of_each(model: Model, held: Collection[int], scanned: Collection[str]) -> None:
    for term in model.terms:
        # A rate or a period is nothing by itself.
        parts = [
            place
            for place, owner in enumerate(model.owners)
            if owner == term.effect and model.parameters[place].name not in scanned
        ]
        if parts and set(parts) <= set(held):
            raise ProcedureError(
                f"the fit is singular: these data cannot tell {term.effect} from the other parameters of the model; "
                "leave it out, or measure where the two differ"
            )
