"""Effects of an in-flight calibration, in SI, in the order in which they act.

What acts alike on both masses does not show: their difference is compared. A parameter with `_d` is half of mass 1
less mass 2, one with `_c` the mean of both. T is the gravity gradient, n the orbit's angular frequency, Delta the way
from mass 1 to mass 2. Sizes are those plausible for the instrument of Hardy et al. (arXiv 1707.07630).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import Effect, effect
from rigctl.experiments.inflight.model.gradient import attitude_error, flattening, precession

if TYPE_CHECKING:
    from rigctl.experiments.inflight.model.flight import FlightRun

LIGHT_M_S, EARTH_ORBIT_M_S = 299792458.0, 29780.0

OF_EACH: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "thermal-off-centring": ("axis", ("beta_y", "beta_z")),
    "thermal-bias": ("sensor", ("lambda_c",)),
    "thermal-gain": ("sensor", ("kappa_c", "level_c")),
    "cross-quadratic": ("mass", ("k_xy_c",)),
}
"""Effects with a coefficient of each axis, sensor or mass: of what, and the parameters that it takes besides. They
are asked about without these first, and with them where the data ask for it."""

OF_THE_ORBIT = ("magnetic", "gravity-j2", "orbit-precession", "tracker-aberration")
"""Effects with lines of the orbit of their own, as a satellite that keeps its pointing sees them. In a session of the
test these lie elsewhere, or where a violation does in sessions of calibration the same."""

Value = FloatArray | float


def _without_lines(
    name: str,
    summary: str,
    *,
    on: str,
    sizes: Mapping[str, tuple[str, float]],
    source: str,
) -> Effect:
    """An effect that changes no line: searched for in the samples, measured as noise, or common to both masses.

    `sizes` has each parameter's unit and typical size.
    """

    def unchanged(run: FlightRun, **parameters: FloatArray) -> FloatArray:
        del parameters
        return np.zeros_like(run.signal)

    unchanged.__doc__ = summary
    units = {name: unit for name, (unit, _) in sizes.items()}
    typical = {name: size for name, (_, size) in sizes.items()}
    return effect(name, on=on, parameters=units, typical=typical, source=source, scanned=True)(unchanged)


@effect(
    "tracker-bias",
    on="gradient_1_s2",
    parameters={"s_x": "rad", "s_y": "rad", "s_z": "rad"},
    typical={"s_x": 1e-4, "s_y": 1e-4, "s_z": 1e-4},
    source="star tracker's alignment, 1e-4 rad; plausible 1e-5 to 1e-3 rad",
)
def tracker_bias(run: FlightRun, s_x: FloatArray, s_y: FloatArray, s_z: FloatArray) -> FloatArray:
    """The star tracker is misaligned by s: T is turned the other way; a_c12, a_c13, Dx, Dz absorb it."""
    return attitude_error(run.gradient, s_x, s_y, s_z)


@effect(
    "tracker-aberration",
    on="gradient_1_s2",
    parameters={"orbital": "1", "annual": "1"},
    typical={"orbital": 1.0, "annual": 1.0},
    source="v/c of satellite (2.5e-5 rad) and Earth (1e-4 rad), 1 where it is not corrected",
)
def tracker_aberration(run: FlightRun, orbital: FloatArray, annual: FloatArray) -> FloatArray:
    """Aberration of starlight left in: an attitude error at f_orb, and a constant one about Y."""
    cosine, sine = np.cos(run.orbital * run.t), np.sin(run.orbital * run.t)
    # The semi-major axis, 7097 km: v/c of the satellite.
    speed = 7.1e6 * run.orbital / LIGHT_M_S
    constant = EARTH_ORBIT_M_S / LIGHT_M_S
    return attitude_error(
        run.gradient, 0.0 * cosine, annual * constant + orbital * speed * cosine, orbital * speed * sine
    )


@effect(
    "orbit-dating",
    on="gradient_1_s2",
    parameters={"delay": "s"},
    typical={"delay": 1.0},
    source="time tags of orbit and accelerations; plausible 0.01 to 10 s",
)
def orbit_dating(run: FlightRun, delay: FloatArray) -> FloatArray:
    """The orbit is dated wrongly: T is that of a later time, Dx goes into Dz and back."""
    return np.asarray(delay * np.gradient(run.gradient, run.t, axis=2))


@effect(
    "orbit-precession",
    on="gradient_1_s2",
    parameters={"perigee_rate": "rad/s", "eccentricity_rate": "1/s"},
    typical={"perigee_rate": 2e-7, "eccentricity_rate": 1e-10},
    source="motion of perigee, 1 degree a day; plausible 1e-8 to 1e-5 rad/s",
)
def orbit_precession(run: FlightRun, perigee_rate: FloatArray, eccentricity_rate: FloatArray) -> FloatArray:
    """Perigee and eccentricity move during a session: the phase of 2 f_orb drifts, the line at f_orb grows."""
    return precession(run.gradient, run.orbital, run.t, perigee_rate, eccentricity_rate)


@effect(
    "gravity-j2",
    on="gradient_1_s2",
    parameters={"j_xx": "1", "j_zz": "1", "j_yy": "1", "j_xz": "1", "j_xy": "1", "j_yz": "1"},
    typical={"j_xx": 1e-3, "j_zz": 1e-3, "j_yy": 1e-3, "j_xz": 1e-3, "j_xy": 1e-3, "j_yz": 1e-3},
    source="J2 = 1.083e-3, times the products of the components of the Earth's pole",
)
def gravity_j2(
    run: FlightRun,
    j_xx: FloatArray,
    j_zz: FloatArray,
    j_yy: FloatArray,
    j_xz: FloatArray,
    j_xy: FloatArray,
    j_yz: FloatArray,
) -> FloatArray:
    """The Earth is flat at its poles: T differs by J2 (R/a)^2; j_kl is J2 times the pole's components k and l."""
    products = np.array([[j_xx, j_xy, j_xz], [j_xy, j_yy, j_yz], [j_xz, j_yz, j_zz]], dtype=np.float64)
    return flattening(run.orbital, run.t, products)


