"""Calibrations beside each other: false alarms are as rare as promised, drifts and jumps that are there are found."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rigctl.analysis.repeated import (
    DRIFT_LEVEL,
    LEVEL,
    Consistency,
    Drift,
    Repeated,
    consistency,
    drift,
    sigmas,
    spread_consistency,
    unwrapped,
)
from rigctl.core.arrays import FloatArray

SURELY = 1e-4
"""Probability with which a count of alarms fails by chance."""


def _values(
    value: FloatArray, u: FloatArray, dof: float = np.inf, common: FloatArray | None = None, years: float = 1.0
) -> Repeated:
    n = len(value)
    time_a = years * np.arange(n, dtype=float)
    return Repeated(time_a, value, u, np.full(n, dof), np.zeros((n, 0)) if common is None else common)


def _drawn(rng: np.random.Generator, n: int, dof: float, common: float, slope: float) -> Repeated:
    """Values with uncertainties that were estimated with `dof` degrees of freedom, and an error common to all."""
    sigma = rng.uniform(0.5, 2.0, n)
    u = sigma * np.sqrt(rng.chisquare(dof, n) / dof) if np.isfinite(dof) else sigma
    time_a = np.sort(rng.uniform(0.0, 10.0, n))
    value = sigma * rng.normal(size=n) + common * rng.normal() + slope * time_a
    return Repeated(time_a, value, u, np.full(n, dof), np.full((n, 1), common))


def _slope_of(values: Repeated) -> Drift:
    found = drift(values)
    assert found is not None
    return found


@pytest.mark.parametrize(("n", "dof", "common"), [(2, 6.0, 0.0), (5, 10.0, 20.0), (9, np.inf, 1000.0)])
def test_consistent_calibrations_raise_no_more_alarms_than_promised(n: int, dof: float, common: float) -> None:
    rng = np.random.default_rng([3, n])
    drawn = [_drawn(rng, n, dof, common, 0.0) for _ in range(500)]
    tested = [consistency(each) for each in drawn]
    of_newest = [each.p_value for each in tested]
    of_former = [each.former.p_value for each in tested]
    of_drift = [_slope_of(each).slope.p_value for each in drawn]
    for p_values in (of_newest, of_drift, *([of_former] if n > 2 else [])):
        for level in (LEVEL, 0.05, 0.5):
            alarms = sum(p < level for p in p_values)
            # Weights that are estimates make Johansen's and Kackar and Harville's tests approximate.
            assert alarms <= stats.binom.isf(SURELY, len(drawn), 1.1 * level)
            assert alarms >= stats.binom.isf(1.0 - SURELY, len(drawn), 0.75 * level)


def test_a_drift_that_is_there_is_found_with_its_size_and_is_no_alarm() -> None:
    rng = np.random.default_rng(4)
    drawn = [_drawn(rng, 8, 12.0, 5.0, 1.0) for _ in range(300)]
    found = [_slope_of(each).slope for each in drawn]
    assert sum(each.p_value < LEVEL for each in found) > 0.9 * len(drawn)
    pulls = [(each.value - 1.0) / each.standard_uncertainty for each in found]
    assert abs(np.mean(pulls)) < 4.0 / len(drawn) ** 0.5
    assert 0.9 < np.std(pulls) < 1.25
    for each in drawn:
        certain = _slope_of(each.former).slope.p_value < DRIFT_LEVEL
        assert consistency(each).model == ("drift" if certain else "mean")
    followed = [tested for tested in map(consistency, drawn) if tested.model == "drift"]
    assert len(followed) > 0.5 * len(drawn)
    alarms = sum(tested.p_value < LEVEL for tested in followed)
    assert alarms <= stats.binom.isf(SURELY, len(followed), 1.5 * LEVEL)


def test_a_jump_of_the_newest_is_found_beside_a_larger_error_that_all_share() -> None:
    value = np.array([0.3, -0.4, 0.1, 0.2, 6.0])
    u = np.ones(5)
    shared = consistency(_values(value, u, common=np.full((5, 1), 100.0)))
    assert shared.p_value == pytest.approx(consistency(_values(value, u)).p_value, rel=1e-9)
    assert shared.normalised_difference == pytest.approx((6.0 - 0.05) / np.sqrt(1.25), rel=1e-9)
    # Of other equipment each time, the same uncertainty explains it.
    assert consistency(_values(value, u, common=100.0 * np.eye(5))).p_value > 0.9


def test_a_new_certificate_is_no_reason_for_an_alarm() -> None:
    value = np.array([0.0, 0.1, -0.1, 7.0, 7.1])
    before, after = np.zeros((5, 2)), 5.0
    before[:3, 0] = before[3:, 1] = after
    tested = consistency(_values(value, np.ones(5), common=before))
    assert tested.former.p_value > LEVEL
    # Of the calibration that shares its reference the newest is 0.1 off, whatever the others say.
    assert abs(tested.normalised_difference) < 0.3


def test_two_calibrations_are_compared_by_welchs_t() -> None:
    means, u, dof = (10.0, 11.3), (0.4, 0.3), (6.0, 11.0)
    values = Repeated(np.arange(2.0), np.array(means), np.array(u), np.array(dof), np.zeros((2, 0)))
    known = stats.ttest_ind_from_stats(*(means[0], u[0] * 7**0.5, 7, means[1], u[1] * 12**0.5, 12), equal_var=False)
    tested = consistency(values)
    assert tested.p_value == pytest.approx(known.pvalue, rel=1e-9)
    assert tested.normalised_difference == pytest.approx(-known.statistic, rel=1e-12)
    u_difference = np.hypot(*u)
    assert tested.e_n == pytest.approx(1.3 / (stats.t.isf(0.025, tested.difference.dof) * u_difference), rel=1e-9)


def test_former_calibrations_are_compared_by_welchs_analysis_of_variance() -> None:
    mean, u, dof = np.array([1.0, 1.9, 0.7, 2.2]), np.array([0.3, 0.4, 0.2, 0.5]), np.array([5.0, 9.0, 7.0, 14.0])
    values = Repeated(np.zeros(5), np.append(mean, 1.2), np.append(u, 0.3), np.append(dof, 8.0), np.zeros((5, 0)))
    # Welch 1951, Biometrika 38, 330, eqs. 28 and 29, as textbooks have them.
    w = 1.0 / u**2
    spread = (w * (mean - (w @ mean) / w.sum()) ** 2).sum() / 3.0
    inner = ((1.0 - w / w.sum()) ** 2 / dof).sum()
    f = spread / (1.0 + 2.0 * 2.0 / 15.0 * inner)
    former = consistency(values).former
    assert former.p_value == pytest.approx(stats.f.sf(f, 3, 15.0 / (3.0 * inner)), rel=1e-9)
    assert former.birge_ratio == pytest.approx(spread**0.5, rel=1e-9)


def test_weights_that_are_estimates_make_a_mean_less_certain() -> None:
    u, dof = np.array([0.3, 0.4, 0.2]), np.array([5.0, 9.0, 7.0])
    values = Repeated(np.zeros(4), np.zeros(4), np.append(u, 0.3), np.append(dof, 8.0), np.zeros((4, 0)))
    # Meier 1953, Biometrics 9, 59: the variance of a mean with estimated weights.
    share = u**-2.0 / (u**-2.0).sum()
    of_mean = (1.0 + 4.0 * (share * (1.0 - share) / dof).sum()) / (u**-2.0).sum()
    assert consistency(values).difference.standard_uncertainty == pytest.approx((0.09 + of_mean) ** 0.5, rel=1e-12)


def test_former_calibrations_that_disagree_widen_the_uncertainty() -> None:
    value, u = np.array([-10.0, 10.0, -9.0, 9.0, 8.0]), np.ones(5)
    tested = consistency(_values(value, u))
    assert tested.former.p_value < 1e-20
    assert tested.p_value > 0.3
    expected = tested.former.birge_ratio * np.sqrt(1.25)
    assert tested.difference.standard_uncertainty == pytest.approx(expected, rel=1e-9)


def test_calibrations_of_one_day_have_no_drift() -> None:
    hours = 1.0 / (365.25 * 24.0)
    assert drift(_values(np.array([0.0, 5.0, 10.0]), np.ones(3), years=hours)) is None
    assert consistency(_values(np.array([0.0, 5.0, 10.0, 15.0]), np.ones(4), years=hours)).model == "mean"


def test_spreads_are_compared_by_f_and_bartletts_test() -> None:
    rng = np.random.default_rng(5)
    samples = [rng.normal(size=n) for n in (5, 8, 6, 9)]
    deviations = np.array([np.std(each, ddof=1) for each in samples])
    dof = np.array([len(each) - 1.0 for each in samples])
    tested = spread_consistency(np.append(deviations, 3.0 * deviations[0]), np.append(dof, 4.0))
    assert tested.former.p_value == pytest.approx(stats.bartlett(*samples).pvalue, rel=1e-9)
    ratio = (3.0 * deviations[0] / tested.predicted) ** 2
    assert tested.p_value == pytest.approx(2.0 * stats.f.sf(ratio, 4.0, dof.sum()), rel=1e-9)


def test_spreads_raise_no_more_alarms_than_promised() -> None:
    rng = np.random.default_rng(6)
    dof = np.array([3.0, 5.0, 4.0, 4.0])
    p_values = [spread_consistency(np.sqrt(rng.chisquare(dof) / dof), dof).p_value for _ in range(2000)]
    for level in (LEVEL, 0.05):
        alarms = sum(p < level for p in p_values)
        assert stats.binom.isf(1.0 - SURELY, 2000, level) <= alarms <= stats.binom.isf(SURELY, 2000, level)


@given(st.floats(-1000.0, 1000.0), st.lists(st.floats(-40.0, 40.0), min_size=2, max_size=6))
def test_angles_are_placed_alike_however_all_are_turned(turned: float, angles: list[float]) -> None:
    given_deg = np.mod(np.array(angles) + turned, 360.0)
    placed = unwrapped(given_deg, np.ones(len(angles)), 360.0)
    assert placed - placed[0] == pytest.approx(np.array(angles) - angles[0], abs=1e-6)
    assert np.mod(placed - given_deg + 180.0, 360.0) == pytest.approx(180.0, abs=1e-6)


def test_sigmas_are_those_of_a_normal_distribution() -> None:
    for z in (0.5, 3.0, 12.0):
        assert sigmas(2.0 * stats.norm.sf(z)) == pytest.approx(z, rel=1e-9)


def test_a_result_says_which_way_the_newest_is_off() -> None:
    tested: Consistency = consistency(_values(np.array([5.0, 5.0, 3.0]), np.array([0.5, 0.5, 0.5])))
    assert (tested.predicted, tested.difference.value) == pytest.approx((5.0, -2.0))
    assert tested.normalised_difference < 0.0
    assert tested.e_n < 0.0
