import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation

from rigctl.analysis.measurement_result import spread_interval
from rigctl.analysis.plane import ARCSEC, Axis, angle_between, fit_plane, plane_normals
from rigctl.core.errors import ProcedureError

SCATTER_RAD = 12.5 * ARCSEC
rotations = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1)
seeds = st.integers(0, 2**32 - 1)


def frame(normal):
    """Columns: two directions in the plane, and the normal."""
    normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    first = np.cross(normal, [0.3, -0.5, 0.8])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def two_clusters(rng, normal=(0.0128, 0.0015, 0.9999), each=10, scatter_rad=SCATTER_RAD):
    """Ten motion vectors in pendulum and ten in flag, 90 degrees apart, out of the plane by the scatter."""
    azimuth = np.repeat([0.0, np.pi / 2], each) + 2e-3 * rng.normal(size=2 * each)
    out = scatter_rad * rng.normal(size=2 * each)
    local = np.stack([np.cos(azimuth) * np.cos(out), np.sin(azimuth) * np.cos(out), np.sin(out)], axis=1)
    return local @ frame(normal).T


class TestNormal:
    def test_without_scatter_it_is_exact(self):
        truth = frame([0.6, -0.2, 0.9])[:, 2]
        fit = fit_plane(two_clusters(np.random.default_rng(1), truth, scatter_rad=0.0), [0, 0, 1])
        np.testing.assert_allclose(fit.normal, truth, atol=1e-14)
        assert fit.vectors == 20
        assert fit.dof == 18

    @settings(max_examples=40, deadline=None)
    @given(rotations, seeds)
    def test_turns_with_the_vectors(self, quaternion, seed):
        turn = Rotation.from_quat(quaternion).as_matrix()
        vectors = two_clusters(np.random.default_rng(seed))
        fit, turned = fit_plane(vectors, [0, 0, 1]), fit_plane(vectors @ turn.T, turn @ [0, 0, 1])
        np.testing.assert_allclose(turned.normal, turn @ fit.normal, atol=1e-12)
        np.testing.assert_allclose(turned.covariance, turn @ fit.covariance @ turn.T, atol=1e-12 * SCATTER_RAD)
        np.testing.assert_allclose(turned.half_cone_rad, fit.half_cone_rad, atol=1e-12)
        assert turned.sigma_hc_rad == pytest.approx(fit.sigma_hc_rad, rel=1e-7)

    @settings(max_examples=40, deadline=None)
    @given(seeds)
    def test_order_length_and_sign_of_the_vectors_do_not_matter(self, seed):
        rng = np.random.default_rng(seed)
        vectors = two_clusters(rng)
        order = rng.permutation(len(vectors))
        factors = rng.choice([-1.0, 1.0], len(vectors)) * 10.0 ** rng.uniform(-6, 6, len(vectors))
        fit = fit_plane(vectors, [0, 0, 1])
        other = fit_plane((vectors * factors[:, None])[order], [0, 0, 1])
        np.testing.assert_allclose(other.normal, fit.normal, atol=1e-13)
        np.testing.assert_allclose(other.covariance, fit.covariance, atol=1e-12 * SCATTER_RAD**2 + 1e-22)
        np.testing.assert_allclose(other.half_cone_rad, (np.sign(factors) * fit.half_cone_rad)[order], atol=1e-12)

    def test_the_nominal_axis_settles_the_sign(self):
        vectors = two_clusters(np.random.default_rng(2))
        up, down = fit_plane(vectors, [0, 0, 1]), fit_plane(vectors, [0, 0, -5])
        np.testing.assert_allclose(up.normal, -down.normal)
        np.testing.assert_allclose(up.half_cone_rad, -down.half_cone_rad)