@effect(
    "thermal-off-centring",
    on="off_centring_m",
    parameters={"beta": "m/K", "beta_y": "m/K", "beta_z": "m/K"},
    typical={"beta": 1e-7, "beta_y": 1e-7, "beta_z": 1e-7},
    source="expansion of the electrodes' holder; plausible 1e-8 to 1e-5 m/K",
    needs=("temperature",),
)
def thermal_off_centring(run: FlightRun, beta: Value, beta_y: Value = 0.0, beta_z: Value = 0.0) -> FloatArray:
    """The masses' centres move apart with the temperature: Txx times it, at f_orb and 3 f_orb."""
    return np.asarray(np.multiply.outer(np.array([beta, beta_y, beta_z]), run.warmer.mean(axis=0)))


@effect(
    "wire-stiffness",
    on="mass_force_m_s2",
    parameters={"stiffness_1": "1/s2", "stiffness_2": "1/s2", "loss_1": "1/s2", "loss_2": "1/s2"},
    typical={"stiffness_1": 2.5e-3, "stiffness_2": 7e-4, "loss_1": 2.5e-5, "loss_2": 7e-6},
    source="wire and electrodes as a spring kappa/m, loss kappa/(m Q); kappa 1e-4 to 1e-2 N/m, Q 50 to 1000",
)
def wire_stiffness(
    run: FlightRun, stiffness_1: FloatArray, stiffness_2: FloatArray, loss_1: FloatArray, loss_2: FloatArray
) -> FloatArray:
    """A spring with loss holds a moved mass: its own channel gains kappa/m x, and a quadrature."""
    made = np.zeros_like(run.signal)
    if run.stimulus > 0.0:
        for mass, (stiffness, loss) in enumerate(((stiffness_1, loss_1), (stiffness_2, loss_2))):
            made[mass] = stiffness * run.moved[mass] + loss / run.stimulus * run.moved_speed[mass]
    return made


@effect(
    "cubic-stiffness",
    on="mass_force_m_s2",
    parameters={"cubic_1": "1/(m2 s2)", "cubic_2": "1/(m2 s2)"},
    typical={"cubic_1": 3e5, "cubic_2": 1e5},
    source="a hundredth of the linear stiffness over the motion",
)
def cubic_stiffness(run: FlightRun, cubic_1: FloatArray, cubic_2: FloatArray) -> FloatArray:
    """The spring stiffens with the cube of the motion: a line at three times the stimulus."""
    return np.stack([cubic_1 * run.moved[0] ** 3, cubic_2 * run.moved[1] ** 3])


