"""Rotations and the laser geometry of the sensing-axis rig; all in radians and metres, batched over runs."""

from __future__ import annotations

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
    angle = np.linalg.norm(delta, axis=-1)[..., None, None]
    cross = np.zeros((*delta.shape[:-1], 3, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -delta[..., 2], delta[..., 1], -delta[..., 0]
    cross -= np.swapaxes(cross, -1, -2)
    # sin a / a and (1 - cos a) / a^2, in forms that are right at a = 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    rotation: FloatArray = np.eye(3) + first * cross + second * (cross @ cross)
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


def lab_from_cube_mount(theta_rad: FloatArray, delta_rad: FloatArray) -> FloatArray:
    """Rz(theta) R(delta), shape (..., 3, 3): takes the nominal turntable directions of faces to the lab."""
    rotation: FloatArray = about_z(theta_rad) @ from_vector(delta_rad)
    return rotation


def components(rotation: FloatArray, directions: FloatArray, *onto: FloatArray) -> tuple[FloatArray, ...]:
    """Turned `directions` (..., 3) projected on each of the vectors `onto` (..., 3); each of the leading shape."""
    turned = (rotation @ directions[..., None])[..., 0]
    return tuple(np.sum(turned * each, axis=-1) for each in onto)
