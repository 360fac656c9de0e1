"""A second world of the sensing-axis rig, from the rig's description alone: what the instruments read, without noise.

Frames, signs and the order in which effects act are those of the rig's page; the rest is this file's own: rotations
are products of exact matrices, the sensor is integrated in time (Runge-Kutta), and an effect acts on the samples,
never on an amplitude. SI and radians; one row of every array is one run, one column one sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

G_M_S2 = 9.803
BEAM_TILT_RAD = np.radians(5.0)
SETTLING_S = 15.0
X_L, Y_L, Z_L = np.eye(3)

AXES = "XYZ"
NOMINAL = {
    "pendulum": np.column_stack([Y_L, Z_L, X_L]),
    "flag": np.column_stack([Y_L, X_L, -Z_L]),
}
"""Where the cube's directions i, j, k (i the measured axis) go on the turntable, as columns."""
HEADS_FACE = {"pendulum": ("k", "i", "j"), "flag": ("j", "i", "-k")}
"""The faces that the heads at +x, +y and +z look at."""


@dataclass(frozen=True)
class Design:
    """What was set in each run; ``mounting`` numbers from 1, ``flag`` tells the configuration."""

    axis: str
    flag: NDArray[np.bool_]
    mounting: NDArray[np.int_]
    theta_rad: Floats
    approach: Floats
    frequency_hz: Floats
    amplitude_m: Floats
    temperature_c: Floats
    humidity_percent: Floats
    start_s: Floats
    lasers: NDArray[np.bool_]
    duration_s: float
    rate_hz: float

    @property
    def runs(self) -> int:
        return len(self.theta_rad)

    @property
    def time_s(self) -> Floats:
        return np.arange(round(self.duration_s * self.rate_hz)) / self.rate_hz


@dataclass(frozen=True)
class Bench:
    """What this bench is: the sensing axis, its mountings, gains and levels; and what acts on it (``effects``)."""

    axis_ijk: Floats
    delta_rad: Floats
    gain: Mapping[bool, float]
    level_v: Floats
    phase_rad: Floats
    effects: Mapping[str, float] = field(default_factory=dict)

    def acts(self, parameter: str) -> float:
        return self.effects.get(parameter, 0.0)

    def with_effects(self, effects: Mapping[str, float]) -> Bench:
        return replace(self, effects=effects)


@dataclass(frozen=True)
class Readings:
    """Samples of all runs: encoder and lasers in m, the sensor in V."""

    stage_m: Floats
    accel_v: Floats
    laser_m: Floats


def turned(theta_rad: Floats) -> Floats:
    """Rz of every angle, as matrices behind the angles' own shape."""
    flat = Rotation.from_rotvec(np.outer(theta_rad, Z_L)).as_matrix()
    return np.asarray(flat.reshape((*np.shape(theta_rad), 3, 3)))


def cyclic(axis: str) -> list[int]:
    """The cube's axes i, j, k with i the measured one."""
    first = AXES.index(axis)
    return [(first + step) % 3 for step in range(3)]


def true_angle_rad(design: Design, bench: Bench) -> Floats:
    """Where the stage really stands: eccentricity of its scale, and the cable's pull."""
    theta = design.theta_rad
    scale = bench.acts("e1") * np.cos(theta) + bench.acts("e2") * np.sin(theta)
    return np.asarray(theta + scale + bench.acts("h") * design.approach)


def seat(design: Design, bench: Bench) -> Floats:
    """R(delta) M of every run: from (i, j, k) of the cube to the turntable."""
    nominal = np.where(design.flag[:, None, None], NOMINAL["flag"], NOMINAL["pendulum"])
    delta = Rotation.from_rotvec(bench.delta_rad[design.mounting - 1]).as_matrix()
    return np.asarray(delta @ nominal)


def since_mean(values: Floats) -> Floats:
    return np.asarray(values - values.mean())


def motion(design: Design, bench: Bench, time_s: Floats) -> tuple[Floats, Floats]:
    """The stage's position and acceleration at the times given: a sine with a little third harmonic."""
    w = 2.0 * np.pi * design.frequency_hz[:, None]
    phase = w * time_s + bench.phase_rad[:, None]
    amplitude = design.amplitude_m[:, None]
    position = amplitude * (np.sin(phase) + 3e-4 * np.sin(3.0 * phase))
    acceleration = -amplitude * w**2 * (np.sin(phase) + 27e-4 * np.sin(3.0 * phase))
    return position, acceleration


def varying_force(design: Design, bench: Bench, time_s: Floats) -> Floats:
    """The part of s . f that changes with the motion, in m/s2: inertia and what the guide's rotations make of g."""
    x, acceleration = motion(design, bench, time_s)
    null_shift = bench.acts("null_rate") * since_mean(design.start_s)
    s = turned(true_angle_rad(design, bench) - null_shift) @ seat(design, bench) @ bench.axis_ijk
    roll, pitch, yaw = bench.acts("rho1") * x, bench.acts("pi1") * x, bench.acts("psi1") * x
    sx, sy, sz = (s[:, number, None] for number in range(3))
    along = sx * np.cos(yaw) - sy * np.sin(yaw)
    upwards = sy * np.sin(roll) - sx * np.sin(pitch) + sz * (np.cos(roll) * np.cos(pitch) - 1.0)
    return np.asarray(along * acceleration + G_M_S2 * upwards)