@effect(
    "charge",
    on="mass_force_m_s2",
    parameters={"charging_d": "m/s3"},
    typical={"charging_d": 1e-16},
    source="bad contact of the grounding wire, q < 1e-12 C; plausible 1e-18 to 1e-15 m/s3",
)
def charge(run: FlightRun, charging_d: FloatArray) -> FloatArray:
    """A mass charges up in its field: the difference of the forces drifts steadily."""
    return run.along_x(charging_d * run.t, -charging_d * run.t)


@effect(
    "magnetic",
    on="mass_force_m_s2",
    parameters={"once_cos_d": "m/s2", "once_sin_d": "m/s2", "twice_cos_d": "m/s2", "twice_sin_d": "m/s2"},
    typical={"once_cos_d": 1e-14, "once_sin_d": 1e-14, "twice_cos_d": 1e-14, "twice_sin_d": 1e-14},
    source="remanent moment in the field's gradient (f_orb), susceptibility in its square's (2 f_orb); to 1e-13",
)
def magnetic(
    run: FlightRun, once_cos_d: FloatArray, once_sin_d: FloatArray, twice_cos_d: FloatArray, twice_sin_d: FloatArray
) -> FloatArray:
    """The Earth's field pulls at the masses: lines at f_orb and, like the gradient's, at 2 f_orb."""
    angle = run.orbital * run.t
    force = once_cos_d * np.cos(angle) + once_sin_d * np.sin(angle)
    force = force + twice_cos_d * np.cos(2.0 * angle) + twice_sin_d * np.sin(2.0 * angle)
    return run.along_x(force, -force)


spring_noise = _without_lines(
    "spring-noise",
    "Thermal noise of a spring with loss: noise that grows to low frequencies; it is measured in each run.",
    on="mass_force_m_s2",
    sizes={"kappa_over_q": ("N/m", 1e-5)},
    source="4 kB T kappa/(m^2 Q w): 2e-11 m/s2/rtHz at 0.34 mHz for 1e-3 N/m, Q 100, 0.4 kg",
)

thrust_quantisation = _without_lines(
    "thrust-quantisation",
    "Thrust comes in steps: it moves both masses alike, and shows in the common channel only.",
    on="mass_force_m_s2",
    sizes={"step": ("m/s2", 1e-10)},
    source="smallest step of the thrusters, 0.1 uN",
)

mass_drift = _without_lines(
    "mass-drift",
    "The satellite's centre of mass drifts: it moves both masses alike, and shows in the common channel only.",
    on="mass_force_m_s2",
    sizes={"rate": ("m/s", 4e-11)},
    source="gas that is used up, 0.1 mm a month",
)

moved_mass_reaction = _without_lines(
    "moved-mass-reaction",
    "The satellite recoils from a moved mass: it moves both masses alike, and shows in the common channel only.",
    on="mass_force_m_s2",
    sizes={"mass_ratio": ("1", 6e-3)},
    source="1.7 kg of 300 kg",
)


@effect(
    "thermal-bias",
    on="measured_m_s2",
    parameters={"lambda_d": "m/(s2 K)", "lambda_c": "m/(s2 K)"},
    typical={"lambda_d": 2e-9, "lambda_c": 2e-9},
    source="4e-9 m/s2/K of a sensor, 7e-11 of its electronics",
    needs=("temperature",),
)
def thermal_bias(run: FlightRun, lambda_d: Value, lambda_c: Value = 0.0) -> FloatArray:
    """The sensors' bias goes with their temperature: a line at f_orb, and at 2 f_orb one that Dx and Dz take up."""
    return run.along_x((lambda_c + lambda_d) * run.warmer[0], (lambda_c - lambda_d) * run.warmer[1])


