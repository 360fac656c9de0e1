"""Effects of the rotating platform, in SI, in the order in which they act, one amplitude per channel.

With theta the platform's angle, sensor A reads m_z = A_Z cos(theta) - A_Y sin(theta) + b_z, sensor B m_y = A_Y
cos(theta) + A_Z sin(theta) + b_y; below s = cos(theta), and m is what the effect is added to.
"""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import effect
from rigctl.experiments.rotating_platform.model.chain import PlatformRuns

LENOIR = "Lenoir, Christophe, Reynaud 2013 (Measurement 46, 1411)"
# Five to a decade: what lies between is looked for afterwards.
RECOVERIES_S = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0, 16.0, 25.0, 40.0, 63.0, 100.0)
DELAYS_S = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0)
CUTOFFS_HZ = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 20.0, 50.0, 100.0)
# Lunisolar day, the Moon's half day, half a solar day, a quarter of the Moon's day (K1, M2, S2, M4).
TIDES_S = (86164.0, 44714.0, 43200.0, 22357.0)


@effect(
    "platform-repeatability",
    on="platform_angle_rad",
    parameters={"stop": "rad", "backlash": "rad"},
    typical={"stop": 2e-5, "backlash": 2e-5},
    source=f"{LENOIR}: stops repeat to 0.0003 deg; plausible 5e-6 to 1e-4 rad",
)
def platform_repeatability(run: PlatformRuns, stop: FloatArray, backlash: FloatArray) -> FloatArray:
    """The stops are not half a turn apart, and depend on the direction: d a_Y enters m_z, d a_Z enters m_y."""
    # Nil at the first stop and the whole of it at half a turn.
    return 0.5 * (stop * (1.0 - run.cos) + backlash * run.direction)


@effect(
    "cross-axis",
    on="force_m_s2",
    parameters={"k": "1"},
    typical={"k": 1e-3},
    source=f"{LENOIR}, eq. 6: its axes are 2.5 deg from a right angle; plausible 1e-4 to 5e-2",
    scope="channel",
)
def cross_axis(run: PlatformRuns, k: FloatArray) -> FloatArray:
    """The axes are not at a right angle: m_z gains k (a_Y cos + a_Z sin), m_y gains k (a_Z cos - a_Y sin)."""
    return k * run.across


@effect(
    "off-centre",
    on="force_m_s2",
    parameters={"r_cos": "m", "r_sin": "m"},
    typical={"r_cos": 1e-2, "r_sin": 1e-2},
    source="sensor off the rotation axis by r at the angle psi; plausible 1 to 100 mm",
    scope="channel",
)
def off_centre(run: PlatformRuns, r_cos: FloatArray, r_sin: FloatArray) -> FloatArray:
    """Samples count while the platform moves: m gains -(r_cos w^2 + r_sin dw/dt), in step with the turns."""
    return -(r_cos * run.speed_squared + r_sin * run.turning)


@effect(
    "clock-skew",
    on="force_m_s2",
    parameters={"r_cos": "m", "r_sin": "m", "delay": "s"},
    typical={"r_cos": 1e-2, "r_sin": 1e-2, "delay": 0.2},
    source="platform's clock behind that of the samples; plausible 0.01 to 1 s, with r of 1 to 100 mm",
    scope="channel",
    scans={"delay": DELAYS_S},
)
def clock_skew(run: PlatformRuns, r_cos: FloatArray, r_sin: FloatArray, delay: float) -> FloatArray:
    """The motion is later than its mask: what is left of -(r_cos w^2 + r_sin dw/dt), and of tilts, counts as rest."""
    left = run.late(delay)
    return left.tilts - (r_cos * left.speed_squared + r_sin * left.turning)


@effect(
    "filter-ringing",
    on="force_m_s2",
    parameters={"r_cos": "m", "r_sin": "m", "cutoff": "Hz"},
    typical={"r_cos": 1e-2, "r_sin": 1e-2, "cutoff": 5.0},
    source="elliptic anti-alias filter, order 8, 0.1 dB, 80 dB; plausible at half the sampling rate, r 1 to 100 mm",
    scope="channel",
    scans={"cutoff": CUTOFFS_HZ},
)
def filter_ringing(run: PlatformRuns, r_cos: FloatArray, r_sin: FloatArray, cutoff: float) -> FloatArray:
    """The anti-alias filter rings after a turn: -(r_cos w^2 + r_sin dw/dt), and tilts, behind an elliptic filter."""
    left = run.ringing(cutoff)
    return left.tilts - (r_cos * left.speed_squared + r_sin * left.turning)


@effect(
    "theta-locked-bias",
    on="force_m_s2",
    parameters={"e1": "m/s2", "e2": "m/s2"},
    typical={"e1": 1e-6, "e2": 1e-6},
    source="magnetic field, axis tilt between the stops, cable torque; plausible 1e-7 to 1e-5 m/s2",
    scope="channel",
)
def theta_locked_bias(run: PlatformRuns, e1: FloatArray, e2: FloatArray) -> FloatArray:
    """A bias that turns with the platform: e1 cos(theta) counts as acceleration in every pattern."""
    return e1 * run.cos + e2 * run.sin


