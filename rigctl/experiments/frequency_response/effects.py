"""Effects of the frequency response, in SI, in the order in which they act.

a is the acceleration along the sensing axis, A its amplitude, w the drive's angular frequency, S the complex
sensitivity. The baseline is flat: output = gain * a.
"""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.effects.catalogue import effect
from rigctl.experiments.frequency_response.chain import ShakenRuns

FORCE, OUTPUT = "shaken_force_m_s2", "shaken_output_v"


@effect(
    "guide-pitch",
    on=FORCE,
    parameters={"pi1": "rad/m"},
    typical={"pi1": 1e-4},
    source="gravity on a guide that bends; plausible 1e-5 to 1e-3 rad/m",
)
def guide_pitch(run: ShakenRuns, pi1: FloatArray) -> FloatArray:
    """The guide pitches with the position and lets gravity in: S changes by -g pi1 / w^2, most at low frequency."""
    return run.direction * run.g * pi1 * run.x


@effect(
    "direction-asymmetry",
    on=FORCE,
    parameters={"epsilon": "1"},
    typical={"epsilon": 1e-3},
    source="the sensor sits otherwise when it is turned round; plausible 1e-4 to 1e-2",
)
def direction_asymmetry(run: ShakenRuns, epsilon: FloatArray) -> FloatArray:
    """The sensitivity differs between the two directions of the sensing axis, by epsilon up and epsilon down."""
    return epsilon * run.direction * run.signal


@effect(
    "cubic",
    on=FORCE,
    parameters={"K3": "s4/m2"},
    typical={"K3": 1e-3},
    source="IEEE Std 1293, model equation; plausible 1e-5 to 1e-2 s4/m2",
)
def cubic(run: ShakenRuns, K3: FloatArray) -> FloatArray:
    """The response bends with the force, K3 a^3: S changes by 3/4 K3 A^2."""
    return K3 * run.signal**3


@effect(
    "time-skew",
    on=OUTPUT,
    parameters={"tau": "s"},
    typical={"tau": 1e-4},
    source="the recorders of output and displacement take an edge at different times; plausible 1e-6 to 1e-2 s",
)
def time_skew(run: ShakenRuns, tau: FloatArray) -> FloatArray:
    """The output is recorded late by tau: S is turned by exp(-i w tau), its magnitude stays."""
    return run.through(lambda s: np.exp(-s * tau)) - run.signal


@effect(
    "lag",
    on=OUTPUT,
    parameters={"tau": "s"},
    typical={"tau": 1e-3},
    source="a first-order low-pass, of electronics or of damping; plausible 1e-4 to 1e-1 s",
    never_negative=("tau",),
)
def lag(run: ShakenRuns, tau: FloatArray) -> FloatArray:
    """The output follows through a pole: S is divided by 1 + i w tau."""
    return run.through(lambda s: _over(1.0 + s * tau)) - run.signal


@effect(
    "resonance",
    on=OUTPUT,
    parameters={"inv_w0_squared": "s2", "damping": "s"},
    typical={"inv_w0_squared": 1e-5, "damping": 1e-3},
    source="the proof mass on its spring; inv_w0_squared = 1 / w0^2, damping = 1 / (w0 Q)",
    never_negative=("inv_w0_squared", "damping"),
)
def resonance(run: ShakenRuns, inv_w0_squared: FloatArray, damping: FloatArray) -> FloatArray:
    """The sensor resonates: S is divided by 1 - w^2 inv_w0_squared + i w damping."""
    return run.through(lambda s: _over(1.0 + s**2 * inv_w0_squared + s * damping)) - run.signal


def _over(divisor: ComplexArray) -> ComplexArray:
    return 1.0 / divisor


@effect(
    "thermal-gain",
    on=OUTPUT,
    parameters={"kT": "1/K"},
    typical={"kT": 1e-3},
    source="magnets, springs and resistors; plausible 1e-5 to 1e-2 1/K",
    needs=("temperature",),
)
def thermal_gain(run: ShakenRuns, kT: FloatArray) -> FloatArray:
    """The sensitivity changes with the temperature."""
    return kT * (run.temperature - run.temperature_0) * run.signal


@effect(
    "gain-drift",
    on=OUTPUT,
    parameters={"rate": "1/s"},
    typical={"rate": 1e-7},
    source="ageing and warming up; plausible 1e-9 to 1e-6 1/s",
    needs=("time",),
)
def gain_drift(run: ShakenRuns, rate: FloatArray) -> FloatArray:
    """The sensitivity changes with time."""
    return rate * (run.start - run.start_0) * run.signal
