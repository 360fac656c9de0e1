"""The sine that a drive makes of every column of a run, fitted; the waves are worked out once for all columns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray

HARMONICS = 5
SMALLEST = 24
"""Fewer samples than this are not looked at."""
PUREST = 1e-5
"""Part of a sine below which nothing is said: no drive, guide or converter is purer."""
DECIMALS = 10
"""More decimals than instruments have."""
ROUNDED = 1e-12
"""Of a column's largest value: what arithmetic leaves."""
MAD_TO_SIGMA = 1.4826


class Sine:
    """The drive of a run, sampled at these times, as far as all its columns share it.

    `waves`: offset, drift, and cosine and sine of each harmonic, shape (2 + 2 orders, samples).
    """

    def __init__(self, times_s: FloatArray, frequency_hz: float) -> None:
        self.frequency_hz = frequency_hz
        self.period_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else math.inf
        # Harmonics up to a little below half the sampling rate, where a wave and its alias are one.
        orders = min(HARMONICS, int(0.45 / (frequency_hz * self.period_s)))
        self.waves = _waves(times_s, frequency_hz, orders) if orders else np.empty((0, len(times_s)))

    @cached_property
    def products(self) -> FloatArray:
        """Those of the waves with each other, over all samples."""
        return self.waves @ self.waves.T

    def fit(self, values: FloatArray, used: BoolArray, waves: int) -> FloatArray:
        """The coefficients of the first so many waves, from the samples used."""
        # Without gaps all columns share one matrix of products.
        if used.all():
            basis, products = self.waves[:waves], self.products[:waves, :waves]
        else:
            basis, values = self.waves[:waves, used], values[used]
            products = basis @ basis.T
        return np.linalg.solve(products, basis @ values).astype(np.float64, copy=False)


def _waves(times_s: FloatArray, frequency_hz: float, orders: int) -> FloatArray:
    turning = np.exp(2j * math.pi * frequency_hz * times_s)
    waves = np.empty((2 + 2 * orders, len(times_s)))
    waves[0], waves[1] = 1.0, (times_s - times_s.mean()) / np.ptp(times_s)
    harmonic = np.ones_like(turning)
    for order in range(1, orders + 1):
        # Powers of one rotation instead of a cosine and a sine for every harmonic.
        harmonic = harmonic * turning
        waves[2 * order], waves[2 * order + 1] = harmonic.real, harmonic.imag
    return waves


@dataclass(frozen=True)
class Course:
    """The sine of a column: amplitude, phase of a cosine at time 0 [rad], what its harmonics and a drift leave.

    `purest`: less than this no instrument tells.
    """

    amplitude: float
    phase_rad: float
    residual: FloatArray
    purest: float


@dataclass(frozen=True)
class Column:
    """The samples of a channel, what is known of them worked out when it is asked for."""

    channel: str
    sine: Sine
    values: FloatArray

    @cached_property
    def known(self) -> BoolArray:
        """Where there is a value."""
        return np.isfinite(self.values)

    @cached_property
    def rounded(self) -> float:
        """What arithmetic leaves."""
        return ROUNDED * float(np.abs(self.values[self.known]).max(initial=0.0))

    @cached_property
    def resolution(self) -> float:
        """The last digit."""
        return resolution_of(self.values, self.rounded)

    @cached_property
    def course(self) -> Course | None:
        """Its course, fitted without samples that stand out; None where too few have a value."""
        waves, known = len(self.sine.waves), self.known
        # Three samples for every coefficient, or the residual is no measure of noise.
        if not waves or known.sum() < max(SMALLEST, 3 * waves):
            return None
        used = known
        # Outliers pull the first fit; what stands out is left out, until nothing changes.
        for _ in range(4):
            coefficients = self.sine.fit(self.values, used, waves)
            residual = self.values - coefficients @ self.sine.waves
            distance = np.abs(residual)
            # Eight sigma by the median: nothing of Gaussian noise, and most of a wrong sample.
            near = known & (distance <= 8.0 * MAD_TO_SIGMA * median_of(distance[known]))
            # More than a tenth are no outliers: then the sine is not what the column does.
            if (near == used).all() or near.sum() < 0.9 * known.sum():
                break
            used = near
        cosine, sine = (float(each) for each in coefficients[2:4])
        amplitude = math.hypot(cosine, sine)
        # a cos wt + b sin wt = A cos(wt + phase).
        return Course(amplitude, math.atan2(-sine, cosine), residual, max(PUREST * amplitude, self.rounded))


def resolution_of(values: FloatArray, least: float) -> float:
    """The last decimal digit of a column, or the smallest difference of two values, `least` at least; 0 for none."""
    known = values[np.isfinite(values)]
    for decimals in range(DECIMALS):
        if (np.abs(known - np.round(known, decimals)) <= least).all():
            return 10.0**-decimals
    steps = np.diff(np.unique(known))
    steps = steps[steps > least]
    return float(steps.min()) if len(steps) else 0.0


def median_of(values: FloatArray) -> float:
    """Of values that are not NaN; numpy's own looks for those at length."""
    low, high = (len(values) - 1) // 2, len(values) // 2
    # Both middle places at once; sorting all of it is not needed.
    ordered = np.partition(values, (low, high))
    return 0.5 * float(ordered[low] + ordered[high])