def distorted(bench: Bench, force: Floats) -> Floats:
    """The sensor's own curve: K2 (in the catalogue), K3 (in none)."""
    return np.asarray(force + bench.acts("K2") * force**2 + bench.acts("K3") * force**3)


def through_sensor(design: Design, bench: Bench, time_s: Floats) -> Floats:
    """The force as the proof mass follows it: y'' = w0^2 (f - y) - (w0/Q) y', integrated from rest long before."""
    if not any(name.startswith("inv_w0_squared") for name in bench.effects):
        return distorted(bench, varying_force(design, bench, time_s))
    inverse = np.where(design.flag, bench.acts("inv_w0_squared[flag]"), bench.acts("inv_w0_squared[pendulum]"))
    damping = np.where(design.flag, bench.acts("damping[flag]"), bench.acts("damping[pendulum]"))
    per_sample = max(1, int(np.ceil(160.0 / design.rate_hz)))
    step = 1.0 / (design.rate_hz * per_sample)
    before = round(SETTLING_S / step)
    half_steps = (np.arange(2 * (before + len(time_s) * per_sample) + 1) / 2.0 - before) * step + time_s[0]
    force = distorted(bench, varying_force(design, bench, half_steps))

    def slope(state: Floats, f: Floats) -> Floats:
        return np.array([state[1], (f - state[0] - damping * state[1]) / inverse])

    state = np.array([force[:, 0], np.zeros(design.runs)])
    followed = np.empty((design.runs, len(time_s)))
    for number in range(before + len(time_s) * per_sample):
        past = number - before
        if past >= 0 and past % per_sample == 0:
            followed[:, past // per_sample] = state[0]
        f0, f1, f2 = (force[:, 2 * number + part] for part in range(3))
        k1 = slope(state, f0)
        k2 = slope(state + 0.5 * step * k1, f1)
        k3 = slope(state + 0.5 * step * k2, f1)
        state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(state + step * k3, f2))
    return followed


def sensor_v(design: Design, bench: Bench) -> Floats:
    """accel_v: varying force, gain and its drifts, static level, bias and its drifts, clock, a line."""
    warm, late = since_mean(design.temperature_c), since_mean(design.start_s)
    moist = since_mean(design.humidity_percent)
    gain = np.where(design.flag, bench.gain[True], bench.gain[False])
    gain = gain * (
        1.0 + bench.acts("kT") * warm + bench.acts("gain_rate") * late + bench.acts("gain_per_percent") * moist
    )
    upright = (seat(design, bench) @ bench.axis_ijk)[:, 2]
    theta = true_angle_rad(design, bench)
    leaning = bench.acts("eps_cos") * np.cos(theta) + bench.acts("eps_sin") * np.sin(theta)
    bias = bench.level_v[design.mounting - 1] + bench.acts("bT") * warm + bench.acts("bias_rate") * late
    shown = through_sensor(design, bench, design.time_s - bench.acts("tau"))
    read = gain[:, None] * (shown + G_M_S2 * (upright + leaning)[:, None]) + bias[:, None]
    return np.asarray(read + line_v(design, bench))


def line_v(design: Design, bench: Bench) -> Floats:
    """A steady electrical line: one amplitude, one frequency, a phase of its own in every run."""
    phase = 2.0 * np.pi * ((np.arange(design.runs) * 0.618034) % 1.0)
    angle = 2.0 * np.pi * bench.acts("line_hz") * design.time_s + phase[:, None]
    return np.asarray(bench.acts("line_v") * np.sin(angle))


def lasers_m(design: Design, bench: Bench) -> Floats:
    """What the heads at +x, +y, +z read (heads first): (d . n) / (c . n), and each head's curve."""
    x, _ = motion(design, bench, design.time_s)
    orientation = turned(true_angle_rad(design, bench)[:, None] + bench.acts("psi1") * x)
    faces = seat(design, bench)
    read = []
    for head in range(3):
        normal = orientation @ (faces @ face_normals(design, head)[:, :, None])[:, None]
        tilt = BEAM_TILT_RAD + bench.acts(f"dt[{head + 1}]")
        outward, sideways = ((X_L, Z_L), (Y_L, Z_L), (Z_L, X_L))[head]
        beam = np.cos(tilt) * outward + np.sin(tilt) * sideways
        r = x * normal[..., 0, 0] / (normal[..., 0] @ beam)
        read.append(r + bench.acts(f"q[{head + 1}]") * r**2)
    return np.array(read)


def face_normals(design: Design, head: int) -> Floats:
    """The outward normal of the face the head looks at, in (i, j, k), for every run."""
    found = []
    for flag in design.flag:
        face = HEADS_FACE["flag" if flag else "pendulum"][head]
        found.append((-1.0 if face[0] == "-" else 1.0) * np.eye(3)["ijk".index(face[-1])])
    return np.array(found)


def readings(design: Design, bench: Bench) -> Readings:
    """All that the instruments read, without noise."""
    stage, _ = motion(design, bench, design.time_s)
    return Readings(stage, sensor_v(design, bench), lasers_m(design, bench))
