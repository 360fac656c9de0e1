import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rigctl.analysis import least_squares as fits
from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.errors import ProcedureError

X = np.linspace(0.0, 4.0, 40)
LINE = [Parameter("offset", 0.0), Parameter("slope", 0.0)]


def derivatives(residuals, step=1e-6):
    """The model's derivatives by complex steps, exact to rounding."""

    def jacobian(p):
        moved = (-residuals(p + 1j * step * each) for each in np.eye(len(p)))
        return np.stack([np.imag(r) / step for r in moved], axis=1)

    return jacobian


def least_squares(residuals, parameters, jacobian=None, **options):
    return fits.least_squares(residuals, parameters, jacobian=jacobian or derivatives(residuals), **options)


def line(y, sigma=0.1):
    return lambda p: (y - p[0] - p[1] * X) / sigma


def decay(y, sigma=0.01):
    return lambda p: (y - p[0] * np.exp(-p[1] * X) - p[2]) / sigma


DECAY = [Parameter("size", 1.0), Parameter("rate", 1.0), Parameter("floor", 0.0)]


class TestLinear:
    def test_is_the_textbook_solution(self):
        y = 1.0 + 2.0 * X + 0.1 * np.random.default_rng(1).normal(size=X.size)
        design = np.stack([np.ones_like(X), X], axis=1) / 0.1
        expected = np.linalg.lstsq(design, y / 0.1, rcond=None)[0]
        fit = least_squares(line(y), LINE)
        np.testing.assert_allclose(fit.values, expected, rtol=1e-9)
        np.testing.assert_allclose(fit.covariance, np.linalg.inv(design.T @ design), rtol=1e-7)
        np.testing.assert_allclose(fit.residuals, y / 0.1 - design @ expected, atol=1e-8)
        assert fit.verdict == "converged"
        assert fit.dof == X.size - 2
        assert fit.chi2 == pytest.approx(float(fit.residuals @ fit.residuals))
        assert fit.value("slope") == fit.values[1]
        assert fit.sigma("slope") == pytest.approx(np.sqrt(fit.covariance[1, 1]))

    @settings(max_examples=30, deadline=None)
    @given(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0))
    def test_does_not_care_for_the_units_of_its_parameters(self, decades_a, decades_b):
        y = 1.0 + 2.0 * X + 0.1 * np.sin(9 * X)
        unit = np.array([10.0**decades_a, 10.0**decades_b])
        plain = least_squares(line(y), LINE)
        scaled = least_squares(lambda p: line(y)(p * unit), LINE)
        assert scaled.verdict == "converged"
        np.testing.assert_allclose(scaled.values * unit, plain.values, atol=3e-4 * plain.sigma("slope"))
        np.testing.assert_allclose(scaled.covariance * np.outer(unit, unit), plain.covariance, rtol=1e-5)

    @settings(max_examples=20, deadline=None)
    @given(st.permutations(range(X.size)))
    def test_order_of_the_data_does_not_matter(self, order):
        y = 1.0 + 2.0 * X + 0.1 * np.sin(9 * X)
        fit, shuffled = (least_squares(lambda p, o=o: line(y)(p)[o], LINE) for o in (slice(None), list(order)))
        np.testing.assert_allclose(shuffled.values, fit.values, rtol=1e-9)
        assert shuffled.chi2 == pytest.approx(fit.chi2)

    def test_a_fixed_parameter_keeps_its_start_and_has_no_uncertainty(self):
        y = 1.0 + 2.0 * X
        fit = least_squares(line(y), [Parameter("offset", 0.5, fixed=True), Parameter("slope", 0.0)])
        assert fit.value("offset") == 0.5
        assert fit.sigma("offset") == 0.0
        assert fit.dof == X.size - 1
        assert fit.value("slope") == pytest.approx(2.0 + 0.5 * X.sum() / (X @ X))

    def test_a_prior_is_one_more_datum(self):
        y = 1.0 + 2.0 * X
        parameters = [Parameter("offset", 0.0, prior=Prior(3.0, 0.02)), Parameter("slope", 0.0)]
        fit = least_squares(line(y), parameters)
        design = np.vstack([np.stack([np.ones_like(X), X], axis=1) / 0.1, [50.0, 0.0]])
        expected = np.linalg.lstsq(design, np.append(y / 0.1, 150.0), rcond=None)[0]
        np.testing.assert_allclose(fit.values, expected, rtol=1e-9)
        np.testing.assert_allclose(fit.covariance, np.linalg.inv(design.T @ design), rtol=1e-7)
        assert fit.dof == X.size - 1
        assert fit.residuals.size == X.size
        assert fit.chi2 > float(fit.residuals @ fit.residuals) + 100.0

    def test_nothing_free_is_an_evaluation(self):
        fit = least_squares(
            line(1.0 + X), [Parameter("offset", 1.0, fixed=True), Parameter("slope", 1.0, fixed=True)]
        )
        assert (fit.verdict, fit.dof) == ("converged", X.size)
        assert fit.chi2 < 1e-20