class TestScatter:
    def test_numbers_are_those_of_their_definitions(self):
        vectors = two_clusters(np.random.default_rng(4))
        fit = fit_plane(vectors, [0, 0, 1])
        theta = np.pi / 2 - np.arccos(vectors @ fit.normal)
        np.testing.assert_allclose(fit.half_cone_rad, theta, atol=1e-12)
        assert fit.theta_m_arcsec == pytest.approx(theta.mean() * 206264.806, abs=1e-6)
        assert fit.std_hc_2sigma_arcsec == pytest.approx(2 * theta.std(ddof=1) * 206264.806, rel=1e-6)
        assert 15.0 < fit.std_hc_2sigma_arcsec < 35.0

    def test_covariance_is_that_of_a_straight_line_fit_in_the_plane(self):
        truth = frame([0.2, -0.1, 0.9])
        in_plane = np.array([[1.0, 0.0], [0.9, 0.1], [1.0, 0.2], [0.1, 1.0], [0.7, -0.7]])
        in_plane /= np.linalg.norm(in_plane, axis=1)[:, None]
        out = 1e-5 * np.array([1.0, -2.0, 0.5, 1.5, -0.7])
        fit = fit_plane(in_plane @ truth[:, :2].T + out[:, None] * truth[:, 2], truth[:, 2])
        tilt, square_sum = np.linalg.lstsq(in_plane, -out, rcond=None)[:2]
        covariance = square_sum / 3.0 * np.linalg.inv(in_plane.T @ in_plane)
        np.testing.assert_allclose(truth[:, :2].T @ fit.normal, tilt, rtol=1e-6)
        np.testing.assert_allclose(truth[:, :2].T @ fit.covariance @ truth[:, :2], covariance, rtol=1e-4)

    def test_covariance_is_singular_along_the_normal(self):
        fit = fit_plane(two_clusters(np.random.default_rng(5)), [0, 0, 1])
        np.testing.assert_allclose(fit.covariance @ fit.normal, 0.0, atol=1e-22)
        assert np.linalg.matrix_rank(fit.covariance, tol=1e-14) == 2

    def test_errors_over_stated_sigma_follow_student_t(self):
        truth = frame((0.0128, 0.0015, 0.9999))
        rng = np.random.default_rng(6)
        along, across, squares = [], [], []
        for _ in range(2000):
            fit = fit_plane(two_clusters(rng), [0, 0, 1])
            error = fit.normal - truth[:, 2]
            along.append(error @ truth[:, 0] / np.sqrt(truth[:, 0] @ fit.covariance @ truth[:, 0]))
            across.append(error @ truth[:, 1] / np.sqrt(truth[:, 1] @ fit.covariance @ truth[:, 1]))
            squares.append(error @ np.linalg.pinv(fit.covariance, rcond=1e-6) @ error)
        assert stats.kstest(along, stats.t(18).cdf).pvalue > 0.01
        assert stats.kstest(across, stats.t(18).cdf).pvalue > 0.01
        assert stats.kstest(np.array(squares) / 2.0, stats.f(2, 18).cdf).pvalue > 0.01


PRINTED = {
    "X": ((9.9992e-1, 1.4503e-3, 1.2822e-2), -0.051),
    "Y": ((-6.7925e-3, 9.9997e-1, -1.9907e-3), -0.342),
}
"""Table 1: axis in the cube's frame, theta_m [arcsec]."""


def test_the_interval_of_a_half_cone_deviation_holds_the_true_one():
    """Of six vectors two degrees of freedom are the plane's: with five, one in thirteen was outside."""
    rng, sets = np.random.default_rng(16), 4000
    inside = 0
    for _ in range(sets):
        fit = fit_plane(two_clusters(rng, each=3), [0, 0, 1])
        low, high = spread_interval(fit.hc_unbiased * fit.sigma_hc_rad, fit.dof)
        inside += low < SCATTER_RAD < high
    # Four standard deviations of a share of 95 %.
    assert abs(inside / sets - 0.95) < 4.0 * math.sqrt(0.95 * 0.05 / sets)


def nulls_of(rng, axis, each=10):
    """Motions at the nulls along the two cube axes across a sensing axis that every mounting tilts anew."""
    along = [i for i in range(3) if abs(axis[i]) < 0.5]
    vectors = []
    for i in np.repeat(along, each):
        tilted = axis / np.linalg.norm(axis) + SCATTER_RAD * rng.normal(size=3)
        tilted /= np.linalg.norm(tilted)
        vectors.append(np.eye(3)[i] - tilted[i] * tilted)
    return np.array(vectors)


class TestNormalEquations:
    def test_agree_where_the_axis_stands_upright(self):
        fit = fit_plane(two_clusters(np.random.default_rng(8)), [0, 0, 1])
        assert np.linalg.norm(fit.paper_axis.unit - fit.normal) < 0.01 * ARCSEC

    def test_keep_the_sign_of_the_normal(self):
        fit = fit_plane(two_clusters(np.random.default_rng(8)), [0, 0, -1])
        assert fit.paper_axis.unit @ fit.normal == pytest.approx(1.0)

    @pytest.mark.parametrize("name", ["X", "Y"])
    def test_make_the_printed_theta_m_of_horizontal_axes(self, name):
        (axis, printed_arcsec), rng = PRINTED[name], np.random.default_rng(9)
        fits = [fit_plane(nulls_of(rng, np.array(axis)), axis) for _ in range(400)]
        means = np.array([fit.paper_axis.theta_m_arcsec for fit in fits])
        # One printed value of a distribution about zero: within its 99 %, and more than a fifth of its width.
        assert 0.2 < abs(printed_arcsec) / np.sqrt(np.mean(means**2)) < 2.6
        assert max(abs(fit.theta_m_arcsec) for fit in fits) < 1e-4, "least squares leave no mean"
        apart = np.array([np.linalg.norm(fit.paper_axis.unit - fit.normal) / ARCSEC for fit in fits])
        # Attenuation: the scatter of all twenty where only ten have extent.
        expected = 2.0 * 12.5**2 * ARCSEC / abs(axis[2])
        assert apart.mean() == pytest.approx(expected, rel=0.15)

    def test_have_no_solution_for_vectors_of_an_axis_that_lies_level(self):
        fit = fit_plane(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.6, 0.8]]), [1, 0, 0])
        assert fit.paper_axis is None


