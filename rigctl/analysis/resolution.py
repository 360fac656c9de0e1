"""How finely a channel was recorded: the noise that no spectrum of its residuals need show."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.sine_fit import HarmonicBasis
from rigctl.core.arrays import FloatArray

_ENOUGH = 8
_FINEST = 1e4
"""A step of fewer float spacings is none that a channel counts in."""


def quantum(samples: FloatArray) -> float:
    """The step in which a channel counts, or that of floats of its size where it counts in none.

    Euclid's algorithm on the gaps between its values: no two need be one step apart. Of a handful of values the
    smallest gap. One that never changes may be anything finer than what it shows: the resolution of a float of its
    size, of 1 at least.
    """
    values = np.unique(samples)
    largest = float(np.abs(samples).max())
    spacing = float(np.spacing(largest))
    gaps = np.diff(values)
    gaps = gaps[gaps > _FINEST * spacing]
    if not gaps.size:
        return spacing if values.size > 1 else float(np.spacing(max(largest, 1.0)))
    if gaps.size < _ENOUGH:  # of so few any step could be made
        return float(gaps.min())
    step, unsure = float(gaps.min()), 4.0 * spacing
    while step > _FINEST * spacing:
        counts = np.rint(gaps / step)
        left, zero = np.abs(gaps - counts * step), counts * unsure + 4.0 * spacing
        if zero.max() > 0.25 * step:  # anything would be whole
            break
        more = np.flatnonzero(left > zero)
        if not more.size:
            return step
        least = more[np.argmin(left[more])]
        step, unsure = float(left[least]), float(zero[least])
    return spacing


def amplitude_floor(samples: FloatArray, residuals: FloatArray, basis: HarmonicBasis) -> FloatArray:
    """Least variance of the mean and of each part of the harmonics, shape (harmonics + 1,), from the quantisation.

    A step q that noise smooths has the variance q^2 / 12 in every sample. Without noise it repeats from period to
    period, and with its sign reversed from half to half: no more than half a period's samples are independent. What
    is left however many there are is the quantiser's own response to a sine, whose harmonics go as Bessel functions
    J(2 pi A / q): (2 q / pi)^2 q / (2 pi^2 A) in the mean square.
    """
    step = quantum(samples)
    # Noise of half a step dithers: the error of counting is then white, uniform over a step.
    if residuals.std() >= 0.5 * step:
        mean = step**2 / 12.0 / basis.samples
        return np.array([mean, *[2.0 * mean] * basis.harmonics])
    half_period = 0.5 / (basis.frequency_hz * basis.sample_period_s)
    mean = step**2 / 12.0 / min(float(basis.samples), max(1.0, half_period))
    amplitude = max(float(np.sqrt(2.0) * (samples - residuals).std()), 0.25 * step)
    response = (2.0 * step / np.pi) ** 2 * step / (2.0 * np.pi**2 * amplitude)
    return np.array([mean + 0.5 * response, *[2.0 * mean + response] * basis.harmonics])
