import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.errors import ConfigError
from rigctl.experiments.rotating_platform.observe.noise import Q_FLEX_NOISE_V, PowerLawNoise
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, named_pattern
from rigctl.experiments.rotating_platform.result.design import designs
from rigctl.experiments.rotating_platform.result.precision import continuous_precision
from rigctl.experiments.rotating_platform.result.separation import require

NOISE = Q_FLEX_NOISE_V.in_units_of(846.73)


def sigma(name, period_s, rotation_s):
    found = continuous_precision(named_pattern(name, period_s, rotation_s), NOISE, 3600.0)
    return max(found.single_period, found.many_periods)


def test_the_best_period_is_that_of_a_full_search():
    for found in designs(NOISE, 5.0, 0):
        name = found.pattern.name
        shortest = int(ROTATIONS[name] * 5.0) + 1
        tried = {period_s: sigma(name, float(period_s), 5.0) for period_s in range(shortest, 150)}
        assert found.pattern.period_s == min(tried, key=tried.__getitem__)
        assert found.sigma == pytest.approx(min(tried.values()))


def test_the_best_comes_first_and_rejects_what_was_asked_for():
    expected = {0: ["b", "c", "c_tm", "a"], 1: ["b", "c", "c_tm"], 2: ["c", "c_tm"], 3: ["c"]}
    for order, names in expected.items():
        found = designs(NOISE, 5.0, order)
        assert [each.pattern.name for each in found] == names
        assert [each.sigma for each in found] == sorted(each.sigma for each in found)
        for each in found:
            assert each.order >= order
            assert require(each.pattern.sampled(200.0), order).order == each.order


@settings(deadline=None, max_examples=10)
@given(
    rotation_s=st.floats(1.0, 30.0),
    factor=st.floats(2.0, 30.0),
    exponent=st.floats(1.2, 2.5),
    order=st.integers(0, 3),
)
def test_more_slow_noise_asks_for_a_shorter_period(rotation_s, factor, exponent, order):
    calm = designs(PowerLawNoise(1.0, 1e-3, exponent), rotation_s, order)
    loud = designs(PowerLawNoise(1.0, 1e-3 * factor, exponent), rotation_s, order)
    for one, other in zip(*(sorted(each, key=lambda d: d.pattern.name) for each in (calm, loud)), strict=True):
        assert other.pattern.period_s <= one.pattern.period_s
        assert other.sigma >= one.sigma


def test_white_noise_asks_for_the_longest_period():
    (found,) = designs(PowerLawNoise(1.0, 0.0, 0.0), 5.0, 3, longest_s=500.0)
    assert found.pattern.period_s == 500.0


def test_a_guard_is_designed_in_and_costs_what_a_slower_turn_does():
    (guarded,), (slower,) = designs(NOISE, 5.0, 3, guard_s=2.0, lead_s=0.5), designs(NOISE, 7.5, 3)
    assert guarded.pattern.dwells == slower.pattern.dwells
    assert guarded.sigma == slower.sigma
    assert guarded.pattern.rotation_s == 5.0
    assert designs(NOISE, 5.0, 3, guard_s=20.0)[0].pattern.dwells == designs(NOISE, 25.0, 3)[0].pattern.dwells


def test_periods_are_multiples_of_the_step():
    fine, coarse = (designs(NOISE, 5.0, 1, step_s=step_s)[0].pattern.period_s for step_s in (0.1, 10.0))
    assert fine == pytest.approx(26.0, abs=1.0)
    assert coarse == 30.0


def test_the_convention_of_the_density_is_kept():
    two, one = (designs(NOISE, 5.0, 3, sided=sided)[0] for sided in (2, 1))
    assert one.precision.sided == 1
    assert one.pattern == two.pattern
    assert one.sigma == pytest.approx(two.sigma / 2.0**0.5)


def test_what_cannot_be_designed_is_refused():
    with pytest.raises(ConfigError, match="drift of order 4"):
        designs(NOISE, 5.0, 4)
    with pytest.raises(ConfigError, match="no pattern of at most 60 s has time to dwell beside half turns of 30 s"):
        designs(NOISE, 30.0, 0, longest_s=60.0)
    assert [each.pattern.name for each in designs(NOISE, 5.0, 0, longest_s=20.0)] == ["b", "a"]
