"""Effects of the sensing-axis experiment, in SI, in the order in which they act (signs as in docs/physics.md).

With theta0 the stage angle of the null and d = theta - theta0, the sensing axis stands at (-sin d, cos d) in the
horizontal plane, x along the motion; the gain holds the cosine of its elevation. S is the amplitude at the drive's
frequency w in phase with the displacement, A the displacement's amplitude, k the gain.
"""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import effect
from rigctl.experiments.sensing_axis.model.chain import Runs

LUCENTE = "Lucente et al. 2022 (Planetary and Space Science 211)"


@effect(
    "encoder-eccentricity",
    on="angle_rad",
    parameters={"e1": "rad", "e2": "rad"},
    typical={"e1": 1e-5, "e2": 1e-5},
    source="first harmonic of an off-centre ring scale; plausible 1e-6 to 1e-4 rad",
)
def encoder_eccentricity(run: Runs, e1: FloatArray, e2: FloatArray) -> FloatArray:
    """The rotation scale is off its centre: the true angle differs with the angle, by e1 cos and e2 sin of it."""
    return e1 * np.cos(run.theta) + e2 * np.sin(run.theta)


@effect(
    "cable-hysteresis",
    on="angle_rad",
    parameters={"h": "rad"},
    typical={"h": 1e-5},
    source="torque of a cable on the turntable; plausible 1e-6 to 1e-4 rad",
    needs=("approach",),
)
def cable_hysteresis(run: Runs, h: FloatArray) -> FloatArray:
    """The cable drags the turntable: the true angle depends on the direction in which it was reached."""
    return h * run.approach


@effect(
    "yaw",
    on="angle_rad",
    parameters={"psi1": "rad/m"},
    typical={"psi1": 1e-4},
    source=f"{LUCENTE}: guide specification, +-0.5 arcsec over the travel; plausible 1e-5 to 1e-3 rad/m",
)
def yaw(run: Runs, psi1: FloatArray) -> FloatArray:
    """The guide yaws with the position and turns sensor and cube: 2 nu and DC, k psi1 A^2 w^2 cos(d) / 2."""
    return psi1 * run.x


@effect(
    "null-drift",
    on="null_rad",
    parameters={"rate": "rad/s"},
    typical={"rate": 1e-9},
    source="creep of the sensor in its seat, the cube left where it is; plausible 1e-11 to 1e-7 rad/s",
    scope="axis",
    needs=("time",),
)
def null_drift(run: Runs, rate: FloatArray) -> FloatArray:
    """The sensor creeps in its seat: theta0 changes with time, the cube's angle does not."""
    return rate * run.later


@effect(
    "roll-gravity",
    on="specific_force_m_s2",
    parameters={"rho1": "rad/m"},
    typical={"rho1": 1e-4},
    source=f"{LUCENTE}, eq. 5; plausible 1e-5 to 1e-3 rad/m",
)
def roll_gravity(run: Runs, rho1: FloatArray) -> FloatArray:
    """Guide twist tilts the sensor sideways: gravity enters, whatever the frequency; S gains k g rho1 A cos(d)."""
    return rho1 * run.x * run.g * np.cos(run.theta - run.theta0)


@effect(
    "pitch-gravity",
    on="specific_force_m_s2",
    parameters={"pi1": "rad/m"},
    typical={"pi1": 1e-4},
    source="right-handed turn pi1 x about +y, as eq. 5 for roll; plausible 1e-5 to 1e-3 rad/m",
)
def pitch_gravity(run: Runs, pi1: FloatArray) -> FloatArray:
    """Guide bow tilts the sensor along the motion: S gains k g pi1 A sin(d), whatever the frequency."""
    return pi1 * run.x * run.g * np.sin(run.theta - run.theta0)


