"""Recordings made from the physics with plain numpy and scipy's rotations: no code of the model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigctl.experiments.sensing_axis.observe.reduction import ReducedRun, reduce_run
from rigctl.files.package import HeadSettings, Package

G = 9.803
TILT = math.radians(5.0)
NOMINAL = {
    # Columns: where the cube's x, y, z point on the turntable.
    ("X", "pendulum"): np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    ("X", "flag"): np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    ("Y", "pendulum"): np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ("Y", "flag"): np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    ("Z", "pendulum"): np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    ("Z", "flag"): np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
}
SENSORS = {
    "pendulum": {"gain_v_per_m_s2": 59.7, "frequency_hz": 4.53, "q": 10.0},
    "flag": {"gain_v_per_m_s2": 100.0, "frequency_hz": 3.5, "q": 10.0},
}


@pytest.fixture
def package() -> Package:
    axes = {
        name: {"cube_axis": name, "nominal": nominal, "sensor": SENSORS}
        for name, nominal in (("X", (1, 0, 0)), ("Y", (0, 1, 0)), ("Z", (0, 0, 1)))
    }
    configurations = {"pendulum": {"i": "+y", "j": "+z", "k": "+x"}, "flag": {"i": "+y", "j": "+x", "k": "-z"}}
    return Package.model_validate({"name": "ISA", "axes": axes, "configurations": configurations})


@pytest.fixture
def heads() -> dict[str, HeadSettings]:
    return {
        f"laser_{i}_mm": HeadSettings(position=position, tilt_deg=5.0)  # type: ignore[arg-type]
        for i, position in ((1, "+x"), (2, "+y"), (3, "+z"))
    }


def measured_run(
    rng: np.random.Generator,
    *,
    axis: str = "X",
    configuration: str = "pendulum",
    mounting: int = 1,
    true_axis: Sequence[float] = (1.0, 0.002, 0.008),
    delta: Sequence[float] = (5e-3, 2e-3, -1e-3),
    theta_deg: float = 0.2,
    frequency_hz: float = 0.6,
    duration_s: float = 50.0,
    amplitude_m: float = 5e-3,
    rho1: float = 9.7e-5,
    gain_error: float = 0.0,
    noise_m_s2_rthz: float = 1e-6,
    laser_noise_m: float = 5e-8,
    null_shift_rad: float = 0.0,
    run_id: str = "1",
) -> ReducedRun:
    """One run as nature would give it: specific force along the turned and rolling axis, through the resonator.

    Where the guide yaws the sensor answers as if the stage stood elsewhere by `null_shift_rad`, and no laser sees it.
    """
    fs = 100.0
    t = np.arange(round(duration_s * fs)) / fs
    w = 2 * np.pi * frequency_hz
    phase = rng.uniform(0, 2 * np.pi)
    x = amplitude_m * np.sin(w * t + phase)
    turn = Rotation.from_euler("z", theta_deg, degrees=True).as_matrix()
    mount = turn @ Rotation.from_rotvec(delta).as_matrix() @ NOMINAL[axis, configuration]
    sensing = mount @ (np.asarray(true_axis) / np.linalg.norm(true_axis))
    sensing = Rotation.from_rotvec([0.0, 0.0, null_shift_rad]).apply(sensing)
    roll = Rotation.from_rotvec(np.outer(rho1 * x, [1.0, 0.0, 0.0])).as_matrix()
    rolled = roll @ sensing
    felt = rolled[:, 0] * (-(w**2) * x) + rolled[:, 2] * G
    felt -= felt.mean()
    nominal = SENSORS[configuration]
    w0 = 2 * np.pi * nominal["frequency_hz"]
    response = 1.0 / (1 - (w / w0) ** 2 + 1j * w / (w0 * nominal["q"]))
    sine, cosine = np.sin(w * t + phase), np.cos(w * t + phase)
    in_phase, quadrature = 2 * np.mean(felt * sine), 2 * np.mean(felt * cosine)
    ring = (in_phase + 1j * quadrature) * response
    volts = nominal["gain_v_per_m_s2"] * (1 + gain_error) * (ring.real * sine + ring.imag * cosine)
    noise = nominal["gain_v_per_m_s2"] * noise_m_s2_rthz * math.sqrt(fs / 2)
    samples = {"t_s": t, "stage_x_mm": 1e3 * x, "accel_v": volts + 0.1 + noise * rng.standard_normal(len(t))}
    beams = {
        "laser_1_mm": ([1, 0, 0], [math.cos(TILT), 0, math.sin(TILT)]),
        "laser_2_mm": ([0, 1, 0], [0, math.cos(TILT), math.sin(TILT)]),
        "laser_3_mm": ([0, 0, 1], [math.sin(TILT), 0, math.cos(TILT)]),
    }
    pose = turn @ Rotation.from_rotvec(delta).as_matrix()
    for name, (face, beam) in beams.items():
        normal = pose @ np.array(face)
        reading = x * normal[0] / (np.array(beam) @ normal)
        samples[name] = 1e3 * (reading + laser_noise_m * rng.standard_normal(len(t))) + 0.3
    conditions: dict[str, Any] = {
        "axis": axis,
        "configuration": configuration,
        "mounting": mounting,
        "theta_deg": theta_deg,
        "frequency_hz": frequency_hz,
        "approach": 1,
        "temperature_c": 20.0,
        "start_s": 0.0,
    }
    return reduce_run(run_id, conditions, samples)


def true_null_rad(axis: str, configuration: str, true_axis: Sequence[float], delta: Sequence[float]) -> float:
    """The stage angle at which the motion has no component along the sensing axis."""
    turned = Rotation.from_rotvec(delta).as_matrix() @ NOMINAL[axis, configuration] @ np.asarray(true_axis)
    return math.atan2(turned[0], turned[1])


@pytest.fixture
def make_run() -> Callable[..., ReducedRun]:
    return measured_run


@pytest.fixture
def null_of() -> Callable[..., float]:
    return true_null_rad
