"""Conditions of the runs that vary and are not collinear with others."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigctl.core.arrays import FloatArray

COPY = 1e-4
"""Two conditions say the same when their squared correlation is nearer to 1: one follows the other within 1 %."""

# Relative: a set-point that varies in its last digits only is one.
_CONSTANT = 1e-6


def distinct(covariates: Mapping[str, FloatArray]) -> list[str]:
    """Names of those that vary, without what goes with an earlier one: an angle asked for and the angle reached."""
    names: list[str] = []
    for name, values in covariates.items():
        if _varies(values) and not any(_alike(values, covariates[other]) for other in names):
            names.append(name)
    return names


def _varies(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return bool(len(known) > 1 and np.ptp(known) > _CONSTANT * np.abs(known).max())


def _alike(one: FloatArray, other: FloatArray) -> bool:
    """True for two columns of which one is the other, scaled and shifted; unknown in the same places."""
    known = np.isfinite(one)
    if not np.array_equal(known, np.isfinite(other)) or np.count_nonzero(known) < 3:  # any two points are on a line
        return False
    return bool(np.corrcoef(one[known], other[known])[0, 1] ** 2 > 1.0 - COPY)
