"""What an anti-alias filter makes of a turn: against the same filter as an ordinary differential equation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import signal

from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.model.motion import (
    _POLES,
    _ZEROS,
    ORDER,
    RIPPLE_DB,
    STOP_DB,
    Motions,
    filter_delay_s,
    motion_of,
)

RATE_HZ, TURN_S, BEFORE = 8.0, 4.0, 40
TIMES_S: FloatArray = np.asarray((np.arange(-8, 80) + 0.5) / RATE_HZ)


def cycloid(u: FloatArray) -> FloatArray:
    return np.asarray(np.pi * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi)))


def quintic(u: FloatArray) -> FloatArray:
    return np.asarray(np.pi * u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def turned(law: Callable[[FloatArray], FloatArray], way: float = 1.0) -> Motions:
    """A turn of which some tenths of a second are not masked."""
    t = (np.arange(60) - BEFORE + 0.5) / RATE_HZ
    return motion_of(way * law(np.clip((t + TURN_S - 0.3) / TURN_S, 0.0, 1.0)), BEFORE, RATE_HZ)


def test_the_filter_has_the_zeros_and_poles_of_scipys() -> None:
    zeros, poles, _ = signal.ellip(ORDER, RIPPLE_DB, STOP_DB, 1.0, analog=True, output="zpk")
    np.testing.assert_allclose(np.sort_complex(_ZEROS), np.sort_complex(zeros[zeros.imag > 0.0]), rtol=1e-12)
    np.testing.assert_allclose(np.sort_complex(_POLES), np.sort_complex(poles[poles.imag > 0.0]), rtol=1e-12)


@pytest.mark.parametrize("cutoff_hz", [0.7, 4.0, 20.0])
@pytest.mark.parametrize("law", [cycloid, quintic])
def test_a_filtered_turn_is_that_of_the_differential_equation(
    law: Callable[[FloatArray], FloatArray], cutoff_hz: float
) -> None:
    """scipy's simulation of the filter, its input straight between nodes that lie close together."""
    motion = turned(law)
    above, below = signal.ellip(8, 0.1, 80.0, 2.0 * np.pi * cutoff_hz, analog=True)
    step_s = 1.0 / (RATE_HZ * 2 * round(100.0 * max(cutoff_hz, 1.0) / RATE_HZ + 1.0))
    grid_s = np.arange(round(motion.first_s[0] * RATE_HZ - 1) / RATE_HZ, TIMES_S[-1] + step_s, step_s)
    acting = np.concatenate([motion.forces(grid_s), motion.tilts(grid_s)])[:, 0]
    # What the baseline has is the tilts as they are; at rest they went through the filter long ago.
    known = np.concatenate([np.zeros((2, TIMES_S.size)), motion.tilts(TIMES_S)[:, 0]])
    for found, force, there in zip(motion.filtered(cutoff_hz, TIMES_S)[:, 0], acting, known, strict=True):
        _, simulated, _ = signal.lsim((above, below), force - force[0], grid_s - grid_s[0])
        simulated = force[0] + np.interp(TIMES_S, grid_s, simulated) * 10.0 ** (0.1 / 20.0) - there
        assert found == pytest.approx(simulated, abs=2e-3 * np.abs(simulated).max())


@pytest.mark.parametrize("law", [cycloid, quintic])
def test_turning_the_other_way_changes_the_sign_of_the_acceleration_and_of_the_sine(
    law: Callable[[FloatArray], FloatArray],
) -> None:
    same = np.array([1.0, -1.0, 1.0, -1.0])[:, None, None]
    found = turned(law).filtered(4.0, TIMES_S)
    assert turned(law, -1.0).filtered(4.0, TIMES_S) == pytest.approx(same * found, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("law", [cycloid, quintic])
def test_both_laws_of_motion_controllers_are_known_to_a_small_part_of_a_sample(
    law: Callable[[FloatArray], FloatArray],
) -> None:
    """The encoder's noise is no motion: between the last samples of a turn its acceleration is that of the law."""
    t = (np.arange(60) - BEFORE + 0.5) / RATE_HZ
    noise_rad = np.random.default_rng(3).normal(0.0, 5e-6, t.size)
    motion = motion_of(law(np.clip((t + TURN_S - 0.3) / TURN_S, 0.0, 1.0)) + noise_rad, BEFORE, RATE_HZ)
    assert motion.of_a_law
    assert (motion.first_s[0], motion.last_s[0]) == pytest.approx((0.3 - TURN_S, 0.3), abs=1e-3)
    times_s = np.array([-1.0, 0.1, 0.2])
    step_s = 1e-4
    course = [law((times_s + k * step_s + TURN_S - 0.3) / TURN_S) for k in (-1, 0, 1)]
    turning = (course[0] - 2.0 * course[1] + course[2]) / step_s**2
    assert motion.forces(times_s)[1, 0] == pytest.approx(turning, rel=2e-3)


def test_a_turn_by_another_law_ends_where_the_angle_does_for_all_its_noise() -> None:
    t = (np.arange(60) - BEFORE + 0.5) / RATE_HZ
    u = np.clip((t + TURN_S - 0.3) / TURN_S, 0.0, 1.0)
    noise_rad = np.random.default_rng(3).normal(0.0, 5e-6, t.size)
    motion = motion_of(np.pi * u**2 * (3.0 - 2.0 * u) + noise_rad, BEFORE, RATE_HZ)
    assert not motion.of_a_law
    assert motion.last_s[0] == pytest.approx(0.3, abs=1.0 / RATE_HZ)


@pytest.mark.parametrize("law", [cycloid, quintic])
def test_a_late_turn_leaves_its_forces_and_what_is_left_to_turn(law: Callable[[FloatArray], FloatArray]) -> None:
    found = turned(law).late(0.4, TIMES_S)[:, 0]
    to_go = [law(np.clip((TIMES_S - late + TURN_S - 0.3) / TURN_S, 0.0, 1.0)) - np.pi for late in (0.4, 0.0)]
    assert found[2] == pytest.approx(np.cos(to_go[0]) - np.cos(to_go[1]), abs=1e-5)
    assert found[3] == pytest.approx(np.sin(to_go[0]) - np.sin(to_go[1]), abs=1e-5)


def test_what_varies_slowly_comes_through_the_filter_late_by_the_slope_of_its_phase() -> None:
    above, below = signal.ellip(8, 0.1, 80.0, 2.0 * np.pi * 2.0, analog=True)
    _, answer = signal.freqs(above, below, [1e-3])
    assert filter_delay_s(2.0) == pytest.approx(-np.angle(answer[0]) / 1e-3, rel=1e-3)


@pytest.mark.parametrize("law", [cycloid, quintic, lambda u: np.pi * u**2 * (3.0 - 2.0 * u)])
def test_turns_worked_out_together_are_those_worked_out_alone(
    law: Callable[[FloatArray], FloatArray],
) -> None:
    alone = [turned(law), turned(law, -1.0), turned(law, 0.5)]
    together = Motions.stacked(alone)
    for found, each in zip(together.filtered(4.0, TIMES_S).swapaxes(0, 1), alone, strict=True):
        assert found == pytest.approx(each.filtered(4.0, TIMES_S)[:, 0], rel=1e-12)
    for found, each in zip(together.late(0.3, TIMES_S).swapaxes(0, 1), alone, strict=True):
        assert found == pytest.approx(each.late(0.3, TIMES_S)[:, 0], rel=1e-12)
