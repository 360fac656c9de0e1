"""The rotation between two frames against what it was drawn from."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation

from rigctl.analysis.plane import ARCSEC
from rigctl.analysis.rotation import rotation_between
from rigctl.core.errors import DataError

NORMALS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
SIGMA_RAD = np.array([1.0, 3.0, 2.0, 1.5]) * ARCSEC

turns = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)


@settings(max_examples=50, deadline=None)
@given(turns)
def test_without_errors_it_is_exact(turn):
    truth = Rotation.from_rotvec(turn).as_matrix()
    found = rotation_between(NORMALS, 5.0 * NORMALS @ truth.T, SIGMA_RAD)
    np.testing.assert_allclose(found.matrix, truth, atol=1e-12)
    assert np.linalg.det(found.matrix) == pytest.approx(1.0)
    assert (found.dof, found.chi2) == (5, pytest.approx(0.0, abs=1e-6))


def test_its_errors_are_those_it_states():
    rng = np.random.default_rng(1)
    truth = Rotation.from_rotvec([0.0, 0.61, 0.2])
    pulls, chi2 = [], []
    for _ in range(3000):
        read = NORMALS @ truth.as_matrix().T + SIGMA_RAD[:, None] * rng.normal(size=(4, 3))
        found = rotation_between(NORMALS, read, SIGMA_RAD)
        turn = (Rotation.from_matrix(found.matrix) * truth.inv()).as_rotvec()
        pulls.append(turn @ np.linalg.inv(found.covariance) @ turn)
        chi2.append(found.chi2)
    assert stats.kstest(pulls, stats.chi2(3).cdf).pvalue > 0.01
    assert stats.kstest(chi2, stats.chi2(5).cdf).pvalue > 0.01


def test_a_direction_knows_nothing_of_the_turn_about_itself():
    sigma_rad = np.array([1.0, 100.0]) * ARCSEC
    found = rotation_between(NORMALS[:2], NORMALS[:2], sigma_rad)
    # About y and z by the good one, about x by the poor one alone.
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)) / ARCSEC, [100.0, 1.0, 1.0], rtol=1e-3)
    assert found.dof == 1
    assert [(about.tolist(), round(u_rad / ARCSEC)) for about, u_rad in found.turns()][-1] == ([1.0, 0.0, 0.0], 100)


def test_directions_along_one_line_are_refused():
    with pytest.raises(DataError, match="along one line"):
        rotation_between(NORMALS[[1, 3]], NORMALS[[1, 3]], SIGMA_RAD[:2])
