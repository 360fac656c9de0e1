"""What a run of the sensing-axis rig says: a few amplitudes per channel with their noise.

Amplitudes are referred to the encoder's displacement (`rigctl.analysis.sine_fit.referred_to`): the real part of
harmonic h goes as x^h, the imaginary part leads it by a quarter period; index 0 is the mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rigctl.analysis.clock_fit import ClockFit
from rigctl.core.arrays import ComplexArray, FloatArray

HARMONICS = 3
"""Harmonics of the drive kept per channel."""


@dataclass(frozen=True)
class Amplitudes:
    """One channel of one run: values and standard uncertainties, shape (HARMONICS + 1,), SI.

    `sigma` is that of the in-phase and of the quadrature part each; `dof` are the degrees of freedom behind it, 0 for
    the mean, whose sigma is no more than a relative weight: its noise lies below 1/T. `lines` are the amplitudes of
    the lines that were fitted with the harmonics (NaN: not in this run), referred to the record's first sample.
    `clock` is what was fitted to a channel on a clock of its own, None of others: the quadrature of its fundamental
    is then used up.
    """

    value: ComplexArray
    sigma: FloatArray
    dof: FloatArray = field(default_factory=lambda: np.zeros(HARMONICS + 1))
    lines: ComplexArray = field(default_factory=lambda: np.zeros(0, dtype=np.complex128))
    clock: ClockFit | None = None


@dataclass(frozen=True)
class RunObservables:
    """One run, reduced.

    `motion_m` are the encoder's harmonics 1..H with x = Re sum X_h exp(i h w t), X_1 = -iA; `faces` the cube's faces
    the heads look at, where the recording says so; `extra` its further columns of numbers, NaN where empty.
    """

    run_id: str
    axis: str
    configuration: str
    mounting: int
    theta_rad: float
    approach: float
    frequency_hz: float
    temperature_c: float
    start_s: float
    duration_s: float
    motion_m: ComplexArray
    accel_v: Amplitudes
    lasers_m: dict[str, Amplitudes]
    faces: dict[str, str]
    extra: Mapping[str, float] = field(default_factory=dict)

    @property
    def place(self) -> tuple[str, str, int]:
        """Axis, configuration and number of its mounting."""
        return self.axis, self.configuration, self.mounting

    @property
    def amplitude_m(self) -> float:
        """Amplitude A of the stage's motion [m]."""
        return float(np.abs(self.motion_m[0]))

    @property
    def peak_acceleration_m_s2(self) -> float:
        """The drive's peak acceleration A w^2 [m/s2]."""
        return self.amplitude_m * (2.0 * np.pi * self.frequency_hz) ** 2


def heads_of(runs: Sequence[RunObservables]) -> tuple[str, ...]:
    """Names of all laser columns that appear in the runs, sorted."""
    return tuple(sorted({name for run in runs for name in run.lasers_m}))
