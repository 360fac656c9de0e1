"""Offsets that data share (batches, stations), as the noise estimate takes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.noise import Noise, orthonormal


def in_units(given: Observations, where: IntArray, columns: FloatArray) -> FloatArray:
    """Columns at some of the data in units of the given sigma; without shared offsets, where all data are there."""
    scaled = np.asarray(columns / (given.sigma[where] if columns.ndim == 1 else given.sigma[where][:, None]))
    if given.offsets and len(where) == len(given.value):
        return given.correlated.solve(scaled)
    return scaled


def from_units(given: Observations, where: IntArray, columns: FloatArray) -> FloatArray:
    """The inverse of `in_units` for columns (n, k)."""
    shared = given.offsets and len(where) == len(given.value)
    scaled = given.correlated.times(columns) if shared else columns
    return np.asarray(scaled * given.sigma[where][:, None])


def without_offsets(given: Observations, residuals: FloatArray) -> FloatArray:
    """Residuals (n,) less the offsets that data share, as best predicted from them (Henderson's equations)."""
    if not given.offsets:
        return residuals
    single = _own(given)
    # With V the correlation of all: what is a datum's own is (single I) V^-1 of the residuals.
    own = single * given.correlated.solve_transposed(given.correlated.solve(residuals / given.sigma))
    return np.asarray(own * given.sigma)


def own_sigma(given: Observations, sigma: FloatArray) -> FloatArray:
    """Of the standard deviation (n,) of data what is each datum's own, beside the offsets that data share."""
    return np.asarray(sigma * np.sqrt(_own(given)))


def _own(given: Observations) -> float:
    """The part of the variance that is each datum's own."""
    return 1.0 - sum(each.share**2 for each in given.offsets)


def with_offsets(given: Observations, noise: Noise) -> Noise:
    """The noise, told what varies only between the offsets that data share."""
    between = []
    for offset in given.offsets:
        levels = int(offset.level_of.max()) + 1
        indicators = np.equal.outer(offset.level_of, np.arange(levels)).astype(np.float64)
        between.append((orthonormal(noise.whiten(indicators), 1e-9), float(max(levels - 1, 1))))
    return replace(noise, between=tuple(between)) if between else noise
