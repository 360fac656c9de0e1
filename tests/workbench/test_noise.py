"""The noise is told by the scatter, whatever signals hide in it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.study import NoisePool, Observations, Series, SharedOffset
from rigctl.workbench.verdict.noise import Correlation, Noise, orthonormal
from rigctl.workbench.verdict.noise_estimate import NoiseEstimator
from rigctl.workbench.verdict.offsets import without_offsets
from rigctl.workbench.verdict.pool_order import pool_orders
from rigctl.workbench.verdict.saturated import Hidden, above_rounding, rounding_of, saturated

MINUTE = 60.0


def readings(
    count: int = 120, dof: float = 0.0, order: str | None = "start_s", sigma: float = 1.0, groups: int = 1
) -> Observations:
    """One reading a minute of one channel; noise from the scatter unless `dof` are given."""
    runs = np.arange(count)
    zero = np.zeros(count, dtype=np.intp)
    return Observations(
        tuple(f"r{i}" for i in range(count)),
        (Series("v", "DC", "V"),),
        (NoisePool("DC", dof, order),),
        np.zeros(count),
        np.full(count, sigma),
        zero,
        runs,
        zero,
        runs % groups,
        runs * 4 // count,
        {"start_s": np.asarray(MINUTE * runs, dtype=np.float64)},
    )


def line(count: int) -> FloatArray:
    return np.stack([np.ones(count), np.linspace(-1.0, 1.0, count)], axis=1)


def nothing(_: IntArray) -> list[Hidden]:
    return []


def relaxing(rng: np.random.Generator, count: int, runs: float) -> FloatArray:
    """AR(1) noise of unit variance that forgets in so many runs."""
    kept = np.exp(-1.0 / runs)
    found = np.zeros(count)
    found[0] = rng.standard_normal()
    for i in range(1, count):
        found[i] = kept * found[i - 1] + np.sqrt(1.0 - kept**2) * rng.standard_normal()
    return found


def flicker(rng: np.random.Generator, count: int, exponent: float = 1.0) -> FloatArray:
    """Noise with a spectrum 1/f^a, of about unit variance."""
    frequency = np.fft.rfftfreq(8 * count)[1:]
    size = frequency ** (-exponent / 2.0)
    spectrum = size * (rng.standard_normal(len(size)) + 1j * rng.standard_normal(len(size)))
    found = np.fft.irfft(np.concatenate([[0.0], spectrum]))[:count]
    return np.asarray(found / found.std())


@given(seed=st.integers(0, 10**6), count=st.integers(2, 40), runs=st.floats(0.5, 50.0), columns=st.integers(0, 3))
@settings(max_examples=40, deadline=None)
def test_whitening_undoes_colouring_and_leaves_unit_covariance(
    seed: int, count: int, runs: float, columns: int
) -> None:
    rng = np.random.default_rng(seed)
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    where = np.sort(rng.permutation(2 * count)[:count])
    factor = np.asarray(np.linalg.cholesky(np.eye(count) + 3.0 * np.exp(-apart / runs)), dtype=np.float64)
    sigma = rng.uniform(0.1, 10.0, 2 * count)
    noise = Noise(sigma, np.full(2 * count, np.inf), ((where, factor),), (Correlation("exp 0", 3.0),))
    white = rng.standard_normal((2 * count, columns) if columns else 2 * count)
    np.testing.assert_allclose(noise.whiten(noise.colour(white)), white, rtol=1e-9, atol=1e-9)
    covariance = np.diag(sigma**2)
    covariance[np.ix_(where, where)] = np.outer(sigma[where], sigma[where]) * (factor @ factor.T)
    np.testing.assert_allclose(noise.whiten(noise.whiten(covariance).T), np.eye(2 * count), atol=1e-9)
    np.testing.assert_allclose(noise.total_sigma() ** 2, np.diag(covariance), rtol=1e-9)
    sums = rng.standard_normal((2 * count, 3))
    np.testing.assert_allclose(noise.variance_of(sums), sums.T @ covariance @ sums, rtol=1e-9)
    # What is white adds up to a variance of square sums of its weights.
    np.testing.assert_allclose(noise.variance_of(noise.weights_of(sums)), sums.T @ sums, rtol=1e-7, atol=1e-9)


def test_factors_that_share_data_are_undone_in_the_order_they_came() -> None:
    rng, count = np.random.default_rng(5), 12
    apart = np.abs(np.subtract.outer(np.arange(8.0), np.arange(8.0)))
    slow = np.linalg.cholesky(np.eye(8) + 2.0 * np.exp(-apart / 3.0))
    batch = np.linalg.cholesky(np.eye(6) + 0.5)
    factors = ((np.arange(6), batch), (np.arange(2, 10), slow))
    noise = Noise(rng.uniform(0.5, 2.0, count), np.full(count, np.inf), factors, ())
    white, sums = rng.standard_normal((count, 4)), rng.standard_normal((count, 2))
    np.testing.assert_allclose(noise.whiten(noise.colour(white)), white, atol=1e-10)
    np.testing.assert_allclose(noise.weights_of(sums).T @ white, sums.T @ noise.whiten(white), atol=1e-10)
    np.testing.assert_allclose(noise.variance_of(noise.weights_of(sums)), sums.T @ sums, atol=1e-10)


def test_beside_a_fit_alone_noise_is_told_by_all_that_it_leaves() -> None:
    """What might be hidden takes slow noise with it: beside the fit alone it is seen."""
    count, rng = 36, np.random.default_rng(11)
    powers = np.vander(np.linspace(-1.0, 1.0, count), 11, increasing=True)[:, 2:]
    estimator = NoiseEstimator(readings(count), line(count), lambda _: [columns(powers)])
    searched, told = [], []
    slope = np.eye(2)[:, [1]]
    for _ in range(40):
        noisy = relaxing(rng, count, 12.0) + 0.3 * rng.standard_normal(count)
        now = estimator.estimate(noisy)
        beside = estimator.beside_fit(line(count), noisy, now)
        weights = np.linalg.pinv(line(count)).T @ slope
        searched.append(now.variance_of(weights)[0, 0])
        told.append(beside.variance_of(weights)[0, 0])
    apart = MINUTE * np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    true = np.exp(-apart / (12.0 * MINUTE)) + 0.09 * np.eye(count)
    variance = float((weights.T @ true @ weights)[0, 0])
    assert np.median(searched) < 0.5 * variance
    # From some six slow degrees of freedom: known to a half in one draw, and the median of 40 to a tenth.
    assert 0.6 * variance < np.median(told) < 1.4 * variance


def test_noise_that_has_no_order_is_told_once() -> None:
    estimator = NoiseEstimator(readings(order=None), line(120), nothing)
    noisy = np.random.default_rng(2).standard_normal(120)
    now = estimator.estimate(noisy)
    assert estimator.beside_fit(line(120), noisy, now) is now


def test_the_scale_of_white_noise_comes_out_with_the_scatter_of_chi_square() -> None:
    count, fitted, sigma = 60, 2, 0.02
    estimator = NoiseEstimator(readings(count, order=None), line(count), nothing)
    rng = np.random.default_rng(1)
    found = [estimator.estimate(sigma * rng.standard_normal(count)) for _ in range(400)]
    squares = np.array([(count - fitted) * (noise.sigma[0] / sigma) ** 2 for noise in found])
    assert {float(noise.dof[0]) for noise in found} == {float(count - fitted)}
    assert stats.kstest(squares, stats.chi2(count - fitted).cdf).pvalue > 1e-3
    assert not found[0].factors


@pytest.mark.parametrize("of_these", [False, True])
def test_chi_square_is_one_a_datum_whether_these_data_or_others_told_their_sigma(of_these: bool) -> None:
    dof, rng = 12, np.random.default_rng(7)
    squares = []
    for _ in range(1500):
        data = rng.standard_normal(dof)
        others = data if of_these else rng.standard_normal(dof)
        stated = readings(dof, float(dof), order=None, sigma=float(np.sqrt(np.mean(others**2))))
        told = replace(stated, pools=(replace(stated.pools[0], of_these=of_these),))
        squares.append(np.mean((data / NoiseEstimator(told, line(dof), nothing).estimate(data).sigma) ** 2))
    assert np.mean(squares) == pytest.approx(1.0, abs=1e-9 + 4.0 * np.std(squares) / np.sqrt(len(squares)))


def test_relative_weights_keep_their_ratios() -> None:
    given = readings(80, order=None)
    weights = np.where(np.arange(80) % 2, 5.0, 1.0)
    weighted = Observations(**{**vars(given), "sigma": weights})
    estimator = NoiseEstimator(weighted, line(80), nothing)
    noise = estimator.estimate(0.3 * weights * np.random.default_rng(2).standard_normal(80))
    np.testing.assert_allclose(noise.sigma / noise.sigma[0], weights, rtol=1e-12)
    # 78 degrees of freedom: the scale is good to one in sqrt(2 * 78).
    assert noise.sigma[0] == pytest.approx(0.3, rel=4.0 / np.sqrt(2.0 * 78.0))


def columns(effects: FloatArray) -> Hidden:
    """Each an effect of its own."""
    return Hidden(effects, np.arange(effects.shape[1]))


@pytest.mark.parametrize("room", [60, 31, 21])
def test_an_effect_of_several_columns_is_projected_out_whole_or_not_at_all(room: int) -> None:
    """Which word the others are counted from, and in which order words stand, changes nothing."""
    random = np.random.default_rng(6)
    word = random.integers(0, 4, room)
    others = [random.standard_normal((room, 1)) for _ in range(4)]
    spanned = []
    for order in ([0, 1, 2, 3], [2, 0, 3, 1]):
        words = np.stack([(word == each).astype(float) for each in order[1:]], axis=1)
        slopes = words * others[0]
        basis = saturated(
            line(room), [Hidden.of([(words, True), *((each, False) for each in others), (slopes, True)], room)]
        )
        spanned.append(basis @ basis.T)
    np.testing.assert_allclose(spanned[0], spanned[1], atol=1e-9)


def test_of_effects_as_large_the_first_is_projected_out_first() -> None:
    """Rounding, and so the unit of a column, does not choose between them."""
    centred = np.random.default_rng(7).standard_normal((24, 12))
    centred -= centred.mean(axis=0)
    for scale in 10.0 ** np.random.default_rng(8).uniform(-3.0, 3.0, (20, 12)):
        basis = saturated(np.ones((24, 1)), [columns(centred * scale)])
        np.testing.assert_allclose(basis @ (basis.T @ centred[:, 0]), centred[:, 0], atol=1e-9)


@pytest.mark.parametrize("count", [9, 12, 30, 90])
def test_at_least_two_thirds_of_the_data_are_left_to_tell_the_noise(count: int) -> None:
    possible = np.random.default_rng(3).standard_normal((count, 4 * count))
    basis = saturated(line(count), [columns(possible)])
    assert count - basis.shape[1] >= min(2.0 * count / 3.0, count - 2)
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-9)
    np.testing.assert_allclose(basis @ (basis.T @ line(count)), line(count), atol=1e-9)


def test_rounding_takes_no_place() -> None:
    """A derivative by differences is hardly ever zero where it should be."""
    derivatives = np.random.default_rng(5).standard_normal((60, 3))
    derivatives[:20, 1] *= 1e-10
    derivatives[:20, 2] *= 1e-3
    np.testing.assert_array_equal(above_rounding(derivatives, np.arange(20), np.ones(60)), [True, False, True])


def test_everything_possible_is_projected_out_when_there_is_room() -> None:
    possible = np.random.default_rng(4).standard_normal((60, 10))
    basis = saturated(line(60), [columns(possible), columns(possible @ np.ones((10, 1))), columns(np.zeros((60, 1)))])
    assert basis.shape[1] == 12
    np.testing.assert_allclose(basis @ (basis.T @ possible), possible, atol=1e-9)


def test_an_effect_that_hides_in_the_data_does_not_inflate_the_noise() -> None:
    given, rng = readings(90), np.random.default_rng(5)
    hidden = np.sin(np.arange(90) / 9.0)[:, None]
    white = rng.standard_normal(90)
    aware = NoiseEstimator(given, line(90), lambda where: [columns(hidden[where])])
    with_effect, without = aware.estimate(white + 50.0 * hidden[:, 0]), aware.estimate(white)
    np.testing.assert_allclose(with_effect.total_sigma(), without.total_sigma(), rtol=1e-9)
    assert with_effect.correlations == without.correlations
    unaware = NoiseEstimator(given, line(90), nothing).estimate(white + 50.0 * hidden[:, 0])
    assert unaware.total_sigma().mean() > 5.0 * without.total_sigma().mean()


def test_correlated_noise_is_found_and_whitened() -> None:
    count, rng = 120, np.random.default_rng(6)
    estimator = NoiseEstimator(readings(count), line(count), nothing)
    for coloured in ([relaxing(rng, count, 20.0) for _ in range(12)], [flicker(rng, count, 1.64) for _ in range(12)]):
        between = []
        for each in coloured:
            noisy = 3.0 * each + 0.3 * rng.standard_normal(count)
            noise = estimator.estimate(noisy)
            assert noise.factors
            assert noise.correlations[0].kernel
            white = noise.whiten(noisy - noisy.mean())
            between.append(np.corrcoef(white[1:], white[:-1])[0, 1])
            assert np.corrcoef(noisy[1:], noisy[:-1])[0, 1] > 0.5
        # Each has a standard error of 1 / sqrt(count); a family of kernels leaves a little.
        assert abs(np.mean(between)) < 4.0 / np.sqrt(12 * count) + 0.05


def test_white_noise_is_seldom_taken_for_correlated(at_least: Any) -> None:
    """The prior weighs white as all others together: the best of them wins by likelihood alone."""
    count, rng = 100, np.random.default_rng(7)
    estimator = NoiseEstimator(readings(count), line(count), nothing)
    white = sum(not estimator.estimate(rng.standard_normal(count)).correlations[0].kernel for _ in range(60))
    assert at_least(white, 60, 0.9)


def test_noise_of_two_sensors_is_correlated_within_each_only() -> None:
    count = 80
    estimator = NoiseEstimator(readings(count, groups=2), line(count), nothing)
    rng, noisy = np.random.default_rng(8), np.zeros(count)
    noisy[0::2], noisy[1::2] = 5.0 * relaxing(rng, 40, 15.0), 5.0 * relaxing(rng, 40, 15.0)
    noise = estimator.estimate(noisy + 0.2 * rng.standard_normal(count))
    assert [set(where % 2) for where, _ in noise.factors] == [{0}, {1}]


def test_what_is_not_in_any_order_is_white() -> None:
    noisy = 5.0 * relaxing(np.random.default_rng(9), 80, 30.0)
    estimator = NoiseEstimator(readings(80, order=None), line(80), nothing)
    assert not estimator.correlated
    assert not estimator.estimate(noisy).factors


def test_unknown_times_leave_the_noise_white() -> None:
    given = readings(40)
    lost = np.where(np.arange(40) == 7, np.nan, given.covariates["start_s"])
    estimator = NoiseEstimator(Observations(**{**vars(given), "covariates": {"start_s": lost}}), line(40), nothing)
    assert not estimator.correlated
    assert np.isfinite(estimator.estimate(np.random.default_rng(1).standard_normal(40)).sigma).all()


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9])
def test_a_pool_of_few_data_has_some_noise(count: int) -> None:
    estimator = NoiseEstimator(
        readings(count), line(count)[:, : min(count, 2)], lambda where: [columns(np.eye(count)[where])]
    )
    noise = estimator.estimate(np.random.default_rng(1).standard_normal(count))
    assert np.isfinite(noise.sigma).all()
    assert (noise.sigma > 0.0).all()
    assert (noise.dof >= 1.0).all()


def test_known_sigmas_stay_but_for_what_their_few_degrees_of_freedom_add() -> None:
    estimator = NoiseEstimator(readings(50, dof=10.0, sigma=0.4), line(50), nothing)
    assert not estimator.from_scatter
    noise = estimator.estimate(100.0 * np.ones(50))
    np.testing.assert_allclose(noise.sigma, 0.4 * np.sqrt(10.0 / 8.0))
    np.testing.assert_allclose(noise.dof, 10.0)


def test_a_column_that_is_no_number_is_in_no_basis() -> None:
    columns = np.array([[1.0, np.nan], [2.0, 3.0], [0.0, 1.0]])
    np.testing.assert_allclose(orthonormal(columns, 1e-9), orthonormal(columns[:, :1], 1e-9))


def test_an_orthonormal_basis_has_the_rank_of_its_columns_whatever_their_units() -> None:
    columns = np.random.default_rng(1).standard_normal((20, 3)) * np.array([1e-9, 1.0, 1e9])
    basis = orthonormal(np.hstack([columns, columns[:, :1] * 7.0, np.zeros((20, 1))]), 1e-9)
    assert basis.shape == (20, 3)
    residual = columns - basis @ (basis.T @ columns)
    assert (np.linalg.norm(residual, axis=0) < 1e-9 * np.linalg.norm(columns, axis=0)).all()
    assert orthonormal(np.zeros((5, 2)), 1e-9).shape == (5, 0)


def test_what_is_left_of_batches_is_less_their_offsets_as_best_predicted() -> None:
    """By the textbook: u = G Z' V^-1 r, of two crossed kinds of batches and of uncertainties that differ."""
    rng = np.random.default_rng(3)
    one, other = np.arange(24) // 6, np.arange(24) % 4
    sigma, residuals = rng.uniform(0.5, 2.0, 24), rng.standard_normal(24)
    together = 0.36 * np.equal.outer(one, one) + 0.25 * np.equal.outer(other, other)
    correlation = together + 0.39 * np.eye(24)
    batches = replace(
        readings(24),
        sigma=sigma,
        factors=((np.arange(24), np.linalg.cholesky(correlation)),),
        offsets=(SharedOffset("one", one, 0.6), SharedOffset("other", other, 0.5)),
    )
    covariance = np.outer(sigma, sigma)
    offsets = (covariance * together) @ np.linalg.solve(covariance * correlation, residuals)
    assert without_offsets(batches, residuals) == pytest.approx(residuals - offsets, abs=1e-12)
    assert without_offsets(readings(24), residuals) is residuals


