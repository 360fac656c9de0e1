"""The platform's tables: samples that count are taken where the pattern says; what no stage can do is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procedures.rotating_platform import time_table
from procedures.rotating_platform.course import Course, Leg
from procedures.rotating_platform.time_table import EARLY_S, Motion, TimeTable, shortest_turn_s
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, LimitError
from rigctl.core.limits import RotationLimits
from rigctl.experiments.rotating_platform.observe.patterns import ROTATIONS, Pattern, custom_pattern, named_pattern

LIMITS = RotationLimits(-10.0, 370.0, 120.0, 120.0)
RATE_HZ = 10.0

patterns = st.builds(
    named_pattern,
    st.sampled_from(sorted(ROTATIONS)),
    st.sampled_from([60.0, 90.0, 300.0]),
    st.sampled_from([None, 3.0, 4.4]),
    guard_s=st.sampled_from([0.0, 0.5, 1.7]),
    lead_s=st.sampled_from([0.0, 0.5]),
)


def carried_out(table: TimeTable, late_s: float = 0.0) -> Course:
    """The table as a stage does it that begins every turn `late_s` late, and takes its time."""
    course = Course(table, table.begin_deg, 1.0 / RATE_HZ)
    for motion in table.motions:
        leg = Leg(motion.start_s + late_s, motion.stop_s - EARLY_S + late_s, course.last_theta_deg, motion.to_deg)
        course.add(leg)
    return course


def sample_times_s(table: TimeTable) -> FloatArray:
    return (np.arange(round(table.duration_s * RATE_HZ)) + 0.5) / RATE_HZ


@settings(deadline=None, max_examples=60)
@given(pattern=patterns, periods=st.integers(1, 4), forward=st.booleans())
def test_every_sample_that_counts_is_taken_at_rest_and_where_the_pattern_says(
    pattern: Pattern, periods: int, forward: bool
) -> None:
    table = time_table.modulation(pattern, periods, forward=forward)
    course, times_s = carried_out(table), sample_times_s(table)
    sign = np.tile(pattern.sampled(RATE_HZ).sign, periods)
    kept = sign != 0
    moving = course.moving(times_s)
    assert not (moving & kept).any()
    cos = np.cos(np.deg2rad(course.theta_deg(times_s)))
    assert cos[kept] == pytest.approx(sign[kept], abs=1e-9)
    if pattern.guard_s == pattern.lead_s == 0.0:
        assert (moving == ~kept).all(), "without a guard all samples that do not count are taken in motion"


@settings(deadline=None, max_examples=30)
@given(pattern=patterns, periods=st.integers(1, 6), forward=st.booleans())
def test_turns_come_in_order_and_by_half_turns(pattern: Pattern, periods: int, forward: bool) -> None:
    table = time_table.modulation(pattern, periods, forward=forward)
    edges = [time for motion in table.motions for time in (motion.start_s, motion.stop_s)]
    assert edges == sorted(edges)
    angles = [table.begin_deg, *(motion.to_deg for motion in table.motions)]
    steps = np.diff(angles)
    assert set(np.abs(steps)) == {180.0}
    assert (steps > 0).all() if forward else set(angles) == {0.0, 180.0}
    assert table.duration_s == pytest.approx(periods * pattern.period_s)
    assert len(table.motions) in {periods * len(pattern.turns), periods * len(pattern.turns) + 1}


def test_a_pattern_that_begins_in_a_turn_begins_it_before_the_run() -> None:
    table = time_table.modulation(named_pattern("a", 60.0), 2)
    assert (table.motions[0].start_s, table.motions[0].stop_s) == (-5.0, 5.0)
    assert table.begin_deg == 180.0
    assert (table.motions[-1].start_s, table.motions[-1].to_deg) == (115.0, 0.0)


@settings(deadline=None, max_examples=40)
@given(late_s=st.floats(0.0, 3.0))
def test_a_turn_that_is_late_counts_as_long_as_it_lasts(late_s: float) -> None:
    pattern = named_pattern("b", 60.0)
    table = time_table.modulation(pattern, 2)
    times_s = sample_times_s(table)
    moving = carried_out(table, late_s).moving(times_s)
    for motion in table.motions:
        last = motion.stop_s - EARLY_S + late_s
        assert moving[(times_s >= motion.start_s) & (times_s < max(last, motion.stop_s))].all()
    assert moving.sum() == pytest.approx(400 + 4 * 10 * max(late_s - EARLY_S, 0.0), abs=4)


def test_between_dwells_the_angle_goes_as_a_cycloid() -> None:
    course = Course(time_table.rest(10.0), 0.0, 0.1)
    course.add(Leg(2.0, 6.0, 0.0, 180.0))
    assert course.theta_deg(np.array([1.0, 2.0, 4.0, 6.0, 9.0])) == pytest.approx([0.0, 0.0, 90.0, 180.0, 180.0])
    speed = np.gradient(course.theta_deg(np.linspace(2.0, 6.0, 4001)), 1e-3)
    assert speed.max() == pytest.approx(2.0 * 180.0 / 4.0, rel=1e-3)


def test_what_is_forgotten_does_not_change_what_comes() -> None:
    table = time_table.modulation(named_pattern("c", 60.0), 3)
    course, whole = carried_out(table), carried_out(table)
    later = sample_times_s(table)[900:]
    course.forget(90.0)
    assert (course.theta_deg(later) == whole.theta_deg(later)).all()
    assert (course.moving(later) == whole.moving(later)).all()


def test_a_scan_dwells_at_every_angle() -> None:
    table = time_table.scan([0.0, 15.0, 30.0], 60.0, 5.0)
    assert table.motions == (Motion(60.0, 65.0, 15.0), Motion(125.0, 130.0, 30.0))
    assert table.duration_s == 190.0


@settings(deadline=None, max_examples=60)
@given(
    distance_deg=st.floats(1.0, 360.0),
    speed_deg_s=st.floats(1.0, 500.0),
    acceleration_deg_s2=st.floats(1.0, 500.0),
    part=st.sampled_from([0.5, 0.99, 0.999, 1.001, 1.01, 2.0]),
)
def test_a_turn_is_allowed_exactly_when_its_peaks_are(
    distance_deg: float, speed_deg_s: float, acceleration_deg_s2: float, part: float
) -> None:
    limits = RotationLimits(-400.0, 400.0, speed_deg_s, acceleration_deg_s2)
    duration_s = part * shortest_turn_s(limits, distance_deg)
    peaks = (2.0 * distance_deg / duration_s, 2.0 * np.pi * distance_deg / duration_s**2)
    fits = peaks[0] <= speed_deg_s and peaks[1] <= acceleration_deg_s2
    table = TimeTable(0.0, (Motion(1.0, 1.0 + duration_s + EARLY_S, distance_deg),), 60.0)
    if fits:
        table.check("platform", limits)
    else:
        with pytest.raises(LimitError, match=r"^platform: .* longer rotation_s, or wider limits$"):
            table.check("platform", limits)


def test_turning_always_forward_wants_limits_for_it() -> None:
    table = time_table.modulation(named_pattern("c", 60.0), 2, forward=True)
    with pytest.raises(LimitError, match=r"turns to 540 deg, outside -10 \.\. 370 deg; turn back and forth"):
        table.check("platform", LIMITS)
    table.check("platform", RotationLimits(-10.0, 1450.0, 120.0, 120.0))


def test_a_custom_pattern_is_followed_as_it_is_given() -> None:
    dwells = [(1, 0.0, 10.0), (-1, 16.0, 26.0), (-1, 30.0, 40.0), (1, 46.0, 60.0)]
    table = time_table.modulation(custom_pattern(60.0, dwells, 6.0), 1)
    assert table.motions == (Motion(10.0, 16.0, 180.0), Motion(40.0, 46.0, 0.0))
    with pytest.raises(ConfigError, match="too short for a rotation"):
        custom_pattern(60.0, dwells, 7.0)