@effect(
    "thermal-gain",
    on="measured_m_s2",
    parameters={"kappa_d": "1/K", "level_d": "m/(s2 K)", "kappa_c": "1/K", "level_c": "m/(s2 K)"},
    typical={"kappa_d": 1e-4, "level_d": 1e-12, "kappa_c": 1e-4, "level_c": 1e-12},
    source="1e-6 to 1e-4 /K; `level` takes off the sensor's bias, which the gain leaves alone",
    needs=("temperature",),
)
def thermal_gain(
    run: FlightRun, kappa_d: Value, level_d: Value, kappa_c: Value = 0.0, level_c: Value = 0.0
) -> FloatArray:
    """The sensors' gain goes with their temperature: sidebands of the stimulus, f_orb away."""
    # Levels count: where one mass is held they differ from those of other sessions.
    output = run.measured[:, 0]
    return run.along_x(
        ((kappa_c + kappa_d) * output[0] + (level_c + level_d)) * run.warmer[0],
        ((kappa_c - kappa_d) * output[1] + (level_c - level_d)) * run.warmer[1],
    )


@effect(
    "sensor-skew",
    on="measured_m_s2",
    parameters={"delay": "s"},
    typical={"delay": 1e-2},
    source="sampling of the two sensors, 10 ms",
)
def sensor_skew(run: FlightRun, delay: FloatArray) -> FloatArray:
    """The two sensors are sampled one after the other: half the delay times the rate of the common acceleration."""
    rate = 0.5 * delay * np.gradient(run.common, run.t, axis=1)
    return np.stack([rate, -rate])


@effect(
    "cubic-electrode",
    on="measured_m_s2",
    parameters={"k3_1": "s4/m2", "k3_2": "s4/m2"},
    typical={"k3_1": 4e8, "k3_2": 4e8},
    source="K3 C^2 of 1e-6",
)
def cubic_electrode(run: FlightRun, k3_1: FloatArray, k3_2: FloatArray) -> FloatArray:
    """The sensors' output has a cubic part: a line at three times the stimulus, and a share of a'_d11."""
    # Outputs count from where control holds them, their mean at zero: in sessions k2c, where it holds one of them,
    # both sensors work elsewhere on the curve.
    levels = run.measured[:, 0].mean(axis=1, keepdims=True)
    away = run.measured[:, 0] - (levels - levels.mean())
    return run.along_x(k3_1 * away[0] ** 3, k3_2 * away[1] ** 3)


@effect(
    "cross-quadratic",
    on="measured_m_s2",
    parameters={"k_xy_d": "s2/m", "k_xy_c": "s2/m"},
    typical={"k_xy_d": 100.0, "k_xy_c": 100.0},
    source="100 s2/m",
)
def cross_quadratic(run: FlightRun, k_xy_d: Value, k_xy_c: Value = 0.0) -> FloatArray:
    """Acceleration along Y changes the gain along X: with what is constant along X, a part of a_d12."""
    product = run.measured[:, 0] * run.measured[:, 1]
    return run.along_x((k_xy_c + k_xy_d) * product[0], (k_xy_c - k_xy_d) * product[1])


@effect(
    "bias-drift",
    on="measured_m_s2",
    parameters={"rate_d": "m/s3", "curvature_d": "m/s4"},
    typical={"rate_d": 1e-16, "curvature_d": 1e-21},
    source="1e-13 to 1e-12 m/s2 an orbit",
)
def bias_drift(run: FlightRun, rate_d: FloatArray, curvature_d: FloatArray) -> FloatArray:
    """The sensors' bias drifts during a session, and its rate too."""
    drift = rate_d * run.t + curvature_d * run.t**2
    return run.along_x(drift, -drift)


glitches = _without_lines(
    "glitches",
    "Short pulses in both sensors: they are found in the samples, and what they cover is left out.",
    on="measured_m_s2",
    sizes={"amplitude": ("m/s2", 1e-9)},
    source="crackling of the satellite's walls, e^(-t/3 s) - e^(-t/1 s), 1e-10 to 1e-8 m/s2, 1 to 30 an orbit",
)

noise_level = _without_lines(
    "noise-level",
    "The noise is louder at times: it is measured in each run, and found by comparing stretches.",
    on="measured_m_s2",
    sizes={"change": ("1", 0.5)},
    source="a factor of 2",
)

steady_line = _without_lines(
    "steady-line",
    "A line between those of orbit and stimulus, whatever its source: it is found in the samples.",
    on="measured_m_s2",
    sizes={"amplitude": ("m/s2", 1e-13), "frequency": ("Hz", 1e-2)},
    source="clanks of tanks and wheels, thermal cycles of heaters",
)
