"""A channel that was sampled on a clock of its own, put on the rig's time axis by the drive's sine.

The channel's times t' and the rig's times t are related by t = t' + offset + rate (t' - m), m the middle of the
channel's record. The rate is where the channel has its sine; the offset is what makes the sine in phase with the
displacement, or opposite to it. A phase of the fundamental that the channel has by itself cannot be told from that:
its quadrature says nothing any more.

The offset is known before within a standard uncertainty, as are the rates of quartz clocks: a channel that hardly
sees the drive keeps to these, one that sees it well is hardly held by them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.frequency import frequency_gradient
from rigctl.analysis.sine_fit import HarmonicBasis, HarmonicFit
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.core.errors import DataError

RATE_U = 1e-4
"""Standard uncertainty of a quartz clock's rate: they are made to within some 100 ppm."""

SURELY = 3.0
"""Standard uncertainties within which an offset is."""

_STEPS = 4


@dataclass(frozen=True)
class ClockFit:
    """Offset and rate of a channel's clock with their standard uncertainties."""

    offset_s: float
    offset_u_s: float
    rate: float
    rate_u: float


@dataclass(frozen=True)
class AlignedFit:
    """The sine fit of a channel on its own times, and its amplitudes (harmonics 1, 2, ...) referred and aligned."""

    basis: HarmonicBasis
    fit: HarmonicFit
    amplitudes: ComplexArray
    clock: ClockFit


def sign_is_known(frequency_hz: float, clock_u_s: float | None) -> bool:
    """False where times are known so badly that half a period more cannot be told from the other sign."""
    return clock_u_s is None or SURELY * clock_u_s <= 0.25 / frequency_hz


def fit_on_own_clock(
    t_s: FloatArray,
    values: FloatArray,
    frequency_hz: float,
    reference: complex,
    harmonics: int,
    clock_u_s: float | None = None,
) -> AlignedFit:
    """Fit `values`, taken at the times `t_s` of their own clock, to a drive of `frequency_hz` in the rig's time.

    `reference` is the displacement's amplitude in the rig's time. `clock_u_s` is the standard uncertainty of `t_s`
    on the rig's time axis; where it is not known the offset is the smallest one. Raises `DataError` when the record
    cannot be fitted, or its times are not known to a quarter of a period.
    """
    if not sign_is_known(frequency_hz, clock_u_s):
        raise DataError(
            f"times known to {clock_u_s:g} s only tell no sign at {frequency_hz:g} Hz; drive it more slowly"
        )
    basis, fit, rate, rate_u = _rate_of(t_s, values, frequency_hz, harmonics)
    w = 2.0 * math.pi * frequency_hz
    # From t' about its own zero to t' about the middle of its record.
    order = np.arange(1, harmonics + 1)
    late = fit.amplitudes_referred_to(reference) * np.exp(1j * w * rate * basis.time_s * order)
    offset_s, offset_u_s = _offset(complex(late[0]), w, _amplitude_u(basis, fit), clock_u_s)
    aligned = late * np.exp(-1j * w * offset_s * order)
    return AlignedFit(basis, fit, aligned, ClockFit(offset_s, offset_u_s, rate, rate_u))


def _rate_of(
    t_s: FloatArray, values: FloatArray, frequency_hz: float, harmonics: int
) -> tuple[HarmonicBasis, HarmonicFit, float, float]:
    """Gauss-Newton in the rate, with its prior; the amplitudes follow at every step."""
    rate, rate_u = 0.0, RATE_U
    for step in range(_STEPS + 1):
        basis = HarmonicBasis(t_s, frequency_hz * (1.0 + rate), harmonics)
        fit = basis.fit(values)
        if step == _STEPS:
            break
        slope = frequency_hz * frequency_gradient(basis, fit)
        variance = float(fit.residuals @ fit.residuals) / max(basis.samples - 2 * harmonics - 3, 1)
        # The prior in units of the noise; a record without noise has only what arithmetic leaves.
        held = max(variance, np.finfo(float).tiny) / RATE_U**2
        stiffness = float(slope @ slope) + held
        rate += (float(slope @ fit.residuals) - held * rate) / stiffness
        rate_u = math.sqrt(variance / stiffness) if variance > 0.0 else 0.0
    return basis, fit, rate, rate_u


def _amplitude_u(basis: HarmonicBasis, fit: HarmonicFit) -> float:
    """Standard uncertainty of a part of the fundamental's amplitude, were the noise white."""
    return math.sqrt(2.0 * float(fit.residuals @ fit.residuals)) / basis.samples


def _offset(fundamental: complex, w: float, amplitude_u: float, clock_u_s: float | None) -> tuple[float, float]:
    """The offset, and its standard uncertainty, for an amplitude `fundamental` whose phase ought to be 0 or pi."""
    phase_rad = math.remainder(math.atan2(fundamental.imag, fundamental.real), math.pi)
    if amplitude_u == 0.0 and abs(fundamental) > 0.0:
        return phase_rad / w, 0.0
    seen = (w * abs(fundamental) / amplitude_u) ** 2 if amplitude_u > 0.0 else 0.0
    # Nothing known before: anywhere within a quarter of a period to either side.
    before = (1.0 / (clock_u_s if clock_u_s else math.pi / w / math.sqrt(12.0))) ** 2
    if clock_u_s is None:
        return phase_rad / w, 1.0 / math.sqrt(seen + before)
    return seen / (seen + before) * phase_rad / w, 1.0 / math.sqrt(seen + before)
