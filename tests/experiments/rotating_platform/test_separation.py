import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.errors import ConfigError
from rigctl.experiments.rotating_platform.observe.estimators import ESTIMATORS, OUTPUTS, weights
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, custom_pattern, named_pattern
from rigctl.experiments.rotating_platform.result.separation import conditions, require, separation

NAMES = sorted(ROTATIONS)


def test_the_moments_are_those_of_the_table(table):
    for row in table("conditions"):
        pattern = named_pattern(row["pattern"], row["period_s"])
        sampled = pattern.sampled(row["fs_hz"])
        assert sampled.kept == row["kept_samples"]
        found = conditions(sampled)
        printed = [row[f"{moment}_sampled"] for moment in ("m0", "m1", "m2")]
        assert (found.m0, found.m1, found.m2) == pytest.approx(printed, rel=6e-6, abs=1e-11)


def test_c_tm_cancels_exactly_on_the_samples():
    found = conditions(named_pattern("c_tm", 60.0).sampled(30.0))
    assert (found.m0, found.m1, found.m2) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_estimates_are_right_for_what_they_are_named_for(name, estimator):
    sampled = named_pattern(name, 300.0).sampled(10.0)
    c, kept = sampled.sign.astype(float), np.abs(sampled.sign)
    found = weights(sampled, estimator) @ np.stack([c, c * sampled.time_s, kept, kept * sampled.time_s]).T
    assert np.diag(found) == pytest.approx(np.ones(4))
    if estimator == "joint-ls":
        assert found == pytest.approx(np.eye(4), abs=1e-9)


@settings(deadline=None)
@given(
    gaps=st.lists(st.floats(2.0, 9.0), min_size=5, max_size=5),
    lengths=st.lists(st.floats(1.0, 40.0), min_size=4, max_size=4),
    truth=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4),
)
def test_the_joint_fit_is_exact_for_any_pattern(gaps, lengths, truth):
    at, dwells = 0.0, []
    for number, (gap, length) in enumerate(zip(gaps, lengths, strict=False)):
        at += gap
        dwells.append((-1 if number % 2 else 1, at, at + length))
        at += length
    sampled = custom_pattern(float(np.ceil(at + 9.0)), dwells, 2.0).sampled(5.0)
    c, t = sampled.sign, sampled.time_s
    reading = c * (truth[0] + truth[1] * t) + np.abs(c) * (truth[2] + truth[3] * t)
    assert weights(sampled, "joint-ls") @ reading == pytest.approx(truth, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "estimator", "order", "slopes"),
    [
        ("a", "projection", 0, False),
        ("b", "projection", 1, False),
        ("c", "projection", 3, True),
        ("c_tm", "projection", 2, True),
        ("a", "joint-ls", 2, True),
        ("b", "joint-ls", 1, True),
        ("c", "joint-ls", 3, True),
    ],
)
def test_the_order_of_drift_that_is_rejected(name, estimator, order, slopes):
    for period_s, rate_hz in ((60.0, 10.0), (3000.0, 10.0), (60.0, 200.0)):
        found = separation(named_pattern(name, period_s).sampled(rate_hz), estimator)
        assert (found.order, found.slopes_separate) == (order, slopes)


@settings(deadline=None)
@given(name=st.sampled_from(NAMES), period_s=st.integers(60, 3000), coefficient=st.floats(-5.0, 5.0))
def test_leaks_are_what_the_weights_make_of_a_drift(name, period_s, coefficient):
    sampled = named_pattern(name, float(period_s)).sampled(4.0)
    found = separation(sampled)
    for order in range(4):
        drift = coefficient * np.abs(sampled.sign) * sampled.time_s**order
        seen = weights(sampled) @ drift
        scale = np.abs(drift).max() + 1e-300
        assert seen[0] == pytest.approx(coefficient * found.mean_leaks[order], abs=1e-9 * scale)
        assert seen[1] == pytest.approx(coefficient * found.slope_leaks[order], abs=1e-9 * scale)


def test_bias_and_acceleration_mix_alike():
    sampled = named_pattern("b", 60.0).sampled(10.0)
    drift = np.abs(sampled.sign) * sampled.time_s
    table = dict(zip(OUTPUTS, weights(sampled) @ drift, strict=True))
    exchanged = dict(zip(OUTPUTS, weights(sampled) @ (sampled.sign * sampled.time_s), strict=True))
    assert table["accel_slope"] == pytest.approx(exchanged["bias_slope"])
    assert table["accel_slope"] == pytest.approx(0.9, rel=1e-5)


def test_what_a_pattern_separates_is_said_in_words():
    mean, slope, angle = separation(named_pattern("a", 60.0).sampled(10.0)).says
    assert mean == (
        "mean acceleration: free of a constant bias, not of a linear drift of the bias: "
        "15 s times the drift's coefficient are in it"
    )
    assert slope.startswith("slope of the acceleration: -0.0581 /s of the bias's level and")
    assert angle.startswith("angle: what turns with the platform")
    mean, slope, _ = separation(named_pattern("c", 60.0).sampled(10.0)).says
    assert mean == "mean acceleration: free of a cubic drift of the bias"
    assert slope == "slope of the acceleration: free of the bias's level and slope"


def test_a_pattern_that_cannot_reject_the_bias_is_refused_with_what_would():
    with pytest.raises(ConfigError) as refused:
        require(named_pattern("a", 60.0).sampled(10.0), 1)
    assert str(refused.value) == (
        "pattern a of 60 s at 10 Hz with projection cannot reject a linear drift of the bias: "
        "15 s of its linear part stay in the mean acceleration; take pattern b, c or c_tm, or joint-ls"
    )
    with pytest.raises(ConfigError, match=r"cannot reject a quadratic drift.*300 s2.*take pattern c or c_tm"):
        require(named_pattern("b", 60.0).sampled(10.0), 2)
    assert require(named_pattern("c", 60.0).sampled(10.0), 3).order == 3


def test_dwells_of_unequal_length_leave_part_of_the_bias():
    uneven = custom_pattern(60.0, [(1, 0.0, 10.0), (-1, 15.0, 45.0), (1, 50.0, 60.0)], 5.0).sampled(10.0)
    assert separation(uneven).says[0] == "mean acceleration: -0.2 of the bias is in it"
    with pytest.raises(ConfigError, match=r"0\.2 of its constant part stay.*rest as many samples"):
        require(uneven, 0)
    assert require(uneven, 1, "joint-ls").order == 1


def test_a_platform_that_stays_tells_nothing_apart():
    still = custom_pattern(60.0, [(1, 0.0, 60.0)]).sampled(10.0)
    with pytest.raises(ConfigError, match="1 of its constant part stay in the mean"):
        require(still, 0)
    with pytest.raises(ConfigError, match=r"fewer than two samples with cos\(theta\) = -1"):
        require(still, 0, "joint-ls")


def test_a_drift_beyond_all_patterns_is_refused():
    with pytest.raises(ConfigError, match="drift of order 4"):
        require(named_pattern("c", 60.0).sampled(10.0), 4)
