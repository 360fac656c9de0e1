import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rigctl.core.errors import ConfigError
from rigctl.experiments.rotating_platform.observe.patterns import (
    ROTATIONS,
    Dwell,
    Pattern,
    Turn,
    custom_pattern,
    named_pattern,
)

NAMES = sorted(ROTATIONS)


def test_the_dwells_are_those_of_the_table(table):
    rows = table("patterns")
    assert {row["pattern"] for row in rows} == set(NAMES)
    for row in rows:
        pattern = named_pattern(row["pattern"], row["period_s"])
        dwell = pattern.dwells[int(row["dwell_index"])]
        assert dwell.sign == row["sign_cos_theta"]
        assert (dwell.start_s, dwell.stop_s) == pytest.approx((row["start_s"], row["stop_s"]), abs=6e-7)


@pytest.mark.parametrize("name", NAMES)
def test_the_rotations_of_a_period_take_twenty_seconds_together(name):
    pattern = named_pattern(name, 300.0)
    assert pattern.period_s - pattern.kept_s == pytest.approx(20.0)
    assert len(pattern.turns) == ROTATIONS[name]
    assert sum(turn.stop_s - turn.start_s for turn in pattern.turns) == pytest.approx(20.0)


def test_the_last_turn_of_a_ends_in_the_next_period():
    assert named_pattern("a", 60.0).turns == (Turn(25.0, 35.0, -1), Turn(55.0, 65.0, 1))


@pytest.mark.parametrize("name", NAMES)
def test_turns_go_back_and_forth(name):
    signs = [turn.to_sign for turn in named_pattern(name, 120.0).turns]
    assert all(before == -after for before, after in zip(signs, [*signs[1:], signs[0]], strict=True))


def test_a_guard_is_designed_in_and_the_motion_starts_with_its_mask():
    plain, guarded = named_pattern("c", 60.0, 7.0), named_pattern("c", 60.0, 5.0, guard_s=2.0)
    assert guarded.dwells == plain.dwells
    for turn, before in zip(guarded.turns, guarded.dwells, strict=False):
        assert turn.start_s == before.stop_s
        assert turn.stop_s == pytest.approx(turn.start_s + 5.0)


def test_a_lead_lets_the_mask_start_before_the_motion():
    pattern = named_pattern("b", 60.0, 5.0, guard_s=2.0, lead_s=0.5)
    assert pattern.turns[0].start_s == pattern.dwells[0].stop_s + 0.5
    assert pattern.dwells[1].start_s == pytest.approx(pattern.turns[0].stop_s + 2.0)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("period_s", "rate_hz"), [(60.0, 10.0), (60.0, 200.0), (300.0, 100.0), (46.7, 10.0)])
def test_a_sample_counts_when_its_middle_lies_in_a_dwell(name, period_s, rate_hz):
    sampled = named_pattern(name, period_s).sampled(rate_hz)
    for k in range(sampled.samples):
        t = (k + 0.5) / rate_hz
        inside = [d.sign for d in sampled.pattern.dwells if d.start_s - 1e-6 <= t < d.stop_s - 1e-6]
        assert sampled.sign[k] == (inside[0] if inside else 0)
    assert sampled.kept == np.count_nonzero(sampled.sign)


@settings(deadline=None)
@given(
    name=st.sampled_from(NAMES),
    period_s=st.integers(45, 600),
    rate_hz=st.sampled_from([1.0, 10.0, 40.0]),
    rotation_s=st.floats(0.0, 3.0),
)
def test_power_sums_are_those_of_the_samples(name, period_s, rate_hz, rotation_s):
    sampled = named_pattern(name, float(period_s), rotation_s).sampled(rate_hz)
    t = (np.arange(sampled.samples) + 0.5) / rate_hz - 0.5 * period_s
    for row, sign in enumerate((1, -1)):
        direct = [(t[sampled.sign == sign] ** j).sum() for j in range(5)]
        size = [(np.abs(t[sampled.sign == sign]) ** j).sum() for j in range(5)]
        assert (np.abs(sampled.power_sums(4)[row] - direct) <= 1e-11 * np.array(size)).all()


