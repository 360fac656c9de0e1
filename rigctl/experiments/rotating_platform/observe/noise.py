"""The noise of an accelerometer chain: white, and a power law at low frequencies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray

Density = Callable[[FloatArray], FloatArray]
"""A noise spectrum: density over positive frequency [Hz]. Where it is used `sided` says if one-sided or two-sided."""


@dataclass(frozen=True)
class PowerLawNoise:
    """S(f) = `white` + `coefficient` / f^`exponent`, a `Density` [unit^2/Hz].

    The form of Lenoir, Christophe, Reynaud, Measurement 46 (2013) 1411, eq. 1.
    """

    white: float
    coefficient: float
    exponent: float

    def __call__(self, frequency_hz: FloatArray) -> FloatArray:
        """The density at positive frequencies."""
        return np.asarray(self.white + self.coefficient * np.power(frequency_hz, -self.exponent))

    def in_units_of(self, unit: float) -> PowerLawNoise:
        """The noise of the signal divided by `unit`: of the output over the scale factor, for an acceleration."""
        return PowerLawNoise(self.white / unit**2, self.coefficient / unit**2, self.exponent)


def pendulum_rise(frequency_hz: FloatArray) -> FloatArray:
    """The density of a pendulum's noise over its floor: the amplitude rises as f^2 above 0.2 Hz, to a hundred."""
    return np.asarray(np.clip(np.asarray(frequency_hz) / PENDULUM_CORNER_HZ, 1.0, 10.0) ** 4)


PENDULUM_CORNER_HZ = 0.2

Q_FLEX_NOISE_V = PowerLawNoise(3.1925e-5, 9.052e-8, 1.6384)
"""Noise of a Q-Flex chain at its output [V^2/Hz], eq. 1 of the paper. It is two-sided: only so does it give the
theoretical precision of table 4, with pattern c of one minute."""
