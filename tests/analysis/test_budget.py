import numpy as np
import pytest
from scipy import stats

from rigctl.analysis.budget import Contribution, budget, compare, monte_carlo
from rigctl.core.errors import ProcedureError

GAIN = Contribution("gain", 100.0, 0.5, "V/(m/s2)", "B", source="certificate")
SIGNAL = Contribution("signal", 2.0, 0.02, "V", "A", dof=9, source="ten readings")
OFFSET = Contribution("offset", 0.0, 0.01, "V", "B", "rectangular", source="level")


def linear(v):
    return np.array([2.0 * v["gain"] + 3.0 * v["signal"], v["signal"] - 4.0 * v["offset"]])


def only(*names):
    return [Contribution(name, 0.0, u, "1", "A", dof=dof) for name, u, dof in names]


class TestLinear:
    def test_is_exact(self):
        found = budget(linear, [GAIN, SIGNAL, OFFSET], ["a", "b"])
        np.testing.assert_allclose(found.values, [206.0, 2.0])
        np.testing.assert_allclose(found.sensitivities, [[2, 3, 0], [0, 1, -4]], atol=1e-11)
        np.testing.assert_allclose(found.standard_uncertainty, [np.hypot(1.0, 0.06), np.hypot(0.02, 0.04)])
        np.testing.assert_allclose(found.share[1], [0.0, 0.2, 0.8], atol=1e-12)
        np.testing.assert_allclose(found.share.sum(axis=1), 1.0)

    def test_effective_dof_and_coverage_are_welch_satterthwaite(self):
        found = budget(lambda v: np.array([v["p"] + v["q"]]), only(("p", 3.0, 4), ("q", 4.0, 10)), ["sum"])
        dof = 5.0**4 / (3.0**4 / 4 + 4.0**4 / 10)
        np.testing.assert_allclose(found.effective_dof, dof)
        np.testing.assert_allclose(found.coverage_factor, stats.t.ppf(0.975, np.floor(dof)))
        np.testing.assert_allclose(found.expanded, 5.0 * stats.t.ppf(0.975, np.floor(dof)))

    def test_known_variances_cover_like_a_normal(self):
        found = budget(linear, [GAIN, OFFSET, Contribution("signal", 2.0, 0.02, "V")], ["a", "b"])
        assert np.isinf(found.effective_dof).all()
        np.testing.assert_allclose(found.coverage_factor, 1.959964, rtol=1e-5)

    def test_a_whole_dof_is_not_truncated_by_rounding(self):
        found = budget(lambda v: np.array([v["p"]]), only(("p", 0.1, 9)), ["p"])
        np.testing.assert_allclose(found.coverage_factor, stats.t.ppf(0.975, 9))

    def test_a_contribution_known_exactly_keeps_its_sensitivity(self):
        found = budget(linear, [GAIN, Contribution("signal", 2.0, 0.0, "V"), OFFSET], ["a", "b"])
        np.testing.assert_allclose(found.sensitivities[:, 1], [3.0, 1.0], rtol=1e-6)
        assert found.share[0, 1] == 0.0


