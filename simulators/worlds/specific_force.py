"""What acts on the sensor: specific force along the sensing axis, as the bench moves, twists and shakes.

Frames and signs as in the rig's contract: lab x along the motion, z up along the rotation axis, angles
right-handed. Lucente et al. 2022, eq. 5, is what this comes to for small angles.
"""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.mounting import Mounting
from simulators.worlds.rotations import Components, turned_about_z
from simulators.worlds.stages import Stages


def vertical_lab(settings: BenchSettings) -> FloatArray:
    """The plumb line's upward direction in the lab, whose z is the rotation axis."""
    upward = np.array([-settings.size("axis-tilt", "eps_sin"), settings.size("axis-tilt", "eps_cos"), 1.0])
    return np.asarray(upward / np.linalg.norm(upward), dtype=np.float64)


class SpecificForce:
    """Acceleration minus gravity along the sensing axis of one mounting."""

    def __init__(self, settings: BenchSettings, stages: Stages, mounting: Mounting) -> None:
        self._stages = stages
        self._axis_table = mounting.sensing_axis_table
        self._gravity = settings.g_m_s2 * vertical_lab(settings)
        self._roll = settings.size("roll-gravity", "rho1")
        self._pitch = settings.size("pitch-gravity", "pi1")
        self._recoil = settings.size("bench-recoil", "c")
        self._yaw = settings.size("yaw", "psi1")
        self._lever = (settings.size("yaw-lever", "lever_cos"), settings.size("yaw-lever", "lever_sin"))
        self._quadratic = settings.size("quadratic", "K2", mounting.axis)
        self._null_rate = settings.size("null-drift", "rate", mounting.axis)

    def along_axis(self, times_s: FloatArray, ground_m_s2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Static and varying part [m/s2]; `ground_m_s2` has a row of three for each time.

        Static is what gravity gives with guide and bench straight, one value while the turntable stands.
        Varying is the rest - inertia, guide, bench and ground - with the sensor's quadratic term.
        """
        x, acceleration = self._stages.travel(times_s)
        straight = self._straight(times_s)
        yawed = self._straight(times_s, yaw=self._yaw * x) if self._yaw else straight
        # The bench's roll answers the reaction force -m a, on top of the guide's twist.
        sensing = _tipped(yawed, roll=self._roll * x - self._recoil * acceleration, pitch=self._pitch * x)
        lever_cos, lever_sin = self._lever
        static = self._weight(straight)
        force = (
            self._weight(sensing)
            - static
            + sensing[0] * (acceleration * (1.0 + lever_sin) + ground_m_s2[:, 0])
            + sensing[1] * (ground_m_s2[:, 1] - acceleration * lever_cos)
            + sensing[2] * ground_m_s2[:, 2]
        )
        return static, force + self._quadratic * np.square(force)

    def _straight(self, times_s: FloatArray, yaw: FloatArray | float = 0.0) -> Components:
        angle = self._stages.angle_rad(times_s) + yaw
        if self._null_rate:
            # A null that runs ahead is as an angle that falls behind; the cube, which lasers see, stays.
            angle = angle - self._null_rate * times_s
        return turned_about_z(self._axis_table, angle)

    def _weight(self, sensing: Components) -> FloatArray:
        x, y, z = self._gravity
        return np.asarray(x * sensing[0] + y * sensing[1] + z * sensing[2], dtype=np.float64)


def _tipped(vector: Components, roll: FloatArray, pitch: FloatArray) -> Components:
    """The vector turned by `pitch` about y, then by `roll` about x."""
    x, y, z = vector
    cos, sin = np.cos(pitch), np.sin(pitch)
    x, z = x * cos + z * sin, z * cos - x * sin
    cos, sin = np.cos(roll), np.sin(roll)
    return x, y * cos - z * sin, y * sin + z * cos