@effect(
    "pendulum-reaction",
    on="force_m_s2",
    parameters={"d": "rad"},
    typical={"d": 1e-8},
    source="the pendulum leans with the mass that is turned; plausible 1e-9 to 1e-6 rad",
    scope="channel",
)
def pendulum_reaction(run: PlatformRuns, d: FloatArray) -> FloatArray:
    """The pendulum tilts under the moved mass: g d cos(theta), like a theta-locked bias."""
    return run.g * d * run.cos


@effect(
    "tide",
    on="force_m_s2",
    parameters={"a_sin": "m/s2", "a_cos": "m/s2", "period": "s"},
    typical={"a_sin": 1e-6, "a_cos": 1e-6, "period": 44714.0},
    source="tilt of the ground, semidiurnal or diurnal; plausible 1e-7 to 1e-5 m/s2",
    scope="channel",
    needs=("time",),
    scans={"period": TIDES_S},
)
def tide(run: PlatformRuns, a_sin: FloatArray, a_cos: FloatArray, period: float) -> FloatArray:
    """A real, slow tilt: (a_sin sin(2 pi t / T) + a_cos cos(2 pi t / T)) cos(theta), in the acceleration alone."""
    phase = 2.0 * np.pi * run.t / period
    # Real acceleration: it turns with the frame, as a bias does not.
    return np.asarray((a_sin * np.sin(phase) + a_cos * np.cos(phase)) * run.cos)


@effect(
    "gain-drift",
    on="force_m_s2",
    parameters={"k1": "1/s"},
    typical={"k1": 3e-8},
    source="ageing of the scale factor; plausible 1e-5 to 1e-3 per hour",
    scope="channel",
    needs=("time",),
)
def gain_drift(run: PlatformRuns, k1: FloatArray) -> FloatArray:
    """The scale factor changes with time: what is felt is multiplied by 1 + k1 t."""
    return run.signal * k1 * run.t


@effect(
    "recovery",
    on="force_m_s2",
    parameters={"e": "m/s2", "t_r": "s"},
    typical={"e": 1e-6, "t_r": 10.0},
    source="settling after every turn, same sign each time; plausible 1e-7 to 1e-4 m/s2, 5 to 60 s",
    scope="channel",
    scans={"t_r": RECOVERIES_S},
)
def recovery(run: PlatformRuns, e: FloatArray, t_r: float) -> FloatArray:
    """The sensor recovers after every turn: e exp(-t / t_r) goes to the bias, as 1/tau."""
    return e * run.decay(t_r)


@effect(
    "recovery-signed",
    on="force_m_s2",
    parameters={"e": "m/s2", "t_r": "s"},
    typical={"e": 1e-6, "t_r": 10.0},
    source="settling with the sign of the turn: thermal asymmetry, anelastic cable; plausible 1e-7 to 1e-4 m/s2",
    scope="channel",
    scans={"t_r": RECOVERIES_S},
)
def recovery_signed(run: PlatformRuns, e: FloatArray, t_r: float) -> FloatArray:
    """The sensor recovers with the sign of the turn: d e exp(-t / t_r) goes to the mean acceleration, as 1/tau."""
    return e * run.direction * run.decay(t_r)


@effect(
    "thermal-bias",
    on="reading_m_s2",
    parameters={"b1": "m/s2/K", "b2": "m/s2/K2", "b3": "m/s2/K3"},
    typical={"b1": 1e-5, "b2": 1e-5, "b3": 1e-5},
    source="temperature coefficient of the zero; plausible 1e-7 to 1e-4 m/s2 per K",
    scope="channel",
    needs=("temperature",),
)
def thermal_bias(run: PlatformRuns, b1: FloatArray, b2: FloatArray, b3: FloatArray) -> FloatArray:
    """The bias follows the temperature: b1 (T - 22 degC) + b2 (T - 22 degC)^2 + b3 (T - 22 degC)^3."""
    return run.warmer * (b1 + run.warmer * (b2 + run.warmer * b3))


@effect(
    "quadratic",
    on="reading_m_s2",
    parameters={"K2": "s2/m"},
    typical={"K2": 3e-5},
    source="second-order coefficient of the sensor (IEEE 1293); plausible 1e-6 to 10 s2/m",
    scope="channel",
)
def quadratic(run: PlatformRuns, K2: FloatArray) -> FloatArray:
    """The reading has a square in it: 2 K2 a b enters the mean acceleration, K2 (a^2 + b^2) the bias."""
    return K2 * np.square(run.signal)


@effect(
    "gain-asymmetry",
    on="reading_m_s2",
    parameters={"e": "1"},
    typical={"e": 1e-4},
    source="scale factor that differs for the sign; plausible 1e-6 to 1e-2",
    scope="channel",
)
def gain_asymmetry(run: PlatformRuns, e: FloatArray) -> FloatArray:
    """The gain depends on the sign of the reading: m gains e abs(m), and the bias goes with the tilt."""
    return e * np.abs(run.signal)


@effect(
    "line",
    on="reading_m_s2",
    parameters={"amplitude": "m/s2", "frequency": "Hz"},
    typical={"amplitude": 1e-6, "frequency": 0.14},
    source="seismic or building line, seen directly or aliased; plausible 1e-8 to 1e-4 m/s2",
    scanned=True,
)
def line(run: PlatformRuns, amplitude: FloatArray, frequency: FloatArray) -> FloatArray:
    """A steady line in the samples, one frequency for all runs; it leaks as the transform of the pattern."""
    return np.asarray(amplitude * np.sin(2.0 * np.pi * frequency * run.t))
