"""Where the stages really are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulators.motion import MotionAxis
from simulators.worlds.bench_settings import BenchSettings, isa_twin
from simulators.worlds.stages import Stages

STEP_DEG = 0.0001
IMPERFECT = {"resolution_deg": STEP_DEG, "error_steps": 0.5}


def settings(**changes: object) -> BenchSettings:
    return BenchSettings.model_validate(isa_twin().model_dump() | changes)


def error_rad(stages: Stages, rotation: MotionAxis, angle_deg: float) -> float:
    rotation.place(0.0, angle_deg)
    return float(stages.angle_rad(np.array([1.0]))[0]) - math.radians(angle_deg)


def test_the_encoder_is_off_by_up_to_half_a_step_and_always_the_same_at_the_same_place() -> None:
    rotation = MotionAxis()
    stages = Stages(settings(angle=IMPERFECT), rotation, MotionAxis())
    angles = STEP_DEG * np.arange(-300, 300)
    errors = np.array([error_rad(stages, rotation, a) for a in angles]) / math.radians(STEP_DEG)
    assert np.max(np.abs(errors)) <= 0.5
    assert errors.std() == pytest.approx(1.0 / math.sqrt(12.0), abs=0.04)
    assert abs(errors.mean()) < 5.0 / math.sqrt(12.0 * 600)
    assert abs(np.corrcoef(errors[1:], errors[:-1])[0, 1]) < 0.2
    assert error_rad(stages, rotation, angles[10]) / math.radians(STEP_DEG) == errors[10]


def test_the_twin_s_encoder_reads_where_the_stage_is() -> None:
    rotation = MotionAxis()
    assert error_rad(Stages(settings(), rotation, MotionAxis()), rotation, 0.123) == 0.0


def test_another_seed_has_another_encoder() -> None:
    rotation = MotionAxis()
    one, other = (Stages(settings(seed=s, angle=IMPERFECT), rotation, MotionAxis()) for s in (1, 2))
    assert error_rad(one, rotation, 0.5) != error_rad(other, rotation, 0.5)


def test_eccentricity_bends_the_scale() -> None:
    rotation = MotionAxis()
    effects = {"encoder-eccentricity": {"e1": 2e-4, "e2": 5e-4}}
    stages = Stages(settings(effects=effects, angle={"error_steps": 0.0}), rotation, MotionAxis())
    for angle_deg in (-120.0, 0.0, 30.0, 90.0):
        a = math.radians(angle_deg)
        expected = 2e-4 * math.cos(a) + 5e-4 * math.sin(a)
        assert error_rad(stages, rotation, angle_deg) == pytest.approx(expected, abs=1e-12)


def test_hysteresis_goes_with_the_direction_of_approach() -> None:
    rotation = MotionAxis()
    effects = {"cable-hysteresis": {"h": 3e-5}}
    stages = Stages(settings(effects=effects, angle={"error_steps": 0.0}), rotation, MotionAxis())
    assert stages.angle_rad(np.array([1.0]))[0] == 0.0
    end = rotation.move_to(2.0, 1.0, 5.0, 20.0)
    end = rotation.move_to(end, 0.5, 5.0, 20.0)
    assert stages.angle_rad(np.array([end + 1.0]))[0] == pytest.approx(math.radians(0.5) - 3e-5, abs=1e-12)
    end = rotation.move_to(end + 2.0, 0.7, 5.0, 20.0)
    assert stages.angle_rad(np.array([end + 1.0]))[0] == pytest.approx(math.radians(0.7) + 3e-5, abs=1e-12)


def test_the_direction_of_approach_outlives_the_axis_memory() -> None:
    rotation = MotionAxis()
    end = rotation.move_to(0.0, -1.0, 5.0, 20.0)
    for later in (500.0, 1000.0, 1500.0):
        rotation.move_to(end + later, -1.0, 5.0, 20.0)
    np.testing.assert_array_equal(rotation.directions(np.array([end + 1600.0])), [-1.0])


def test_directions_follow_a_move_and_its_reversal() -> None:
    rotation = MotionAxis()
    there = rotation.move_to(10.0, 2.0, 5.0, 20.0)
    back = rotation.move_to(there + 1.0, 0.0, 5.0, 20.0)
    times = np.array([5.0, 10.1, there + 0.5, there + 1.1, back, back + 50.0])
    np.testing.assert_array_equal(rotation.directions(times), [0.0, 1.0, 1.0, -1.0, -1.0, -1.0])


def test_travel_is_the_linear_stage_in_si() -> None:
    linear = MotionAxis()
    linear.oscillate(0.0, 0.5, [4.0], math.inf)
    x, a = Stages(settings(), MotionAxis(), linear).travel(np.array([0.0, 1.0]))
    np.testing.assert_allclose(x, [0.0, 8e-3], atol=1e-15)
    np.testing.assert_allclose(a, [4e-3 * math.pi**2, -4e-3 * math.pi**2])