class TestNonlinear:
    @pytest.mark.parametrize("start", [(1.0, 1.0, 0.0), (30.0, 20.0, -5.0), (0.1, 0.1, 3.0)])
    def test_finds_the_minimum_from_afar(self, start):
        y = 2.0 * np.exp(-X / 0.7) + 0.3 + 0.01 * np.random.default_rng(1).normal(size=X.size)
        parameters = [Parameter(each.name, at) for each, at in zip(DECAY, start, strict=True)]
        fit = least_squares(decay(y), parameters)
        near = least_squares(decay(y), [Parameter("size", 2.0), Parameter("rate", 1.43), Parameter("floor", 0.3)])
        assert fit.verdict == "converged"
        assert np.all(np.abs(fit.values - near.values) < 3e-4 * np.sqrt(np.diag(near.covariance)))
        assert stats.chi2.sf(fit.chi2, fit.dof) > 0.01

    def test_errors_over_sigma_are_normal_and_p_values_uniform(self):
        rng, pulls, p_values = np.random.default_rng(2), [], []
        truth = np.array([2.0, 1.4, 0.3])
        for _ in range(200):
            y = truth[0] * np.exp(-truth[1] * X) + truth[2] + 0.01 * rng.normal(size=X.size)
            fit = least_squares(decay(y), DECAY)
            pulls.append((fit.values - truth) / np.sqrt(np.diag(fit.covariance)))
            p_values.append(stats.chi2.sf(fit.chi2, fit.dof))
        for column in np.transpose(pulls):
            assert stats.kstest(column, "norm").pvalue > 1e-3
        assert stats.kstest(p_values, "uniform").pvalue > 1e-3

    def test_stops_and_says_so_when_steps_run_out(self):
        fit = least_squares(decay(2.0 * np.exp(-2.5 * X)), DECAY, max_iterations=1)
        assert fit.verdict == "not-converged"
        assert "could still fall" in fit.reason


class TestFarFromTheData:
    """Steps by the first derivatives alone go to and fro across a valley and creep along it."""

    T = np.arange(1, 21) / 5.0

    def brown_and_dennis(self, p):
        """More, Garbow and Hillstrom, ACM Trans. Math. Softw. 7 (1981) 17, no. 16."""
        return (p[0] + self.T * p[1] - np.exp(self.T)) ** 2 + (p[2] + p[3] * np.sin(self.T) - np.cos(self.T)) ** 2

    def test_converges_all_the_same(self):
        starts = zip("abcd", (25.0, 5.0, -5.0, -1.0), strict=True)
        fit = least_squares(self.brown_and_dennis, [Parameter(name, start) for name, start in starts])
        assert fit.verdict == "converged"
        assert fit.chi2 == pytest.approx(85822.2, abs=0.05)


