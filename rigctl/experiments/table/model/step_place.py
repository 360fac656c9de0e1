"""How well the place of a step is known, which no derivative tells: the misfit jumps from reading to reading."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.model.scanned import Step
from rigctl.experiments.table.model.start import FREE, span_of


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
    gap = values[order][first] - values[order][first - 1]
    likelihood = gap * np.exp(-0.5 * dof * (misfit / misfit.min() - 1.0))
    square_distance = (places - at) ** 2 + gap**2 / 12.0
    return float(np.sqrt(likelihood @ square_distance / likelihood.sum()))
