"""From motion to volts and millimetres: the chain on which the baseline and every effect act.

All runs of a recording are predicted at once on a grid over one period of the drive: arrays have the shape
(runs, grid points), conditions (runs, 1). The motion is the encoder's, its harmonics included.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

GRID_POINTS = 32
"""Points per period: harmonics up to the 15th are free of aliasing, far beyond what the physics makes."""


@dataclass
class Runs:
    """What an effect may ask of the runs it acts on, in SI; `signal` is the value at its point of the chain."""

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    theta: FloatArray
    theta0: FloatArray
    omega: FloatArray
    amplitude: FloatArray
    g: float
    temperature: FloatArray
    approach: FloatArray
    start: FloatArray
    signal: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    head: str = ""

    def filtered(self, transfer: Callable[[ComplexArray], ComplexArray]) -> FloatArray:
        """`signal` after a linear filter in its steady state; `transfer` takes s = i w [rad/s]."""
        spectrum = np.fft.rfft(self.signal, axis=-1)
        s = np.asarray(1j * self.omega * np.arange(spectrum.shape[-1]), dtype=np.complex128)
        return np.fft.irfft(spectrum * transfer(s), n=self.signal.shape[-1], axis=-1)


def periodic_motion(
    harmonics_m: ComplexArray, omega: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Time, position, velocity and acceleration over one period.

    `harmonics_m` has shape (runs, H): x = Re sum_h harmonics_m[h-1] exp(i h w t); each output (runs, GRID_POINTS).
    """
    phase = 2.0 * np.pi * np.arange(GRID_POINTS) / GRID_POINTS
    order = np.arange(1, harmonics_m.shape[1] + 1)
    waves = np.exp(1j * order[:, None] * phase[None, :])
    jw = 1j * omega * order
    x = (harmonics_m @ waves).real
    v = ((harmonics_m * jw) @ waves).real
    a = ((harmonics_m * jw**2) @ waves).real
    return phase[None, :] / omega, x, v, a


def harmonics(signal: FloatArray, count: int) -> ComplexArray:
    """Amplitudes c_0 .. c_count of periodic signals on the grid: signal = c_0 + Re sum_h c_h exp(i h w t)."""
    spectrum: ComplexArray = np.fft.rfft(signal, axis=-1)[..., : count + 1] / signal.shape[-1]
    spectrum[..., 1:] *= 2.0
    return spectrum


def referred(amplitudes: ComplexArray) -> ComplexArray:
    """Amplitudes on the grid, where x = A sin(w t), referred to the displacement as `signals.referred_to` does."""
    order = np.arange(amplitudes.shape[-1])
    return amplitudes * 1j**order