class TestWhatTheDataCannotSay:
    def redundant(self, p):
        return (1.0 + X - p[0] * X - p[1] - 2.0 * p[2]) / 0.1

    def parameters(self, **third):
        return [Parameter("slope", 0.0), Parameter("theta0", 0.0), Parameter("recoil", 0.0, **third)]

    def test_is_named_and_never_a_number(self):
        fit = least_squares(self.redundant, self.parameters())
        assert fit.verdict == "ill-conditioned"
        assert "theta0" in fit.reason
        assert "recoil" in fit.reason
        assert "slope" not in fit.reason
        assert np.isnan(fit.value("theta0"))
        assert np.isnan(fit.sigma("recoil"))
        assert fit.value("slope") == pytest.approx(1.0, abs=1e-6)
        assert fit.sigma("slope") == pytest.approx(0.1 / np.sqrt(((X - X.mean()) ** 2).sum()))
        assert fit.dof == X.size - 2

    def test_the_direction_is_in_the_parameters_own_units(self):
        fit = least_squares(self.redundant, self.parameters())
        assert ("theta0 - 0.5 recoil" in fit.reason) or ("recoil - 2 theta0" in fit.reason)

    def test_each_of_several_directions_names_few(self):
        def pairs(p):
            return X**2 - (p[0] + p[1]) * np.exp(-X) - (p[2] - 3.0 * p[3]) * X

        fit = least_squares(pairs, [Parameter(name, 0.0) for name in "abcd"])
        first, second = fit.reason.removeprefix("the data leave undetermined: ").split(";")[:2]
        assert {frozenset("ab"), frozenset("cd")} == {
            frozenset(word for word in part.split() if word in "abcd") for part in (first, second)
        }

    @pytest.mark.parametrize("known", [{"prior": Prior(0.1, 0.01)}, {"fixed": True}])
    def test_a_prior_or_a_fixed_value_mends_it(self, known):
        fit = least_squares(self.redundant, self.parameters(**known))
        assert fit.verdict == "converged"
        assert np.isfinite(fit.covariance).all()

    def test_a_parameter_without_effect_is_named(self):
        fit = least_squares(lambda p: line(1.0 + X)(p[:2]), [*LINE, Parameter("idle", 4.0)])
        assert fit.verdict == "ill-conditioned"
        assert "undetermined: idle;" in fit.reason
        assert np.isnan(fit.value("idle"))
        assert fit.value("slope") == pytest.approx(1.0)

    def test_more_parameters_than_data(self):
        fit = least_squares(lambda p: np.array([1.0 - p[0] - p[1]]), [Parameter("a", 0.0), Parameter("b", 0.0)])
        assert fit.verdict == "ill-conditioned"
        assert np.isnan(fit.chi2_per_dof)

    def test_nearly_parallel_columns_are_still_told_apart(self):
        twist = 1e-5 * np.sin(9 * X)
        fit = least_squares(
            lambda p: (X - p[0] * X - p[1] * (X + twist)) / 1e-3, [Parameter("a", 0.0), Parameter("b", 0.0)]
        )
        assert fit.verdict == "converged"
        assert fit.value("a") + fit.value("b") == pytest.approx(1.0, abs=1e-4)
        assert fit.sigma("a") == pytest.approx(1e-3 / np.linalg.norm(twist - X * (X @ twist) / (X @ X)), rel=1e-3)


class TestLimits:
    def test_a_limit_that_holds_the_fit_back_is_named(self):
        fit = least_squares(line(1.0 + 2.0 * X), [LINE[0], Parameter("slope", 0.0, upper=1.5)])
        assert fit.verdict == "at-limit"
        assert "slope = 1.5" in fit.reason
        assert np.isnan(fit.sigma("slope"))
        assert fit.dof == X.size - 2
        assert fit.value("offset") == pytest.approx(1.0 + 0.5 * X.mean())

    def test_a_limit_touched_on_the_way_is_left_again(self):
        y = 2.0 * np.exp(-X / 0.7) + 0.3
        parameters = [Parameter("size", 30.0), Parameter("rate", 0.05, lower=0.05), Parameter("floor", 0.0)]
        fit = least_squares(decay(y), parameters)
        assert fit.verdict == "converged"
        assert fit.value("rate") == pytest.approx(1 / 0.7, rel=1e-4)

    def test_never_evaluates_outside_the_limits(self):
        def rooted(p):
            assert np.real(p[0]) >= 0.0
            return 1e2 * (0.1 - np.sqrt(p[0]) * X)

        assert least_squares(rooted, [Parameter("a", 0.5, lower=0.0)]).verdict in {"converged", "at-limit"}