@effect(
    "bench-recoil",
    on="specific_force_m_s2",
    parameters={"c": "rad s2/m"},
    typical={"c": 1e-6},
    source="roll c A w^2 of a bench on unequal feet under the stage's reaction; plausible 1e-8 to 1e-5 rad s2/m",
)
def bench_recoil(run: Runs, c: FloatArray) -> FloatArray:
    """The stage's reaction rolls the bench: S gains k g c A w^2 cos(d), in one mounting a shift of theta0."""
    # a = -w^2 x: in phase with the displacement, like a shift of the null.
    return -c * run.a * run.g * np.cos(run.theta - run.theta0)


@effect(
    "yaw-lever",
    on="specific_force_m_s2",
    parameters={"lever_cos": "1", "lever_sin": "1"},
    typical={"lever_cos": 1e-5, "lever_sin": 1e-5},
    source="guide yaw psi1 times the sensor's distance from the stage's axis; plausible 1e-6 to 1e-4",
)
def yaw_lever(run: Runs, lever_cos: FloatArray, lever_sin: FloatArray) -> FloatArray:
    """Guide yaw moves a sensor off the stage's axis: S gains k A w^2 (lever_cos cos d + lever_sin sin d)."""
    angle = run.theta - run.theta0
    # As the inertial term: a = -w^2 x.
    return -run.a * (lever_cos * np.cos(angle) + lever_sin * np.sin(angle))


@effect(
    "quadratic",
    on="specific_force_m_s2",
    parameters={"K2": "s2/m"},
    typical={"K2": 1e-2},
    source="second-order coefficient of the sensor's response (IEEE 1293); plausible 1e-4 to 1 s2/m",
    scope="axis",
)
def quadratic(run: Runs, K2: FloatArray) -> FloatArray:
    """The sensor responds to the square of the varying force too: 2 nu and DC, as the square of S."""
    # Of the force with what acted before: roll, pitch, recoil and lever are squared with it.
    return K2 * np.square(run.signal)


@effect(
    "axis-tilt",
    on="specific_force_m_s2",
    parameters={"eps_cos": "rad", "eps_sin": "rad"},
    typical={"eps_cos": 1e-4, "eps_sin": 1e-4},
    source="gravity across a rotation axis that leans; plausible 1e-6 to 1e-2 rad",
)
def axis_tilt(run: Runs, eps_cos: FloatArray, eps_sin: FloatArray) -> FloatArray:
    """The rotation axis is not vertical: DC gains k g (eps_cos cos d + eps_sin sin d)."""
    angle = run.theta - run.theta0
    return run.g * (eps_cos * np.cos(angle) + eps_sin * np.sin(angle))


@effect(
    "resonance",
    on="sensor_output_v",
    parameters={"inv_w0_squared": "s2", "damping": "s"},
    typical={"inv_w0_squared": 2e-3, "damping": 4.5e-3},
    source=f"{LUCENTE}, eq. 1, normalised to unit gain at DC; plausible w0 2 pi 1 to 100 Hz, Q 1 to 1000",
    scope="axis-configuration",
    never_negative=("inv_w0_squared", "damping"),
)
def resonance(run: Runs, inv_w0_squared: FloatArray, damping: FloatArray) -> FloatArray:
    """The proof mass is a damped spring: response grows towards its resonance and lags."""
    # What is added to the signal, not what becomes of it.
    return run.filtered(lambda s: 1.0 / (1.0 + s**2 * inv_w0_squared + s * damping)) - run.signal


@effect(
    "thermal-gain",
    on="sensor_output_v",
    parameters={"kT": "1/K"},
    typical={"kT": 1e-4},
    source="temperature coefficient of transducer and electronics; plausible 1e-6 to 1e-2 1/K",
    scope="axis",
    needs=("temperature",),
)
def thermal_gain(run: Runs, kT: FloatArray) -> FloatArray:
    """The gain drifts with temperature: the output, static level and all, is multiplied by 1 + kT (T - T0)."""
    return run.signal * kT * run.warmer


@effect(
    "gain-drift",
    on="sensor_output_v",
    parameters={"rate": "1/s"},
    typical={"rate": 1e-8},
    source="ageing of transducer and electronics; plausible 1e-10 to 1e-6 1/s",
    scope="axis",
    needs=("time",),
)
def gain_drift(run: Runs, rate: FloatArray) -> FloatArray:
    """The gain changes with time: the output, static level and all, grows at a relative rate."""
    return run.signal * rate * run.later


