"""Rotations as matrices, and how the optical cube sits on the turntable (Lucente et al. 2022, frames)."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from rigctl.core.arrays import FloatArray

CubeAxis = Literal["X", "Y", "Z"]
Configuration = Literal["pendulum", "flag"]

# Where the cube axes (i, j, k), in cyclic order from the measured one, point in the turntable's frame.
_NOMINAL_IJK = {
    "pendulum": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    "flag": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
}


def nominal_table_from_cube(cube_axis: CubeAxis, configuration: Configuration) -> FloatArray:
    """The 90-degree rotation, 3 x 3, that takes cube components to turntable components."""
    first = "XYZ".index(cube_axis)
    matrix = np.zeros((3, 3))
    for order, image in enumerate(_NOMINAL_IJK[configuration]):
        matrix[:, (first + order) % 3] = image
    return matrix


def about_x(angle_rad: float) -> FloatArray:
    """Right-handed rotation about x, 3 x 3."""
    return rotation(np.array([angle_rad, 0.0, 0.0]))


def about_z(angle_rad: float) -> FloatArray:
    """Right-handed rotation about z, 3 x 3."""
    return rotation(np.array([0.0, 0.0, angle_rad]))


def rotation(vector_rad: FloatArray) -> FloatArray:
    """exp([v]x) as a 3 x 3 matrix, by Rodrigues' formula."""
    angle = float(np.linalg.norm(vector_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector_rad / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # 2 sin^2(a/2) instead of 1 - cos(a): microradian rotations keep their digits.
    turned = np.eye(3) + math.sin(angle) * cross + 2.0 * math.sin(0.5 * angle) ** 2 * (cross @ cross)
    return np.asarray(turned, dtype=np.float64)


def rotation_vector(matrix: FloatArray) -> FloatArray:
    """The vector v [rad] with exp([v]x) = matrix, for angles below 180 degrees."""
    twice_sine = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    sine = 0.5 * float(np.linalg.norm(twice_sine))
    # Of sine and cosine: the trace alone loses the digits of small angles.
    angle = math.atan2(sine, 0.5 * (float(np.trace(matrix)) - 1.0))
    return 0.5 * twice_sine * (angle / sine if sine > 0.0 else 1.0)


Components = tuple[FloatArray, FloatArray, FloatArray]
"""A vector that changes with time, as its three components."""


def turned_about_z(vector: FloatArray, angles_rad: FloatArray) -> Components:
    """A constant vector seen from a frame it turns in, one result per angle."""
    cos, sin = np.cos(angles_rad), np.sin(angles_rad)
    x, y, z = vector
    return x * cos - y * sin, x * sin + y * cos, np.full_like(cos, z)