class TestRefusals:
    @pytest.mark.parametrize(
        ("parameters", "words"),
        [
            ([Parameter("a", 0.0), Parameter("a", 0.0)], "share a name"),
            ([Parameter("a", 2.0, upper=1.0), Parameter("b", 0.0)], "outside"),
            ([Parameter("a", np.inf), Parameter("b", 0.0)], "not finite"),
            ([Parameter("a", 0.0, prior=Prior(0.0, 0.0)), Parameter("b", 0.0)], "sigma 0"),
        ],
    )
    def test_says_what_is_wrong_with_the_question(self, parameters, words):
        with pytest.raises(ProcedureError, match=words):
            least_squares(line(X), parameters)

    def test_an_unknown_name_lists_the_known(self):
        with pytest.raises(ProcedureError, match="offset, slope"):
            least_squares(line(X), LINE).value("gain")

    def test_a_derivative_that_is_not_finite_names_its_parameter(self):
        def jacobian(p):
            return np.stack([np.ones_like(X), np.full_like(X, np.nan)], axis=1)

        with pytest.raises(ProcedureError, match="slope"):
            least_squares(line(X), LINE, jacobian=jacobian)


def test_importing_the_fits_does_not_import_scipy():
    code = "import sys, rigctl.analysis, rigctl.analysis; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=".").returncode == 0


def test_a_derivative_whose_square_overflows_is_a_column_like_others() -> None:
    """Steep beyond 1e154 per unit: the fit ends where it should, and nothing is warned of."""
    x = np.linspace(1.0, 2.0, 8)
    parameters = [Parameter("steep", start=0.9e-200), Parameter("level", start=0.0)]
    slopes = np.column_stack([1e200 * x, np.ones(8)])
    found = least_squares(lambda p: 3.0 + x - slopes @ p, parameters, jacobian=lambda _: slopes)
    assert found.verdict == "converged"
    np.testing.assert_allclose(found.values, [1e-200, 3.0], rtol=1e-9)


class TestManyParameters:
    """From `MANY_NUMBERS` on the Gram matrix is decomposed where it is accurate."""

    @staticmethod
    def problem(spoilt=0.0, columns=80):
        rng = np.random.default_rng(8)
        design = rng.normal(size=(400, columns))
        # One column as good as the sum of two others.
        design[:, -1] = spoilt * (design[:, 0] + design[:, 1]) + (1.0 - spoilt) * design[:, -1]
        design *= 10.0 ** rng.uniform(-6.0, 6.0, columns)
        y = design @ (rng.normal(size=columns) / np.linalg.norm(design, axis=0)) + 0.1 * rng.normal(size=400)
        names = [Parameter(f"p{number}", 0.0) for number in range(columns)]
        return design, y, least_squares(lambda p: y - design @ p, names, jacobian=lambda _: design)

    def test_is_the_textbook_solution(self):
        design, y, fit = self.problem()
        scale = np.linalg.norm(design, axis=0)
        expected = np.linalg.lstsq(design / scale, y, rcond=None)[0] / scale
        np.testing.assert_allclose(fit.values, expected, atol=1e-9 * np.abs(expected * scale).max() / scale.max())
        root = np.linalg.inv(np.linalg.qr(design / scale)[1])
        np.testing.assert_allclose(fit.covariance, root @ root.T / np.outer(scale, scale), rtol=1e-9)
        assert fit.verdict == "converged"
        assert fit.dof == 320

    def test_columns_that_are_nearly_alike_are_fitted_all_the_same(self):
        design, y, fit = self.problem(spoilt=1.0 - 1e-6)
        scale = np.linalg.norm(design, axis=0)
        left = y - design / scale @ np.linalg.lstsq(design / scale, y, rcond=None)[0]
        assert fit.verdict == "converged"
        assert fit.chi2 == pytest.approx(left @ left, rel=1e-9)

    def test_columns_that_are_alike_are_named(self):
        _, _, fit = self.problem(spoilt=1.0)
        assert fit.verdict == "ill-conditioned"
        assert np.flatnonzero(np.isnan(fit.values)).tolist() == [0, 1, 79]
        assert "p79" in fit.reason
