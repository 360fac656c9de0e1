"""How well the place of a step is known, which no derivative tells: the misfit jumps from reading to reading."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.model.scanned import Step
from rigctl.experiments.table.model.start import FREE, span_of

_NEAREST = 400
"""Places beyond are too far away to be as likely, and would take an array of readings times places."""


def place_sigma(step: Step, at: float, weight: FloatArray, held: FloatArray, left: FloatArray, dof: int) -> float:
    """Standard uncertainty of the place `at`, in the column's unit; NaN where these data do not tell it.

    `weight` (n,) is one over the readings' sigma, `held` (n, m) weighted derivatives of all else that is fitted,
    `left` (n,) the weighted readings less everything but the step. Places are as good as their least misfit says,
    exp(-chi2 / 2) with the variance that is left at the best over `dof`; within a gap between two readings every
    place is as good as another. Readings count as independent.
    """
    values = step.column.values
    order = np.argsort(values, kind="stable")
    space = span_of(held)
    free = left - space @ (space.T @ left)
    # Products of all steps with a column are its sums from behind: readings past the place count.
    past = weight[order][::-1, None] * np.column_stack([free, weight, space])[order][::-1]
    along, square, beside = np.split(np.cumsum(past, axis=0)[::-1], [1, 2], axis=1)
    kept = square[:, 0] - np.sum(beside**2, axis=1)
    places = step.places(-np.inf, np.inf)
    first = np.searchsorted(values[order], places)
    usable = kept[first] > FREE * square[first, 0]
    places, first = places[usable], first[usable]
    if not places.size or dof <= 0:
        return float("nan")
    misfit = float(free @ free) - along[first, 0] ** 2 / kept[first]
    return _spread(places, at, values[order], misfit, dof)


def place_sigma_in(
    step: Step, at: float, whiten: Callable[[FloatArray], FloatArray], held: FloatArray, left: FloatArray, dof: int
) -> float:
    """The same in noise that `whiten` makes independent, by the nearest places; `held` and `left` are in the
    readings' own units."""
    every = step.places(-np.inf, np.inf)
    places = np.sort(every[np.argsort(np.abs(every - at), kind="stable")[:_NEAREST]])
    space, free = span_of(whiten(held)), whiten(left)
    free = free - space @ (space.T @ free)
    columns = whiten(step.scan([step.full_choice(float(place)) for place in places])[:, :, 0])
    square, along = np.sum(columns**2, axis=0), free @ columns
    kept = square - np.sum((space.T @ columns) ** 2, axis=0)
    usable = kept > FREE * square
    if not usable.any() or dof <= 0:
        return float("nan")
    misfit = float(free @ free) - along[usable] ** 2 / kept[usable]
    return _spread(places[usable], at, np.sort(step.column.values), misfit, dof)


def _spread(places: FloatArray, at: float, ordered: FloatArray, misfit: FloatArray, dof: int) -> float:
    """Root mean square distance from `at` of places between `ordered` values, each as likely as its misfit says."""
    first = np.searchsorted(ordered, places)
    gap = ordered[first] - ordered[first - 1]
    likelihood = gap * np.exp(-0.5 * dof * (misfit / misfit.min() - 1.0))
    square_distance = (places - at) ** 2 + gap**2 / 12.0
    return float(np.sqrt(likelihood @ square_distance / likelihood.sum()))
