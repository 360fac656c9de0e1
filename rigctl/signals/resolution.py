"""How finely a channel was recorded: the noise that no spectrum of its residuals need show."""

from __future__ import annotations

import numpy as np

from rigctl.interfaces import FloatArray
from rigctl.signals.sine_fit import HarmonicBasis

_NOISE_OF_FLOATS = 1e-12
# Differences of up to so many steps are whole numbers of them; of a continuous channel they are anything.
_FEW, _ENOUGH, _WHOLE = 64.0, 8, 0.02


def quantum(samples: FloatArray) -> float:
    """The step in which a channel counts, or that of floats of its size where it counts in none.

    One that never changes may be anything finer than what it shows: the resolution of a float of its size, of 1 at
    least.
    """
    steps = np.abs(np.diff(samples))
    largest = float(np.abs(samples).max())
    steps = steps[steps > _NOISE_OF_FLOATS * largest]
    if not steps.size:
        return float(np.spacing(max(largest, 1.0)))
    step = float(steps.min())
    few = steps[steps < _FEW * step] / step
    counted = few.size >= _ENOUGH and np.median(np.abs(few - np.rint(few))) < _WHOLE
    return step if counted else float(np.spacing(largest))


def amplitude_floor(samples: FloatArray, residuals: FloatArray, basis: HarmonicBasis) -> FloatArray:
    """Least variance of the mean and of each part of the harmonics, shape (harmonics + 1,), from the quantisation.

    A step q that noise smooths has the variance q^2 / 12 in every sample. Without noise it repeats from period to
    period, so that no more than one period's samples are independent.
    """
    step = quantum(samples)
    independent = float(basis.samples)
    if residuals.std() < 0.5 * step:
        independent = min(independent, max(1.0, 1.0 / (basis.frequency_hz * basis.sample_period_s)))
    mean = step**2 / 12.0 / independent
    return np.array([mean, *[2.0 * mean] * basis.harmonics])
