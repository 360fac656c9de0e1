"""One instant of an axis is what its samples say."""

from __future__ import annotations

import numpy as np
from hypothesis import given
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
