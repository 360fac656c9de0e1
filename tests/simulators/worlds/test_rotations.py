"""Frames: right-handed, lengths kept, and the table of nominal mountings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from simulators.worlds.rotations import about_x, about_z, nominal_table_from_cube, rotation, rotation_vector

small_vectors = arrays(np.float64, 3, elements=st.floats(-1.5, 1.5))


@pytest.mark.parametrize("cube_axis", ["X", "Y", "Z"])
def test_in_pendulum_the_measured_axis_points_along_y_and_the_motion_is_along_the_third(cube_axis: str) -> None:
    i = "XYZ".index(cube_axis)
    m = nominal_table_from_cube(cube_axis, "pendulum")
    np.testing.assert_array_equal(m[:, i], [0, 1, 0])
    np.testing.assert_array_equal(m[:, (i + 1) % 3], [0, 0, 1])
    np.testing.assert_array_equal(m[:, (i + 2) % 3], [1, 0, 0])


@pytest.mark.parametrize("cube_axis", ["X", "Y", "Z"])
def test_flag_is_pendulum_turned_ninety_degrees_about_the_measured_axis(cube_axis: str) -> None:
    turned = rotation(np.pi / 2 * np.array([0.0, 1.0, 0.0])) @ nominal_table_from_cube(cube_axis, "pendulum")
    np.testing.assert_allclose(nominal_table_from_cube(cube_axis, "flag"), turned, atol=1e-15)


def test_rotations_are_right_handed() -> None:
    np.testing.assert_allclose(about_z(np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(about_x(np.pi / 2) @ [0, 1, 0], [0, 0, 1], atol=1e-15)


@given(small_vectors)
def test_rotation_agrees_with_an_independent_implementation(vector: np.ndarray) -> None:
    np.testing.assert_allclose(rotation(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)


@given(small_vectors)
def test_rotation_vector_undoes_rotation(vector: np.ndarray) -> None:
    np.testing.assert_allclose(rotation_vector(rotation(vector)), vector, atol=1e-13)