@settings(deadline=None)
@given(name=st.sampled_from(NAMES), period_s=st.integers(45, 200), rotation_s=st.floats(0.0, 4.0))
def test_sums_over_fine_samples_are_the_integrals(name, period_s, rotation_s):
    pattern = named_pattern(name, float(period_s), rotation_s)
    fine = pattern.sampled(1000.0).power_sums(2) / 1000.0
    power = np.arange(1, 4)
    integrals = np.zeros((2, 3))
    for dwell in pattern.dwells:
        start_s, stop_s = (at_s - 0.5 * pattern.period_s for at_s in (dwell.start_s, dwell.stop_s))
        integrals[0 if dwell.sign > 0 else 1] += (stop_s**power - start_s**power) / power
    scale = pattern.period_s**power
    assert fine / scale == pytest.approx(integrals / scale, abs=5e-3 / period_s * 4)


@settings(deadline=None)
@given(period_s=st.integers(44, 4000), step=st.integers(0, 20))
def test_b_and_c_stay_even_on_the_samples(period_s, step):
    for name in ("b", "c"):
        pattern = named_pattern(name, float(period_s), 0.2 * step)
        sampled = pattern.sampled(20.0)
        edges = np.array([[d.start_s, d.stop_s] for d in pattern.dwells]).ravel() * 20.0 - 0.5
        # An edge that falls on a sample belongs to one side only.
        assume((np.abs(edges - np.rint(edges)) > 0.01).all())
        assert (sampled.sign == sampled.sign[::-1]).all()


def test_a_period_that_is_no_whole_number_of_samples_is_refused():
    with pytest.raises(ConfigError, match=r"pattern b of 60\.03 s is 600\.3 samples at 10 Hz: make it a multiple"):
        named_pattern("b", 60.03).sampled(10.0)


def test_a_dwell_without_a_sample_is_refused():
    with pytest.raises(ConfigError, match="the dwell at 20 s holds no sample at 1 Hz"):
        custom_pattern(60.0, [(1, 0.0, 10.0), (-1, 20.0, 20.3), (1, 30.0, 60.0)]).sampled(1.0)


@pytest.mark.parametrize(
    ("name", "period_s", "rotation_s", "said"),
    [
        ("d", 60.0, 5.0, "there is no pattern 'd'"),
        ("b", 20.0, 10.0, "leaves no time to dwell beside 2 rotations of 10 s"),
        ("c", 20.0, 5.0, "leaves no time to dwell beside 4 rotations"),
        ("c_tm", 30.0, 5.0, "leaves no time to dwell beside 6 rotations"),
        ("a", 60.0, -1.0, "rotation_s is -1"),
    ],
)
def test_a_pattern_that_cannot_be_laid_out_is_refused(name, period_s, rotation_s, said):
    with pytest.raises(ConfigError, match=said):
        named_pattern(name, period_s, rotation_s)


@pytest.mark.parametrize(
    ("dwells", "said"),
    [
        ([], "at least one dwell"),
        ([(2, 0.0, 10.0)], "has the sign 2"),
        ([(1, 0.0, 20.0), (-1, 19.0, 40.0)], "dwell 1, 19 to 40 s, overlaps"),
        ([(1, 0.0, 20.0), (-1, 30.0, 61.0)], "leaves the period"),
        ([(1, 5.0, 20.0), (-1, 22.0, 55.0)], "2 s after the dwell that ends at 20 s are too short for a rotation"),
        ([(1, 0.0, 20.0), (-1, 30.0, 58.0)], "2 s after the dwell that ends at 58 s are too short"),
    ],
)
def test_a_table_that_no_platform_can_follow_is_refused(dwells, said):
    with pytest.raises(ConfigError, match=said):
        custom_pattern(60.0, dwells, 5.0)


def test_the_table_of_a_named_pattern_is_a_custom_one(table):
    rows = [row for row in table("patterns") if (row["pattern"], row["period_s"]) == ("c_tm", 60.0)]
    dwells = [(int(row["sign_cos_theta"]), row["start_s"], row["stop_s"]) for row in rows]
    custom, named = custom_pattern(60.0, dwells, 20.0 / 6.0), named_pattern("c_tm", 60.0)
    assert custom.sampled(30.0).segments == named.sampled(30.0).segments


def test_dwells_of_one_sign_need_no_time_between_them():
    pattern = Pattern("custom", 10.0, (Dwell(1, 0.0, 4.0), Dwell(1, 4.0, 10.0)), rotation_s=5.0)
    assert pattern.turns == ()
