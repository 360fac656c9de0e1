"""The satellite's loop as one would write it down first: one draw, one step after the other, matrices of numpy.

What the compiled loop is measured against, and tested against: the same physics from the same papers, in other words.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.forcing import Command
from simulators.worlds.satellite.instrument import Instrument
from simulators.worlds.satellite.settings import SatelliteSettings


def kepler(mean: float, e: float) -> tuple[float, float]:
    """True anomaly and a / r."""
    anomaly = mean
    for _ in range(50):
        anomaly = mean + e * math.sin(anomaly)
    true = 2.0 * math.atan2(
        math.sqrt(1.0 + e) * math.sin(anomaly / 2.0), math.sqrt(1.0 - e) * math.cos(anomaly / 2.0)
    )
    return true, 1.0 / (1.0 - e * math.cos(anomaly))


def rotation(angle: FloatArray) -> FloatArray:
    """From axes at rest to axes turned by `angle` about x, y, z, as half tangents (Cayley)."""
    x, y, z = 0.5 * angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.linalg.solve(np.eye(3) + cross, np.eye(3) - cross))


def gradient(mean: float, e: float, n: float, angle: FloatArray) -> FloatArray:
    """In axes turned by `angle`."""
    true, nearness = kepler(mean, e)
    rho = rotation(angle) @ np.array([math.cos(true), 0.0, math.sin(true)])
    return np.asarray((n * n * nearness**3) * (3.0 * np.outer(rho, rho) - np.eye(3)))


def cross_matrix(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@dataclass
class State:
    angle: FloatArray = field(default_factory=lambda: np.zeros(3))
    rate: FloatArray = field(default_factory=lambda: np.zeros(3))
    integral: FloatArray = field(default_factory=lambda: np.zeros(3))
    double: FloatArray = field(default_factory=lambda: np.zeros(3))
    lagged: FloatArray = field(default_factory=lambda: np.zeros(3))
    estimate: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    """Angle, rate and the accelerometers' bias, by row."""
    thrust: FloatArray = field(default_factory=lambda: np.zeros(6))

    def flat(self) -> FloatArray:
        parts = (self.angle, self.rate, self.integral, self.double, self.lagged, self.estimate.ravel(), self.thrust)
        return np.concatenate(parts)

    @classmethod
    def of(cls, flat: FloatArray) -> State:
        a, b, c, d, e, f, g = np.split(flat.copy(), [3, 6, 9, 12, 15, 24])
        return cls(a, b, c, d, e, f.reshape(3, 3), g)


class PlainSatellite:
    """One draw, without effects."""

    def __init__(self, settings: SatelliteSettings, instrument: Instrument, command: Command) -> None:
        self.settings, self.instrument, self.command = settings, instrument, command
        self.n = 2.0 * math.pi / settings.orbit_period_s
        axis = {"x": 0, "y": 1, "z": 2}[command.injection.axis]
        self.own = [rotation_k.T @ np.eye(3)[axis] for rotation_k in instrument.rotations]
        self.shares = {"masses": (-0.5, 0.5), "mass-1": (1.0, 0.0), "mass-2": (0.0, 1.0)}.get(
            command.injection.target, (0.0, 0.0)
        )
        self.axis = axis

    def external(self, mean: float) -> tuple[FloatArray, FloatArray]:
        drag = self.settings.drag
        c1, s1, c2, s2 = math.cos(mean), math.sin(mean), math.cos(2.0 * mean), math.sin(2.0 * mean)
        force = np.array(drag.force_m_s2) + np.array(drag.force_1_m_s2) * [c1, s1, s1]
        torque = np.array(drag.torque_rad_s2) + np.array(drag.torque_1_rad_s2) * [c1, s1, c1]
        return (
            force + np.array(drag.force_2_m_s2) * [s2, c2, c2],
            torque + np.array(drag.torque_2_rad_s2) * [s2, c2, s2],
        )

    def step(self, state: State, t_s: float, noise: FloatArray) -> FloatArray:
        """One sample: m_1, m_2, dw, attitude, command; `noise` (21,): sensors 6, dw 3, tracker 3, thrust 6."""
        settings, loops, injection = self.settings, self.settings.loops, self.command.injection
        dt = settings.sample_period_s
        force, torque = self.external(self.n * t_s)
        turning = torque + state.thrust[3:]
        state.rate = state.rate + turning * dt
        state.angle = state.angle + state.rate * dt
        spin = cross_matrix(state.rate)
        g = gradient(self.n * t_s, settings.eccentricity, self.n, state.angle) - spin @ spin - cross_matrix(turning)
        w = 2.0 * math.pi * injection.frequency_hz
        phase = w * t_s + injection.phase_rad
        signal, speed = injection.amplitude * math.cos(phase), -w * injection.amplitude * math.sin(phase)
        measured = []
        for k in range(2):
            one, share, own = self.instrument, self.shares[k], self.own[k]
            at = one.positions_m[k] + share * signal * own
            applied = (
                force
                + state.thrust[:3]
                - g @ at
                + 2.0 * spin @ (share * speed * own)
                - w**2 * share * signal * own
                + one.parasitic_m_s2[k]
            )
            matrix, coupling = one.matrices[k], one.couplings[k]
            measured.append(
                one.bias_m_s2[k]
                + matrix @ (applied - one.parasitic_m_s2[k])
                + coupling @ one.parasitic_m_s2[k]
                + one.quadratic_s2_m[k] * applied**2
                + noise[3 * k : 3 * k + 3]
            )
        wanted, turned = np.zeros(3), np.zeros(3)
        if injection.target == "drag-free":
            wanted[self.axis] = signal
        if injection.target == "attitude":
            turned[self.axis] = signal
        held = self.command.inputs[0] * measured[0] + self.command.inputs[1] * measured[1]
        state.integral = state.integral + (held - wanted) * dt
        state.double = state.double + state.integral * dt
        asked = loops.drag_free_rad_s * (state.integral + loops.integral_rad_s * state.double)
        state.lagged = state.lagged + dt / loops.thruster_lag_s * (asked - state.lagged)
        seen = turning + self.instrument.gyro_bias_rad_s2 + noise[6:9]
        star = state.angle + self.instrument.tracker_bias_rad - turned + noise[9:12]
        angle, rate, bias = state.estimate
        off, wo = star - angle, loops.hybrid_rad_s
        state.estimate = np.stack(
            [
                angle + dt * (rate + 3.0 * wo * off),
                rate + dt * (seen - bias + 3.0 * wo**2 * off),
                bias - dt * wo**3 * off,
            ]
        )
        kp = loops.attitude_rad_s**2
        kd = loops.attitude_damping * loops.attitude_rad_s
        asked_6 = np.concatenate([-state.lagged, -(kp * state.estimate[0] + kd * state.estimate[1])])
        state.thrust = self.instrument.thruster @ asked_6 + noise[12:18]
        return np.concatenate([*measured, seen, state.estimate[0] + turned, -state.lagged])
