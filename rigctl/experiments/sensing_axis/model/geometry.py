"""Rotations and the laser geometry of the sensing-axis rig; all in radians and metres, batched over runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.core.arrays import FloatArray

X_LAB = np.array([1.0, 0.0, 0.0])


def about_z(angle_rad: FloatArray) -> FloatArray:
    """Rotation matrices about z, shape (..., 3, 3)."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.zeros((*angle.shape, 3, 3))
    matrix[..., 0, 0] = matrix[..., 1, 1] = cos
    matrix[..., 0, 1] = -sin
    matrix[..., 1, 0] = sin
    matrix[..., 2, 2] = 1.0
    return matrix


def from_vector(delta_rad: FloatArray) -> FloatArray:
    """R(delta) = exp([delta]x) for rotation vectors of shape (..., 3); shape (..., 3, 3) (Rodrigues)."""
    delta = np.asarray(delta_rad, dtype=np.float64)
    x, y, z = (delta[..., i] for i in range(3))
    angle = np.sqrt(x * x + y * y + z * z)
    # sin a / a and (1 - cos a) / a^2, in forms that are right at a = 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    # Element by element, here and below: products of many small matrices take twenty times as long.
    rotation = np.empty((*angle.shape, 3, 3))
    for i, j, k, own in ((0, 1, 2, z), (1, 2, 0, x), (2, 0, 1, y)):
        rotation[..., i, i] = 1.0 - second * (delta[..., j] ** 2 + delta[..., k] ** 2)
        both = second * delta[..., i] * delta[..., j]
        rotation[..., i, j], rotation[..., j, i] = both - first * own, both + first * own
    return rotation


def motion_in_cube(theta_rad: FloatArray, delta_rad: FloatArray, nominal: FloatArray) -> FloatArray:
    """Unit vector of the stage's motion in the cube's frame: V_C = M^t R(delta)^t Rz(-theta) x_L, (..., 3)."""
    turntable_from_lab = about_z(-np.asarray(theta_rad, dtype=np.float64))
    cube_from_turntable = np.swapaxes(from_vector(delta_rad) @ nominal, -1, -2)
    motion: FloatArray = (cube_from_turntable @ turntable_from_lab @ X_LAB[:, None])[..., 0]
    return motion


def leaning(position: FloatArray) -> FloatArray:
    """The direction in the lab towards which the beam of a head at `position` is tilted, shape (3,)."""
    # Beams at the side are tilted upwards, that from above along the motion.
    return np.array([1.0, 0.0, 0.0]) if abs(position[2]) > 0.5 else np.array([0.0, 0.0, 1.0])


def about_vertical(
    cos: FloatArray, sin: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Vectors (..., 3) turned about z by angles of this cosine and sine, component by component."""
    # A matrix for each angle within a period would take four times as long.
    x, y, z = (directions[..., i] for i in range(3))
    return cos * x - sin * y, sin * x + cos * y, z


def component(parts: Sequence[FloatArray], onto: FloatArray) -> FloatArray:
    """Of a vector, given as its three components, the one along unit vectors (..., 3)."""
    return np.asarray(parts[0] * onto[..., 0] + parts[1] * onto[..., 1] + parts[2] * onto[..., 2])


def turned(rotation: FloatArray, directions: FloatArray) -> FloatArray:
    """Vectors (..., 3) turned by matrices (..., 3, 3)."""
    # Element by element: products of many small matrices take twenty times as long.
    x, y, z = (directions[..., i, None] for i in range(3))
    return np.asarray(rotation[..., 0] * x + rotation[..., 1] * y + rotation[..., 2] * z)
