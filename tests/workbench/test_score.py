"""A score is what adding the candidate and fitting everything again would bring."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.score import (
    Projector,
    contained,
    corrected,
    likeness,
    p_of,
    smallest_p,
)
from rigctl.workbench.verdict.trials import Family, trials, trials_of


def known(rows: int) -> FloatArray:
    return np.full(rows, np.inf)


def chi2(design: FloatArray, z: FloatArray) -> float:
    values, *_ = np.linalg.lstsq(design, z, rcond=None)
    return float(np.sum((z - design @ values) ** 2))


@given(seed=st.integers(0, 10**6), fitted=st.integers(1, 6), d=st.integers(1, 3), scale=st.floats(1e-6, 1e6))
@settings(max_examples=60, deadline=None)
def test_the_statistic_is_the_fall_of_chi_square_after_fitting_everything_again(
    seed: int, fitted: int, d: int, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    design, columns, z = rng.standard_normal((30, fitted)), rng.standard_normal((30, d)), rng.standard_normal(30)
    before, after = chi2(design, z), chi2(np.hstack([design, columns]), z)
    values, *_ = np.linalg.lstsq(np.hstack([design, columns]), z, rcond=None)
    gram = np.linalg.inv(np.hstack([design, columns]).T @ np.hstack([design, columns]))
    score = Projector(design, z, known(30), 30).score(scale * columns)
    assert score.statistic == pytest.approx(before - after, rel=1e-8, abs=1e-9)
    assert score.dimension == d
    np.testing.assert_allclose(score.estimate * scale, values[fitted:], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(score.sigma * scale, np.sqrt(np.diag(gram))[fitted:], rtol=1e-6)
    assert score.p_value == pytest.approx(stats.chi2.sf(score.statistic, d), rel=1e-9)


def test_an_absorbed_column_is_told_nothing_of() -> None:
    rng = np.random.default_rng(1)
    design, z = rng.standard_normal((30, 3)), rng.standard_normal(30)
    projector = Projector(design, z, known(30), 30)
    score = projector.score(design @ np.array([[1.0], [2.0], [-1.0]]))
    assert (score.statistic, score.dimension, score.p_value) == (0.0, 0, 1.0)
    assert score.keep == pytest.approx([0.0], abs=1e-12)
    assert score.estimate == pytest.approx([0.0], abs=0.0)
    assert np.isinf(score.sigma).all()
    assert score.basis.shape == (30, 0)


def test_an_absorbed_parameter_leaves_the_effects_others_to_be_told() -> None:
    rng = np.random.default_rng(2)
    design, z, own = rng.standard_normal((30, 3)), rng.standard_normal(30), rng.standard_normal((30, 1))
    projector = Projector(design, z, known(30), 30)
    score, alone = projector.score(np.hstack([design[:, :1], own])), projector.score(own)
    assert score.keep[0] < 1e-9
    assert (score.estimate[0], score.sigma[0]) == (0.0, np.inf)
    assert score.statistic == pytest.approx(alone.statistic)
    assert score.estimate[1] == pytest.approx(alone.estimate[0])
    assert score.sigma[1] == pytest.approx(alone.sigma[0])
    assert score.dimension == 1


@pytest.mark.parametrize("share", [0.003, 0.03, 0.5])
def test_what_is_kept_is_the_share_that_no_fitted_parameter_imitates(share: float) -> None:
    axes = np.eye(10)
    projector = Projector(axes[:, :2], np.ones(10), known(10), 10)
    column = np.sqrt(1.0 - share**2) * axes[:, 0] + share * axes[:, 5]
    score = projector.score(7.0 * column[:, None])
    assert score.keep == pytest.approx([share])
    assert score.dimension == (share > 0.01)


def test_parameters_that_do_the_same_count_once() -> None:
    rng = np.random.default_rng(3)
    column, z = rng.standard_normal((30, 1)), rng.standard_normal(30)
    score = Projector(np.ones((30, 1)), z, known(30), 30).score(np.hstack([column, column]))
    assert score.dimension == 1
    assert score.statistic == pytest.approx(Projector(np.ones((30, 1)), z, known(30), 30).score(column).statistic)


def test_a_column_of_zeros_is_absorbed() -> None:
    score = Projector(np.ones((9, 1)), np.arange(9.0), known(9), 9).score(np.zeros((9, 1)))
    assert (score.dimension, score.p_value) == (0, 1.0)


def test_the_residuals_left_are_those_no_parameter_can_lower() -> None:
    design, z = np.ones((9, 1)), np.arange(9.0)
    np.testing.assert_allclose(Projector(design, z, known(9), 9).left, z - 4.0)


def test_degrees_of_freedom_follow_where_the_candidate_is_seen() -> None:
    dof = np.concatenate([np.full(10, 8.0), np.full(10, 40.0), np.full(10, np.inf)])
    projector = Projector(np.zeros((31, 0)), np.zeros(31), dof, 30)

    def of(*shares: float) -> float:
        column = np.repeat(np.sqrt(shares), 10)[:, None]
        return projector.dof_of(np.vstack([column / np.linalg.norm(column), [[0.0]]]))

    assert of(1.0, 0.0, 0.0) == pytest.approx(8.0)
    assert of(0.0, 1.0, 0.0) == pytest.approx(40.0)
    assert of(0.0, 0.0, 1.0) == np.inf
    assert of(1.0, 1.0, 0.0) == pytest.approx(1.0 / (0.25 / 8.0 + 0.25 / 40.0))
    assert of(1.0, 0.0, 1.0) == pytest.approx(32.0)
    assert projector.dof_of(np.eye(31)[:, :2]) == pytest.approx(8.0)


def test_p_values_are_fs_where_the_noise_is_estimated_and_chi_squares_where_it_is_known() -> None:
    assert p_of(9.0, 2, np.inf) == pytest.approx(stats.chi2.sf(9.0, 2))
    assert p_of(9.0, 2, 12.0) == pytest.approx(stats.f.sf(4.5, 2, 12.0))
    assert p_of(9.0, 2, 1e8) == pytest.approx(stats.chi2.sf(9.0, 2), rel=1e-4)
    assert p_of(9.0, 1, 5.0) > p_of(9.0, 1, 50.0) > p_of(9.0, 1, np.inf)


def bases(columns: FloatArray) -> list[FloatArray]:
    return [columns[:, [i]] / np.linalg.norm(columns[:, i]) for i in range(columns.shape[1])]


def count_of(tried: list[FloatArray], rows: int, seed: int) -> float:
    """Trials of one family."""
    return trials({"": Family(tried)}, rows, seed).of("")


def test_identical_candidates_are_one_trial() -> None:
    column = np.random.default_rng(1).standard_normal((40, 1))
    found = count_of(bases(np.repeat(column, 12, axis=1)), 40, 2)
    # The 2 % quantile of 2000 draws is itself known to 16 %.
    assert found == pytest.approx(1.0, abs=0.6)
    assert found >= 1.0


@pytest.mark.parametrize("count", [4, 12, 30])
def test_orthogonal_candidates_are_so_many_trials(count: int) -> None:
    found = np.mean([count_of(bases(np.eye(count)), count, seed) for seed in range(10)])
    # Ten such quantiles: 5 %.
    assert found == pytest.approx(count, rel=4 * 0.05)


@pytest.mark.parametrize("likeness_of_pairs", [0.3, 0.9])
def test_correlated_candidates_are_between_one_trial_and_all(likeness_of_pairs: float) -> None:
    common = np.sqrt(likeness_of_pairs)
    columns = common * np.eye(21)[:, [20]] + np.sqrt(1.0 - likeness_of_pairs) * np.eye(21)[:, :20]
    found = np.mean([count_of(bases(columns), 21, seed) for seed in range(5)])
    assert 1.0 < found < 20.0


def test_a_corrected_p_value_is_uniform_under_the_null() -> None:
    columns = np.random.default_rng(1).standard_normal((25, 15))
    n_eff = count_of(bases(columns), 25, 2)
    draws = np.random.default_rng(3).standard_normal((20000, 25))
    statistics = np.stack([(draws @ basis[:, 0]) ** 2 for basis in bases(columns)], axis=1)
    smallest = smallest_p(statistics, np.ones(15, dtype=np.intp))
    found = np.mean([corrected(p, n_eff) < 0.02 for p in smallest])
    # The level itself is matched to 16 %, the count of alarms to 5 %.
    assert found == pytest.approx(0.02, rel=4 * 0.17)


def test_a_family_pays_for_its_own_trials_and_for_the_number_of_families() -> None:
    """Forty trials in one family beside one in another: two portions, so that the one is corrected for two."""
    tried = bases(np.eye(41))
    found = [trials({"one": Family(tried[:1]), "many": Family(tried[1:])}, 41, seed) for seed in range(10)]
    # Ten counts, each of two quantiles: 7 %.
    assert np.mean([each.of("one") for each in found]) == pytest.approx(2.0, rel=4 * 0.07)
    assert np.mean([each.of("many") for each in found]) == pytest.approx(80.0, rel=4 * 0.07)
    assert np.mean([each.all for each in found]) == pytest.approx(41.0, rel=4 * 0.05)


def test_families_together_keep_the_level() -> None:
    """The smallest of all corrected p-values of correlated families is below 2 % in 2 % of draws of noise."""
    columns = np.random.default_rng(1).standard_normal((25, 30))
    families = {"few": slice(0, 3), "more": slice(3, 12), "most": slice(12, 30)}
    found = trials({name: Family(bases(columns)[where]) for name, where in families.items()}, 25, 2)
    draws = np.random.default_rng(3).standard_normal((20000, 25))
    statistics = np.stack([(draws @ basis[:, 0]) ** 2 for basis in bases(columns)], axis=1)
    alarms = np.zeros(len(draws), dtype=bool)
    for name, where in families.items():
        smallest = smallest_p(statistics[:, where], np.ones(statistics[:, where].shape[1], dtype=np.intp))
        alarms |= np.array([corrected(p, found.of(name)) < 0.02 for p in smallest])
    # As above; twice, for families are counted too.
    assert np.mean(alarms) == pytest.approx(0.02, rel=4 * 0.17 * np.sqrt(2.0))


def test_the_smallest_p_is_that_of_chi_square_in_each_dimension() -> None:
    statistics = np.array([[1.0, 30.0, 2.0, 4.0], [9.0, 800.0, 2.0, 30.0], [-1e-9, 0.0, 0.0, 0.0]])
    dimensions = np.array([1, 0, 1, 3])
    found = smallest_p(statistics, dimensions)
    of_one, of_three = stats.chi2(1).sf(statistics[:, [0, 2]]).min(axis=1), stats.chi2(3).sf(statistics[:, 3])
    # What has no dimensions (the second) is no trial.
    np.testing.assert_allclose(found, np.minimum(of_one, of_three), rtol=1e-12)


def test_without_anything_to_try_there_is_one_trial() -> None:
    assert trials({}, 9, 1).of("") == trials({}, 9, 1).all == 1.0
    assert count_of([np.zeros((9, 0))], 9, 1) == 1.0
    assert trials_of(np.ones(100)) == 1.0


def test_correction_keeps_small_p_values_exact_and_large_ones_below_one() -> None:
    assert corrected(1e-30, 50.0) == pytest.approx(5e-29)
    assert corrected(1.0, 50.0) == pytest.approx(1.0)
    assert corrected(0.02, 1.0) == pytest.approx(0.02)


def plane(*angles_deg: float) -> FloatArray:
    """Unit vectors, each turned by an angle in a plane of its own."""
    found = np.zeros((2 * len(angles_deg), len(angles_deg)))
    for i, angle in enumerate(np.radians(angles_deg)):
        found[2 * i : 2 * i + 2, i] = np.cos(angle), np.sin(angle)
    return found


def test_likeness_is_the_smallest_angle_and_containment_the_largest() -> None:
    assert likeness(plane(0.0, 0.0), plane(20.0, 70.0)) == pytest.approx(np.cos(np.radians(20.0)))
    assert contained(plane(0.0, 0.0), plane(20.0, 70.0)) == pytest.approx(np.cos(np.radians(70.0)))
    assert contained(plane(0.0, 0.0)[:, :1], plane(20.0, 70.0)) == pytest.approx(np.cos(np.radians(20.0)))
    assert contained(plane(0.0, 0.0), plane(0.0, 0.0)[:, :1]) == 0.0
    assert likeness(np.zeros((4, 0)), plane(0.0, 0.0)) == 0.0
    assert contained(np.zeros((4, 0)), plane(0.0, 0.0)) == 0.0


def test_rows_of_priors_count_as_data_but_have_no_noise_of_their_own() -> None:
    """A prior's row holds a parameter back: what it absorbs without the prior is seen with it."""
    column = np.ones((10, 1))
    loose = Projector(np.vstack([column, [[0.0]]]), np.ones(11), known(10), 10)
    held = Projector(np.vstack([column, [[100.0]]]), np.ones(11), known(10), 10)
    candidate = np.vstack([column, [[0.0]]])
    assert loose.score(candidate).dimension == 0
    assert held.score(candidate).keep == pytest.approx([100.0 / np.hypot(100.0, np.sqrt(10.0))])


def test_statistics_of_many_candidates_are_those_of_each_alone() -> None:
    rng = np.random.default_rng(5)
    design, z = rng.standard_normal((200, 4)), rng.standard_normal(200)
    projector = Projector(design, z, known(200), 200)
    twice = rng.standard_normal((200, 1))
    candidates = [
        rng.standard_normal((200, 3)) * [1.0, 1e-6, 1e9],
        # Absorbed by what is fitted, the same column twice, nothing at all.
        design[:, :2] @ rng.standard_normal((2, 2)),
        np.hstack([twice, -2.0 * twice]),
        np.zeros((200, 2)),
    ]
    told = projector.statistics(np.hstack(candidates), [each.shape[1] for each in candidates])
    for (statistic, dimension), score in zip(told, map(projector.score, candidates), strict=True):
        assert dimension == score.dimension
        assert statistic == pytest.approx(score.statistic, rel=1e-9)
    assert [dimension for _, dimension in told] == [3, 0, 1, 0]
    for alone, together in zip(map(projector.score, candidates), projector.scores(candidates), strict=True):
        assert together.statistic == pytest.approx(alone.statistic, rel=1e-12)
        np.testing.assert_allclose(together.sigma, alone.sigma, rtol=1e-9)
