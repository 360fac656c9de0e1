"""One instant of an axis is what its samples say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.motion import MotionAxis


@given(at_s=st.floats(-1.0, 40.0) | st.sampled_from([0.0, 10.0, 20.0, 30.0]))
def test_an_instant_equals_the_sample_at_that_time(at_s: float) -> None:
    axis = MotionAxis(1.0)
    axis.move_to(0.0, 12.0, 20.0, 80.0)
    axis.oscillate(10.0, 0.5, [2.0, 0.1], 3)
    axis.jog(20.0, -5.0, 10.0)
    axis.halt(30.0, 40.0)
    position, velocity, acceleration = axis.sample(np.array([at_s]))
    instant = (axis.position(at_s), axis.velocity(at_s), axis.acceleration(at_s))
    assert instant == (position[0], velocity[0], acceleration[0])


@settings(deadline=None)
@given(st.floats(0.1, 30.0), st.floats(-400.0, 400.0).filter(lambda d: abs(d) > 0.1), st.floats(-5.0, 5.0))
def test_a_cycloid_goes_from_rest_to_rest_and_its_speeds_are_its_derivatives(
    duration_s: float, displacement: float, start_s: float
) -> None:
    axis = MotionAxis(3.0)
    assert axis.turn_to(start_s, 3.0 + displacement, duration_s) == start_s + duration_s
    times_s = start_s + duration_s * np.linspace(0.0, 1.0, 2_001)
    position, velocity, acceleration = axis.sample(times_s)
    assert position[[0, 1_000, -1]] == pytest.approx([3.0, 3.0 + displacement / 2, 3.0 + displacement])
    for ends in (velocity[[0, -1]], acceleration[[0, -1]]):
        assert ends == pytest.approx([0.0, 0.0], abs=1e-6 * abs(displacement) / duration_s**2 * (1.0 + duration_s))
    step_s = duration_s / 2_000
    peak = np.abs(velocity).max()
    assert np.gradient(position, step_s)[1:-1] == pytest.approx(velocity[1:-1], abs=1e-5 * peak)
    assert np.gradient(velocity, step_s)[1:-1] == pytest.approx(acceleration[1:-1], abs=1e-4 * peak / duration_s)


def test_stops_are_the_ends_of_motions() -> None:
    axis = MotionAxis(0.0)
    axis.turn_to(0.0, 180.0, 10.0)
    axis.turn_to(20.0, 180.0, 10.0)
    axis.turn_to(40.0, 0.0, 10.0)
    axis.move_to(60.0, 90.0, 10.0, 40.0)
    axis.halt(62.0, 40.0)
    stops, last = axis.stops(np.array([-1.0, 5.0, 10.0, 35.0, 45.0, 50.0, 61.0, 70.0]))
    assert [stop.number for stop in stops] == [0, 1, 2, 3]
    assert [stop.direction for stop in stops] == [0.0, 1.0, -1.0, 1.0]
    assert [stop.start_s for stop in stops[1:3]] == [10.0, 50.0]
    assert 62.0 < stops[3].start_s < 63.0
    assert [stop.began_s for stop in stops[1:]] == [0.0, 40.0, 60.0]
    assert last.tolist() == [0, 0, 1, 1, 1, 2, 2, 3]


def test_stops_are_forgotten_with_their_motions_and_keep_their_numbers() -> None:
    axis = MotionAxis(0.0, history_s=100.0)
    for turn in range(50):
        axis.turn_to(20.0 * turn, 180.0 * (1 - turn % 2), 10.0)
    stops, _ = axis.stops(np.array([0.0]))
    assert len(stops) < 10
    assert [stop.number for stop in stops] == list(range(51 - len(stops), 51))
    assert axis.sample(np.array([905.0, 915.0]))[0] == pytest.approx([90.0, 0.0])
