"""A single reading far from all others: a slip of the pen, or a reading of something else.

Asked of the farthest is what Thompson asked (Ann. Math. Statist. 6 (1935) 214): is it off from what all others say by
more than their scatter allows, as the farthest of so many? Noise of heavy tails has such readings too, but then the
next is not much nearer.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from rigctl.workbench.scatter import FarReading
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.uneven_scatter import independent_residuals

SIGNIFICANT = 0.01
FAR = SIGNIFICANT ** (-1.0 / 4.0)
"""Times as far as the next: of noise as Student's t with 4 degrees of freedom, whose tails fall with that power, the
farthest reading is so far at this level."""

# Of a reading's square: one that decides its own fit is off from nothing.
_LEAST_FREE = 1e-3


def far_reading(attempt: Attempt) -> FarReading | None:
    """The reading that a fitted model has far from all others; None where there is none, or several series are."""
    given, dof = attempt.model.observations, attempt.result.dof - 1
    if len(given.series) != 1 or dof < 1:
        return None
    farthest = int(np.argmax(np.abs(independent_residuals(attempt))))
    alone = np.zeros((len(given.value), 1))
    alone[farthest] = 1.0
    column = attempt.whitened_columns(alone)
    free = attempt.projector.free(column)[:, 0]
    # One over the standard deviation that a reading there has beside all others, and beside what they say.
    whole, size = float(np.linalg.norm(column)), float(np.linalg.norm(free))
    if size**2 < _LEAST_FREE * whole**2:
        return None
    # As if the fit knew nothing of it.
    off = float(free @ attempt.projector.left) / size
    others = attempt.projector.left - off * free / size
    scatter = math.sqrt(max(float(others @ others) / dof, attempt.noise.least))
    t, following = off / scatter, float(np.abs(others).max()) / scatter
    p_value = min(1.0, 2.0 * len(given.value) * float(special.stdtr(dof, -abs(t))))
    if not p_value < SIGNIFICANT or not abs(t) > FAR * following:
        return None
    run_id, unit = given.run_ids[given.run_of[farthest]], given.series[0].unit
    return FarReading(run_id, abs(t), following, p_value, scatter / whole, unit)
