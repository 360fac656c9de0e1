"""What an integrating converter gives: the mean of a signal over its aperture."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.wiring import Signal

SHORT_S = 1e-3
"""An aperture whose mean is the value in its middle: of a sine of 10 Hz less by 2e-4."""

NODES = 5
"""Of Gauss and Legendre, for the mean over a longer one."""


def mean_over_aperture(signal: Signal, middle_s: FloatArray, lasts_s: float) -> FloatArray:
    """The mean of `signal` over `lasts_s` about each instant."""
    if lasts_s <= SHORT_S:
        return np.asarray(signal(middle_s), dtype=np.float64)
    places, weights = np.polynomial.legendre.leggauss(NODES)
    values = np.asarray(signal(np.add.outer(middle_s, 0.5 * lasts_s * places).ravel()), dtype=np.float64)
    return np.asarray(values.reshape(-1, NODES) @ (0.5 * weights))