class TestMonteCarlo:
    def test_agrees_with_the_first_order_where_that_is_enough(self):
        def ratio(v):
            return np.array([v["signal"] / v["gain"], np.sin(v["signal"])])

        inputs = [GAIN, Contribution("signal", 1.0, 0.01, "V")]
        first, check = budget(ratio, inputs, ["a", "s"]), monte_carlo(ratio, inputs, ["a", "s"], draws=4000, seed=1)
        spread, mean = check.samples.std(axis=0), check.samples.mean(axis=0)
        np.testing.assert_allclose(spread, first.standard_uncertainty, rtol=4 / np.sqrt(2 * 4000))
        np.testing.assert_allclose(mean, first.values, atol=4 * first.standard_uncertainty.max() / np.sqrt(4000))
        verdict = compare(first, check, significant_digits=1)
        assert verdict.validated == (True, True)
        assert verdict.reason == "the first order agrees with Monte Carlo"

    def test_unmasks_a_square_at_its_vertex(self):
        inputs = [Contribution("x", 0.0, 0.1, "1"), Contribution("y", 1.0, 0.1, "1")]

        def mixed(v):
            return np.array([v["x"] ** 2 + 1e-3 * v["y"], v["y"]])

        first = budget(mixed, inputs, ["square", "line"])
        check = monte_carlo(mixed, inputs, ["square", "line"], draws=4000, seed=2)
        verdict = compare(first, check, significant_digits=1)
        assert verdict.validated == (False, True)
        assert "square" in verdict.reason
        assert check.samples[:, 0].std() == pytest.approx(np.sqrt(2) * 0.01, rel=0.1)

    def test_draws_rectangles_within_their_limits(self):
        flat = Contribution.from_limits("x", 5.0, 0.3, "mm", source="resolution")
        assert flat.standard_uncertainty == pytest.approx(0.3 / np.sqrt(3.0))
        check = monte_carlo(lambda v: np.array([v["x"]]), [flat], ["x"], draws=4000, seed=3)
        assert stats.kstest(check.samples[:, 0], stats.uniform(4.7, 0.6).cdf).pvalue > 0.01
        np.testing.assert_allclose(check.interval, [[4.715, 5.285]], atol=0.01)

    def test_a_rectangle_alone_is_not_covered_like_a_normal(self):
        flat = [Contribution.from_limits("x", 5.0, 0.3, "mm", source="resolution")]
        first = budget(lambda v: np.array([v["x"]]), flat, ["x"])
        check = monte_carlo(lambda v: np.array([v["x"]]), flat, ["x"], draws=4000, seed=4)
        assert compare(first, check).validated == (False,)

    def test_draws_student_t_and_the_budget_covers_it(self):
        few = [Contribution("x", 1.0, 0.2, "V", "A", "t", dof=5, source="six readings")]
        first = budget(lambda v: np.array([v["x"]]), few, ["x"])
        check = monte_carlo(lambda v: np.array([v["x"]]), few, ["x"], draws=8000, seed=5)
        assert stats.kstest((check.samples[:, 0] - 1.0) / 0.2, stats.t(5).cdf).pvalue > 0.01
        assert compare(first, check).validated == (True,)

    def test_all_draws_together_are_those_one_by_one(self):
        inputs, outputs = [GAIN, SIGNAL, OFFSET], ["a", "b"]
        each = monte_carlo(linear, inputs, outputs, draws=50, seed=7).samples
        asked = []

        def together(values):
            asked.append(len(values["gain"]))
            return linear(values).T

        at_once = monte_carlo(together, inputs, outputs, draws=50, seed=7, together=True).samples
        np.testing.assert_array_equal(at_once, each)
        assert asked == [50]
        with pytest.raises(ProcedureError, match="no finite b at one of the draws"):
            monte_carlo(
                lambda v: np.stack([v["gain"], v["gain"] * np.nan], axis=1),
                inputs,
                outputs,
                draws=5,
                seed=7,
                together=True,
            )

    def test_the_same_seed_gives_the_same_draws(self):
        one, two, other = (
            monte_carlo(linear, [GAIN, SIGNAL, OFFSET], ["a", "b"], draws=10, seed=seed).samples for seed in (7, 7, 8)
        )
        np.testing.assert_array_equal(one, two)
        assert not np.array_equal(one, other)

    def test_outputs_keep_their_correlation(self):
        inputs = [GAIN, SIGNAL, OFFSET]
        check = monte_carlo(linear, inputs, ["a", "b"], draws=4000, seed=9)
        covariance = np.cov(check.samples, rowvar=False)
        np.testing.assert_allclose(covariance[0, 1], 0.0012, atol=4 * np.sqrt(1.0036 * 0.002 / 4000))
        np.testing.assert_allclose(np.diag(covariance), [1.0036, 0.002], rtol=0.1)


class TestRefusals:
    @pytest.mark.parametrize(
        ("contributions", "words"),
        [
            ([], "needs contributions"),
            ([GAIN, GAIN], "its own name"),
            ([Contribution("x", 1.0, -1.0, "V")], "contribution x"),
            ([Contribution("x", np.nan, 1.0, "V")], "contribution x"),
            ([Contribution("x", 1.0, 1.0, "V", distribution="t")], "degrees of freedom"),
        ],
    )
    def test_names_a_contribution_that_makes_no_sense(self, contributions, words):
        with pytest.raises(ProcedureError, match=words):
            budget(lambda v: np.zeros(1), contributions, ["a"])

    def test_names_an_output_that_is_not_finite(self):
        with pytest.raises(ProcedureError, match="finite b"):
            budget(lambda v: np.array([1.0, np.nan]), [GAIN], ["a", "b"])
        with pytest.raises(ProcedureError, match="1 outputs"):
            budget(lambda v: np.array([1.0, 2.0]), [GAIN], ["a"])