@effect(
    "thermal-bias",
    on="sensor_output_v",
    parameters={"bT": "V/K"},
    typical={"bT": 1e-3},
    source="temperature coefficient of the zero; plausible 1e-5 to 1e-1 V/K",
    scope="axis",
    needs=("temperature",),
)
def thermal_bias(run: Runs, bT: FloatArray) -> FloatArray:
    """The bias drifts with temperature: DC gains bT (T - T0)."""
    return bT * run.warmer


@effect(
    "bias-drift",
    on="sensor_output_v",
    parameters={"rate": "V/s"},
    typical={"rate": 1e-7},
    source="ageing and creep of the zero; plausible 1e-10 to 1e-4 V/s",
    scope="axis",
    needs=("time",),
)
def bias_drift(run: Runs, rate: FloatArray) -> FloatArray:
    """The bias changes with time, at a steady rate."""
    return rate * run.later


@effect(
    "time-skew",
    on="sensor_output_v",
    parameters={"tau": "s"},
    typical={"tau": 1e-3},
    source="latency between trigger and conversion; accel_v(t) = V(t - tau); plausible 1e-6 to 1e-2 s",
)
def time_skew(run: Runs, tau: FloatArray) -> FloatArray:
    """The accelerometer's clock runs behind the encoder's and the lasers': phase -w tau, gain unchanged."""
    return run.filtered(lambda s: np.exp(-s * tau)) - run.signal


@effect(
    "mains-pickup",
    on="sensor_output_v",
    parameters={"amplitude": "V", "frequency": "Hz"},
    typical={"amplitude": 1e-3, "frequency": 50.0},
    source="electrical pick-up, seen directly or aliased; plausible 1e-6 to 1e-1 V",
    scanned=True,
)
def mains_pickup(run: Runs, amplitude: FloatArray, frequency: FloatArray) -> FloatArray:
    """A steady electrical line at no harmonic of the drive: the same amplitude in every run, the phase free."""
    # In time of the recording, not of the run: a steady line goes on between runs.
    phase = 2.0 * np.pi * frequency * (run.start + run.t)
    return amplitude * np.sin(phase)


@effect(
    "laser-cosine",
    on="laser_m",
    parameters={"dt": "rad"},
    typical={"dt": 1e-3},
    source="beam tilt of one head other than the rig file says; plausible 1e-5 to 1e-2 rad",
    scope="head",
)
def laser_cosine(run: Runs, dt: FloatArray) -> FloatArray:
    """A beam is tilted by t + dt, not by t: the reading is the motion along the face's normal over their cosine."""
    # The reading was worked out with the stated tilt; c . n with the true one takes its place.
    stated = np.cos(run.tilt) * run.along + np.sin(run.tilt) * run.across
    true = np.cos(run.tilt + dt) * run.along + np.sin(run.tilt + dt) * run.across
    return np.asarray(run.signal * (stated / true - 1.0))


@effect(
    "laser-nonlinearity",
    on="laser_m",
    parameters={"q": "1/m"},
    typical={"q": 1e-2},
    source="curve of triangulation, r to r + q r^2; plausible 1e-4 to 1 1/m",
    scope="head",
)
def laser_nonlinearity(run: Runs, q: FloatArray) -> FloatArray:
    """Triangulation is not quite linear: one head reads q r^2 too much, 2 nu as A^2."""
    return q * np.square(run.signal)


@effect(
    "laser-crosstalk",
    on="laser_m",
    parameters={"chi": "1"},
    typical={"chi": 1e-4},
    source="cube faces or heads that are not orthogonal; plausible 1e-6 to 1e-2",
    scope="head",
)
def laser_crosstalk(run: Runs, chi: FloatArray) -> FloatArray:
    """The side head sees a fraction chi of the main motion: in one mounting like a rotation of the cube."""
    return np.asarray(chi * run.x * run.side)