@pytest.mark.parametrize("count", [24, 450])
def test_noise_that_is_slow_beside_shared_offsets_is_slow_in_the_data_themselves(count: int) -> None:
    """It takes the place of a part of what is each datum's own, by what it scatters; offsets stay beside it."""
    rng = np.random.default_rng(count)
    lot, sigma = rng.integers(0, 6, count), rng.uniform(0.5, 2.0, count)
    shared = 0.36 * np.equal.outer(lot, lot)
    triangle = np.linalg.cholesky(shared + 0.64 * np.eye(count))
    given = replace(
        readings(count),
        sigma=sigma,
        factors=((np.arange(count), triangle),),
        offsets=(SharedOffset("lot", lot, 0.6),),
    )
    order, ratio = pool_orders(given)[0], 2.0
    at = given.covariates["start_s"]
    kernel = np.exp(-np.abs(np.subtract.outer(at, at)) / 600.0)
    scatter = 1.0 - kernel.mean()
    slow = order.factors((("exp 600.0", order.strength("exp 600.0", ratio)),))
    noise = Noise(sigma, np.full(count, np.inf), (*given.factors, *slow), ())
    own = 0.64 * (np.eye(count) + ratio * kernel) / (1.0 + ratio * scatter)
    expected = np.outer(sigma, sigma) * (shared + own)
    np.testing.assert_allclose(noise.variance_of(np.eye(count)), expected, rtol=1e-9, atol=1e-12)
    # What the laws are told from is the same noise.
    apart = np.linalg.solve(triangle, np.linalg.solve(triangle, shared + own).T)
    for each in order.looked_at(5):
        strength, vectors = order.decomposed("exp 600.0", each)
        told = (vectors * (1.0 + order.strength("exp 600.0", ratio) * strength)) @ vectors.T
        np.testing.assert_allclose(told, each.of(each.of(apart).T), atol=1e-9)


