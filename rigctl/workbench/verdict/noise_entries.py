"""The noise of a store's data, series by series, as every command tells it."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.correlated_groups import variances
from rigctl.core.arrays import IntArray
from rigctl.workbench.findings import NoiseEntry
from rigctl.workbench.study import NoisePool, Observations
from rigctl.workbench.verdict.fitted_model import FittedModel
from rigctl.workbench.verdict.noise import Correlation, Noise

_SAME = 1e-9
_MODELS = {"": "white", "exp": "white + relaxation", "power": "white + power law"}


def noise_entries(fitted: FittedModel) -> tuple[NoiseEntry, ...]:
    """One entry per series; data whose sigmas are known beforehand are pooled over runs."""
    given, noise = fitted.model.observations, fitted.noise
    scattered = [number for number, pool in enumerate(given.pools) if pool.dof <= 0.0]
    scattered = [number for number in scattered if np.any(given.pool_of == number)]
    # Noise that is taken as stated has no list of correlations.
    correlations = dict(zip(scattered, noise.correlations, strict=False))
    entries = []
    for number in range(len(given.series)):
        rows = np.flatnonzero(given.series_of == number)
        if len(rows):
            entries.append(_entry(given, noise, number, rows, correlations))
    return tuple(entries)


def _entry(
    given: Observations, noise: Noise, number: int, rows: IntArray, correlations: dict[int, Correlation]
) -> NoiseEntry:
    # A series may lie in several pools, one for each run.
    pools = [int(pool) for pool in np.unique(given.pool_of[rows])]
    first, series = given.pools[pools[0]], given.series[number]
    correlation = correlations.get(pools[0], Correlation("", 0.0))
    known = {pool: float(noise.dof[rows[given.pool_of[rows] == pool][0]]) for pool in pools}
    stated = first.dof > 0.0 or first.stated
    sigma = float(np.sqrt(np.mean(noise.total_sigma()[rows] ** 2)))
    return NoiseEntry(
        channel=series.channel,
        component=series.component,
        model=_MODELS[correlation.kind],
        sigma=_six_digits(sigma),
        unit=series.unit,
        dof=sum(known.values()),
        order=first.order,
        source=_source(first),
        scale=_six_digits(float(np.median(noise.sigma[rows] / given.sigma[rows]))) if stated else 1.0,
        exponent=_six_digits(correlation.shape) if correlation.kind == "power" else None,
        time_constant=_six_digits(correlation.shape) if correlation.kind == "exp" else None,
        correlated_share=_six_digits(_correlated_share(given, noise, rows, correlation)),
        batches={offset.name: _six_digits(offset.share * sigma) for offset in given.offsets},
        resolution=_six_digits(first.resolution) if _is_rounding(noise, rows, first) else None,
    )


def _correlated_share(given: Observations, noise: Noise, rows: IntArray, likeliest: Correlation) -> float:
    """Of the variance of these data what is correlated along their order, in the mean of all laws that is used: where
    white is the likeliest, others may have most of it."""
    if given.offsets:
        # Beside them what is slow takes the place of a part of a datum's own: the variance is no more with it.
        return likeliest.ratio / (1.0 + likeliest.ratio)
    white = noise.sigma**2
    variance = white.copy()
    for where, factor in noise.factors[len(given.factors) :]:
        variance[where] *= variances(factor)
    return 1.0 - float(np.sum(white[rows]) / np.sum(variance[rows]))


def _is_rounding(noise: Noise, rows: IntArray, pool: NoisePool) -> bool:
    """Whether the scatter of these data is no larger than what their resolution leaves."""
    white = float(np.sqrt(np.mean(noise.sigma[rows] ** 2)))
    return pool.dof <= 0.0 and noise.least > 0.0 and white <= pool.least_sigma * (1.0 + _SAME)


def _six_digits(value: float) -> float:
    """To six digits: beyond, fits from different starts differ."""
    return float(f"{value:.6g}")


def _source(pool: NoisePool) -> str:
    if pool.dof > 0.0:
        return "samples"
    return "stated" if pool.stated else "scatter"
