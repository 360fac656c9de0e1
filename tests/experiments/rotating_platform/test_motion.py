"""What an anti-alias filter makes of a turn: against the same filter as an ordinary differential equation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import signal

from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.model.motion import Motion, motion_of

RATE_HZ, TURN_S, BEFORE = 8.0, 4.0, 40
TIMES_S: FloatArray = np.asarray((np.arange(-8, 80) + 0.5) / RATE_HZ)


def cycloid(u: FloatArray) -> FloatArray:
    return np.asarray(np.pi * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi)))


def quintic(u: FloatArray) -> FloatArray:
    return np.asarray(np.pi * u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def turned(law: Callable[[FloatArray], FloatArray], way: float = 1.0) -> Motion:
    """A turn of which some tenths of a second are not masked."""
    t = (np.arange(60) - BEFORE + 0.5) / RATE_HZ
    return motion_of(way * law(np.clip((t + TURN_S - 0.3) / TURN_S, 0.0, 1.0)), BEFORE, RATE_HZ)


@pytest.mark.parametrize("cutoff_hz", [0.7, 4.0, 20.0])
@pytest.mark.parametrize("law", [cycloid, quintic])
def test_a_filtered_turn_is_that_of_the_differential_equation(
    law: Callable[[FloatArray], FloatArray], cutoff_hz: float
) -> None:
    """scipy's simulation of the filter, its input straight between nodes that lie close together."""
    motion = turned(law)
    above, below = signal.ellip(8, 0.1, 80.0, 2.0 * np.pi * cutoff_hz, analog=True)
    step_s = 1.0 / (RATE_HZ * 2 * round(100.0 * max(cutoff_hz, 1.0) / RATE_HZ + 1.0))
    grid_s = np.arange(round(motion.first_s * RATE_HZ - 1) / RATE_HZ, TIMES_S[-1] + step_s, step_s)
    for found, force in zip(motion.filtered(cutoff_hz, TIMES_S), motion.forces(grid_s), strict=True):
        _, simulated, _ = signal.lsim((above, below), force, grid_s - grid_s[0])
        simulated = np.interp(TIMES_S, grid_s, simulated) * 10.0 ** (0.1 / 20.0)
        assert found == pytest.approx(simulated, abs=2e-3 * np.abs(simulated).max())


@pytest.mark.parametrize("law", [cycloid, quintic])
def test_turning_the_other_way_changes_the_sign_of_the_acceleration_alone(
    law: Callable[[FloatArray], FloatArray],
) -> None:
    squared, turning = turned(law).filtered(4.0, TIMES_S)
    other_squared, other_turning = turned(law, -1.0).filtered(4.0, TIMES_S)
    assert other_squared == pytest.approx(squared, rel=1e-6, abs=1e-9)
    assert other_turning == pytest.approx(-turning, rel=1e-6, abs=1e-9)


def test_a_filtered_spline_takes_about_as_many_steps_as_there_are_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it costs does not grow with the filter's cut-off."""
    steps: list[int] = []
    filtered = signal.lfilter

    def counted(above: FloatArray, below: FloatArray, given: FloatArray) -> FloatArray:
        steps.append(given.shape[-1])
        return np.asarray(filtered(above, below, given))

    monkeypatch.setattr(signal, "lfilter", counted)
    turned(quintic).filtered(100.0, TIMES_S)
    assert max(steps) <= 60