class TestRefusals:
    @pytest.mark.parametrize(
        ("vectors", "nominal", "words"),
        [
            (np.eye(3)[:2], [0, 0, 1], "at least three"),
            (np.ones((4, 2)), [0, 0, 1], "three components"),
            ([[1, 0, 0], [0, 1, 0], [np.nan, 1, 0]], [0, 0, 1], "vector 2 .* not finite"),
            ([[1, 0, 0], [0, 0, 0], [1, 1, 0]], [0, 0, 1], "vector 1 is zero"),
            ([[1, 0, 0], [-2, 0, 0], [3, 0, 1e-9]], [0, 0, 1], "parallel"),
            (np.eye(3), [0, 0, 1], "span no plane"),
            ([[1, 0, 0], [0, 1, 0], [1, 1, 0]], [1, 0, 0], "which axis"),
            ([[1, 0, 0], [0, 1, 0], [1, 1, 0]], [0, 0, 0], "which axis"),
        ],
    )
    def test_degenerate_input_is_named(self, vectors, nominal, words):
        with pytest.raises(ProcedureError, match=words):
            fit_plane(np.array(vectors, dtype=float), np.array(nominal, dtype=float))


class TestAngleBetween:
    def test_angle_and_sigma_agree_with_simulation(self):
        rng = np.random.default_rng(10)
        a, b = frame([1, 0.01, 0.02])[:, 2], frame([-0.02, 1, 0.0])[:, 2]
        covariances = []
        for unit, sizes in ((a, (20, 5)), (b, (8, 30))):
            plane = frame(unit)[:, :2] * np.array(sizes) * ARCSEC
            covariances.append(plane @ plane.T)
        found = angle_between(Axis(a, covariances[0]), Axis(b, covariances[1]))
        draws = [rng.multivariate_normal(u, c, 4000) for u, c in zip((a, b), covariances, strict=True)]
        angles = np.arccos(np.sum(draws[0] * draws[1], axis=1))
        assert found.rad == pytest.approx(np.arccos(a @ b), abs=1e-12)
        assert found.sigma_rad == pytest.approx(angles.std(), rel=4 / np.sqrt(2 * 4000))

    @settings(max_examples=30, deadline=None)
    @given(rotations, seeds)
    def test_is_the_same_in_every_frame_and_order(self, quaternion, seed):
        rng = np.random.default_rng(seed)
        turn = Rotation.from_quat(quaternion).as_matrix()
        a = fit_plane(two_clusters(rng, (1, 0.01, 0.02)), [1, 0, 0]).axis
        b = fit_plane(two_clusters(rng, (0.01, 1, 0.02)), [0, 1, 0]).axis
        turned = [Axis(turn @ each.unit, turn @ each.covariance @ turn.T, each.dof) for each in (b, a)]
        here, there = angle_between(a, b), angle_between(*turned)
        assert there.rad == pytest.approx(here.rad, abs=1e-13)
        assert there.sigma_rad == pytest.approx(here.sigma_rad, rel=1e-8)

    def test_of_parallel_axes_takes_the_worst_direction(self):
        axis = Axis(np.array([0, 0, 1.0]), np.diag([4.0, 9.0, 0.0]) * ARCSEC**2)
        found = angle_between(axis, axis)
        assert found.rad == 0.0
        assert found.sigma_rad == pytest.approx(np.sqrt(18.0) * ARCSEC)


def test_the_normals_of_many_planes_are_those_of_each():
    rng = np.random.default_rng(5)
    planes = np.stack([two_clusters(rng) for _ in range(7)])
    nominal = np.array([0.0, 0.0, -1.0])
    expected = [fit_plane(vectors, nominal).normal for vectors in planes]
    np.testing.assert_allclose(plane_normals(planes, nominal), expected, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(plane_normals(planes[0], nominal), expected[0], rtol=0.0, atol=1e-15)


def test_the_papers_axes_are_as_far_apart_as_its_table_2():
    """Lucente et al. 2022: the components of Table 1 give the offsets from 90 degrees of Table 2."""
    axes = {
        "X": [9.9992e-1, 1.4503e-3, 1.2822e-2],
        "Y": [-6.7925e-3, 9.9997e-1, -1.9907e-3],
        "Z": [-1.2242e-2, 2.4100e-3, 9.9992e-1],
    }
    known = {name: Axis(np.array(v) / np.linalg.norm(v), np.zeros((3, 3))) for name, v in axes.items()}
    for pair, offset_deg in {"XY": 0.31, "XZ": 0.03, "YZ": 0.03}.items():
        angle = np.degrees(angle_between(known[pair[0]], known[pair[1]]).rad)
        assert abs(angle - 90.0) == pytest.approx(offset_deg, abs=0.006)
