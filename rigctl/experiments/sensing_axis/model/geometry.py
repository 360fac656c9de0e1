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


def lab_from_cube_mount(theta_rad: FloatArray, delta_rad: FloatArray) -> FloatArray:
    """Rz(theta) R(delta), shape (..., 3, 3): takes the nominal turntable directions of faces to the lab."""
    angle, turned = np.asarray(theta_rad, dtype=np.float64)[..., None], from_vector(delta_rad)
    cos, sin = np.cos(angle), np.sin(angle)
    first, second = turned[..., 0, :], turned[..., 1, :]
    third = np.broadcast_to(turned[..., 2, :], np.broadcast_shapes((*cos.shape[:-1], 3), first.shape))
    return np.stack([cos * first - sin * second, sin * first + cos * second, third], axis=-2)


def components(rotation: FloatArray, directions: FloatArray, *onto: FloatArray) -> tuple[FloatArray, ...]:
    """Turned `directions` (..., 3) projected on each of the vectors `onto` (..., 3); each of the leading shape."""
    turned = [dot(rotation[..., i, :], directions) for i in range(3)]
    return tuple(sum((turned[i] * each[..., i] for i in (1, 2)), turned[0] * each[..., 0]) for each in onto)


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products of vectors (..., 3)."""
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])