def test_columns_that_concern_a_few_groups_are_whitened_as_all_are() -> None:
    rng = np.random.default_rng(3)
    groups = [rng.permutation(60)[:20] for _ in range(2)]
    roots = [np.linalg.cholesky(np.eye(20) + 0.5 * np.exp(-np.abs(np.subtract.outer(range(20), range(20)))))] * 2
    noise = Noise(rng.uniform(1.0, 2.0, 60), np.full(60, np.inf), tuple(zip(groups, roots, strict=True)), ())
    columns = rng.standard_normal((60, 6))
    columns[groups[0], :4] = columns[groups[1], 2:5] = 0.0
    one_by_one = np.stack([noise.whiten(column) for column in columns.T], axis=1)
    np.testing.assert_allclose(noise.whiten(columns), one_by_one, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(noise.colour(noise.whiten(columns)), columns, atol=1e-12)


@pytest.mark.parametrize(("known_to", "directions"), [(1e-4, 2), (1e-8, 3)])
def test_what_differs_from_other_columns_by_its_rounding_only_is_no_direction(
    known_to: float, directions: int
) -> None:
    """A derivative by differences of which these data see a small part: the rest of it is rounding."""
    rng, fitted = np.random.default_rng(6), line(40)
    third = fitted @ [0.3, 0.7] + 1e-6 * rng.standard_normal(40)
    basis = saturated(np.column_stack([third, fitted]), [], np.array([known_to, 1e-9, 1e-9]))
    assert basis.shape == (40, directions)
    np.testing.assert_allclose(basis.T @ basis, np.eye(directions), atol=1e-12)
    np.testing.assert_allclose(basis @ (basis.T @ fitted), fitted, atol=1e-12)


def test_of_a_column_of_which_data_see_a_small_part_they_know_little() -> None:
    derivatives = np.ones((60, 3))
    derivatives[:20, 1], derivatives[:20, 2] = 1e-4, 0.0
    rounding = rounding_of(derivatives, np.arange(20), np.ones(60))
    # Of 60 rows of which 20 are seen.
    np.testing.assert_allclose(rounding[:2], 1e-9 * np.sqrt([3.0, 2.0e8]), rtol=1e-6)
    assert np.isinf(rounding[2])


def test_what_is_known_of_an_order_is_the_same_for_every_model() -> None:
    given, rng = readings(60), np.random.default_rng(4)
    orders = pool_orders(given)
    for fitted in (line(60), line(60)[:, :1]):
        noisy = relaxing(rng, 60, 12.0)
        alone, shared = (NoiseEstimator(given, fitted, nothing, known).estimate(noisy) for known in (None, orders))
        np.testing.assert_array_equal(alone.sigma, shared.sigma)
        np.testing.assert_array_equal(alone.factors[0][1], shared.factors[0][1])
    # Decomposed once.
    (whole,), name = orders[0].looked_at(2), orders[0].kernels[0]
    assert orders[0].looked_at(9) == [whole]
    assert orders[0].decomposed(name, whole) is orders[0].decomposed(name, whole)
    strength, vectors = orders[0].decomposed(name, whole)
    np.testing.assert_allclose((vectors * strength) @ vectors.T, orders[0].kernel(name, np.arange(60)), atol=1e-12)


def test_decompositions_of_many_data_are_not_kept() -> None:
    """Beside as many columns hundreds of megabytes would be."""
    order = pool_orders(readings(450))[0]
    (whole,) = order.looked_at(150)
    first, second = (order.decomposed(order.kernels[0], whole) for _ in range(2))
    assert first is not second
    np.testing.assert_array_equal(first[0], second[0])


def test_of_many_data_a_stretch_and_blocks_of_all_are_looked_at() -> None:
    order = pool_orders(readings(1000, groups=2))[0]
    near, far = order.looked_at(20)
    assert (near.size, len(near.members), far.size, len(far.members)) == (1, 400, 3, 1000)
    assert len(far.first) == 2 * 167
    strength, vectors = order.decomposed(order.kernels[-1], far)
    correlation = (vectors * strength) @ vectors.T
    # Two groups have nothing to do with each other.
    np.testing.assert_allclose(correlation[:167, 167:], 0.0, atol=1e-12)
    assert correlation[0, 1] > 0.0
    # Without an order there is nothing slow to look for.
    assert [each.size for each in pool_orders(readings(1000, order=None))[0].looked_at(20)] == [1]


LONG = 2000


@pytest.mark.parametrize("runs", [3.0, 30.0, 300.0])
def test_noise_of_many_data_is_told_whether_it_is_fast_or_slow(runs: float) -> None:
    """One as strong as the white noise beside it; of a stretch of 400 the slowest was a level."""
    given, rng = readings(LONG), np.random.default_rng(int(runs))
    estimator = NoiseEstimator(given, line(LONG), nothing)
    pulls, square_sums = [], []
    for _ in range(24):
        noisy = rng.standard_normal(LONG) + relaxing(rng, LONG, runs)
        noise = estimator.estimate(noisy)
        assert noise.correlations[0].kind
        fitted, white = noise.whiten(line(LONG)), noise.whiten(noisy)
        covariance = np.linalg.inv(fitted.T @ fitted)
        pulls += list(covariance @ (fitted.T @ white) / np.sqrt(np.diag(covariance)))
        square_sums.append(float(white @ white))
    # No larger than uncertainties say, to four standard deviations of the mean of 48 squares; where noise that is
    # slow was taken for a level they were 31.
    assert float(np.mean(np.square(pulls))) < 1.0 + 4.0 * np.sqrt(2.0 / len(pulls))
    # The scale is that of all data: what is left beside two parameters told it.
    assert np.array(square_sums) == pytest.approx(LONG, rel=0.01)
