"""The loops of the second satellite: linear systems, solved mode by mode.

The page steps its loops by Euler; here each is a continuous system in its eigenvectors, and every mode is integrated
exactly for inputs that are straight between samples. Where the page leaves the loop open: no delay of a sample, and a
third-order Butterworth polynomial for the observer of the attitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Floats = NDArray[np.float64]

K_RAD_S = 2.0 * np.pi * 0.05
INTEGRAL_RAD_S = K_RAD_S / 5.0
THRUSTER_S = 1.0
OBSERVER_RAD_S = 2.0 * np.pi * 5e-3
STIFFNESS = (2.0 * np.pi * 20e-3) ** 2
DAMPING = 1.6 * np.sqrt(STIFFNESS)


@dataclass(frozen=True)
class Linear:
    """x' = a x + b u, y = c x + d u."""

    a: Floats
    b: Floats
    c: Floats
    d: Floats

    def answer(self, inputs: Floats, step_s: float) -> Floats:
        """Outputs (rows) to inputs (rows) that are straight between samples, from rest."""
        rates, vectors = np.linalg.eig(self.a)
        driven = np.linalg.solve(vectors, self.b) @ inputs
        modes = []
        for rate, drive in zip(rates, driven, strict=True):
            z = rate * step_s
            first = np.expm1(z) / z
            second = (np.expm1(z) - z) / z**2
            weights = [step_s * second, step_s * (first - second)]
            modes.append(signal.lfilter(weights, [1.0, -np.exp(z)], drive))
        return np.asarray(np.real(self.c @ vectors @ np.array(modes)) + self.d @ inputs)


DRAG_FREE = Linear(
    a=np.array([
        [0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0],
        [K_RAD_S / THRUSTER_S, K_RAD_S * INTEGRAL_RAD_S / THRUSTER_S, -1.0 / THRUSTER_S],
    ]),
    b=np.array([[1.0], [0.0], [0.0]]),
    c=np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [-K_RAD_S, -K_RAD_S * INTEGRAL_RAD_S, 0.0]]),
    d=np.array([[1.0], [0.0], [0.0]]),
)  # fmt: skip
"""From what acts on the error: the error, what the thrusters take away, and the command; states i1, i2, u_lag."""


def observer() -> Linear:
    """From torque, tracker's and accelerometer's additions: angle, rate, acceleration, estimated angle."""
    g1, g2, g3 = 2.0 * OBSERVER_RAD_S, 2.0 * OBSERVER_RAD_S**2, OBSERVER_RAD_S**3
    turn = np.array([0.0, 0.0, -STIFFNESS, -DAMPING, 0.0])
    a = np.array([
        [0.0, 1.0, 0.0, 0.0, 0.0],
        turn,
        [g1, 0.0, -g1, 1.0, 0.0],
        turn + np.array([g2, 0.0, -g2, 0.0, -1.0]),
        [-g3, 0.0, g3, 0.0, 0.0],
    ])  # fmt: skip
    b = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, g1, 0.0], [1.0, g2, 1.0], [0.0, -g3, 0.0]])
    c = np.array([np.eye(5)[0], np.eye(5)[1], turn, np.eye(5)[2]])
    d = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return Linear(a, b, c, d)


ATTITUDE = observer()


def drag_free_sensitivity(f_hz: Floats) -> Floats:
    """|error / disturbance| of the drag-free loop."""
    s = 2j * np.pi * np.asarray(f_hz)
    free = s**2 * (1.0 + THRUSTER_S * s)
    return np.asarray(np.abs(free / (free + K_RAD_S * (s + INTEGRAL_RAD_S))))
