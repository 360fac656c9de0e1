"""From motion to volts and millimetres: the chain on which the baseline and every effect act.

All runs of a recording are predicted at once on a grid over one period of the drive: arrays have the shape
(runs, grid points), conditions (runs, 1). The motion is the encoder's, its harmonics included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray, TextArray
from rigctl.core.errors import ConfigError

GRID_POINTS = 32
"""Points per period: harmonics up to the 15th are free of aliasing, far beyond what the physics makes."""


@dataclass(frozen=True)
class Origins:
    """Where drifts count from: the recording's means, whatever part of it is looked at later."""

    temperature_c: float
    middle_s: float


@dataclass
class Runs:
    """What an effect may ask of the runs it acts on, in SI; `signal` is the value at its point of the chain so far.

    t, x, v, a have the shape (runs, grid points), conditions (runs, 1), NaN where unknown. `start` and `middle` are
    times of the recording at the beginning and in the middle of a run; `warmer` and `later` are temperature and
    `middle` counted from the recording's means. `along` and `across` are the components of the normal of the face
    that `head` looks at on the head's own direction and on the one its beam is tilted towards by `tilt`; `side` is 1
    where the head stands across the motion.
    """

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
    middle: FloatArray
    axis: TextArray
    configuration: TextArray
    origins: Origins
    columns: Mapping[str, FloatArray] = field(default_factory=dict)
    signal: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    head: str = ""
    along: FloatArray = field(default_factory=lambda: np.ones((1, 1)))
    across: FloatArray = field(default_factory=lambda: np.zeros((1, 1)))
    tilt: float = 0.0
    side: FloatArray = field(default_factory=lambda: np.zeros((1, 1)))

    @property
    def warmer(self) -> FloatArray:
        """Temperature above the recording's mean [K]."""
        return self.temperature - self.origins.temperature_c

    @property
    def later(self) -> FloatArray:
        """Time since the recording's mean time [s]."""
        return self.middle - self.origins.middle_s

    def column(self, name: str) -> FloatArray:
        """A laboratory's own column of runs.csv, (runs, 1); `ConfigError` when the recording has none."""
        if name not in self.columns:
            known = ", ".join(sorted(self.columns)) or "none"
            raise ConfigError(f"no column '{name}' of numbers in runs.csv; columns beyond the format's own: {known}")
        return self.columns[name]

    def filtered(self, transfer: Callable[[ComplexArray], ComplexArray]) -> FloatArray:
        """`signal` after a linear filter in its steady state; `transfer` takes s = i w [rad/s]."""
        return _filtered(self.signal, self.omega, transfer)

    def moved(self, added: FloatArray) -> Runs:
        """The same runs with the motion changed by `added` [m], velocity and acceleration with it."""
        # Differentiated in its Fourier series: exact on the grid.
        v = _filtered(added, self.omega, lambda s: s)
        a = _filtered(added, self.omega, lambda s: s**2)
        return self.at(x=self.x + added, v=self.v + v, a=self.a + a)

    def repeated(self, times: int) -> Runs:
        """The same runs so many times, one copy after the other."""
        arrays = {name: each for name, each in self.__dict__.items() if isinstance(each, np.ndarray)}
        return self.at(
            columns={name: np.tile(each, (times, 1)) for name, each in self.columns.items()},
            **{name: np.tile(each, (times, 1)) for name, each in arrays.items() if len(each) == len(self.omega)},
        )

    def at(self, **changes: Any) -> Runs:
        """The same runs at another point of the chain."""
        # Many thousand times in a fit, and dataclasses.replace costs more than the physics.
        other = object.__new__(Runs)
        other.__dict__.update(self.__dict__, **changes)
        return other


def _filtered(signal: FloatArray, omega: FloatArray, transfer: Callable[[ComplexArray], ComplexArray]) -> FloatArray:
    spectrum = np.fft.rfft(signal, axis=-1)
    s = np.asarray(1j * omega * np.arange(spectrum.shape[-1]), dtype=np.complex128)
    return np.fft.irfft(spectrum * transfer(s), n=signal.shape[-1], axis=-1)


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
    # The grid is one of phase: runs of any frequency share it.
    return phase[None, :] / omega, x, v, a


def amplitudes(signal: FloatArray, count: int) -> ComplexArray:
    """Amplitudes c_0 .. c_count of periodic signals on the grid, (runs, count + 1), referred to the displacement as
    `sine_fit.referred_to` does: signal = c_0 + Re sum_h (-i)^h c_h exp(i h w t), for x = A sin(w t)."""
    # A product with a few waves takes a tenth to a fifth of the time of a transform with all of them.
    return np.asarray(signal @ _waves(signal.shape[-1], count)).view(np.complex128)


@cache
def _waves(points: int, count: int) -> FloatArray:
    """What a period is multiplied by, (points, 2 (count + 1)): for each amplitude its real and its imaginary part."""
    order = np.arange(count + 1)
    waves = np.exp(-2j * np.pi * np.outer(np.arange(points), order) / points) / points
    # A real signal has half of each amplitude at the negative frequency.
    waves[:, 1:] *= 2.0
    # A sine is the cosine a quarter period late: -i at the drive, (-i)^h at harmonic h.
    return np.asarray(np.ascontiguousarray(waves * 1j**order).view(np.float64))
