"""Small sensing-axis results, fitted to recordings made from the formulas alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigctl.effects.catalogue import chosen
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.reduction import observables, reduce_run
from rigctl.experiments.sensing_axis.result import budget
from rigctl.experiments.sensing_axis.result.result import SensingAxisResult, sensing_axes
from rigctl.files.package import HeadSettings, Package

G, RHO1, AMPLITUDE_M = 9.803, 9.7e-5, 5e-3
TRUE_AXES = {"X": (1.0, 0.002, 0.008), "Y": (-0.006, 1.0, -0.002), "Z": (-0.012, 0.0024, 1.0)}
GAINS = {"pendulum": 59.7, "flag": 100.0}
TILT_DEG = 5.0
POSITIONS = {"laser_1_mm": "+x", "laser_2_mm": "+y", "laser_3_mm": "+z"}
SCATTER_RAD = math.radians(12.5 / 3600.0)
UNCERTAINTIES = {"stage": {"yaw_rad_per_m": 5.6e-5}, "laser_1_mm": {"tilt_deg": 0.05, "scale": 1e-4}}


def package_of(axes: Sequence[str]) -> Package:
    sensors = {c: {"gain_v_per_m_s2": k, "frequency_hz": 4.0, "q": 10.0} for c, k in GAINS.items()}
    return Package.model_validate(
        {
            "requirement_arcsec": 100.0,
            "name": "ISA",
            "axes": {
                name: {"cube_axis": name, "nominal": np.eye(3)["XYZ".index(name)].tolist(), "sensor": sensors}
                for name in axes
            },
            "configurations": {
                "pendulum": {"i": "+y", "j": "+z", "k": "+x"},
                "flag": {"i": "+y", "j": "+x", "k": "-z"},
            },
        }
    )


def samples_of(
    rng: np.random.Generator, pose: np.ndarray, sensing: np.ndarray, gain: float, frequency_hz: float, lasers: bool
) -> Mapping[str, np.ndarray]:
    """One record: inertia and rolled gravity along the sensing axis; each head sees its face along its beam."""
    t = np.arange(2500) / 100.0
    x = AMPLITUDE_M * np.sin(2.0 * math.pi * frequency_hz * t)
    felt = sensing[0] * -((2.0 * math.pi * frequency_hz) ** 2) * x + sensing[1] * G * RHO1 * x
    samples = {"t_s": t, "stage_x_mm": 1e3 * x, "accel_v": gain * felt + 4e-4 * rng.standard_normal(t.size)}
    side, up = math.cos(math.radians(TILT_DEG)), math.sin(math.radians(TILT_DEG))
    beams = {"laser_1_mm": (side, 0, up), "laser_2_mm": (0, side, up), "laser_3_mm": (up, 0, side)}
    for i, (name, beam) in enumerate(beams.items()):
        normal = pose[:, i]
        if lasers:
            samples[name] = 1e3 * x * normal[0] / (np.array(beam) @ normal) + 5e-5 * rng.standard_normal(t.size)
    return samples


def result_of(
    axes: Sequence[str] = ("X",),
    configurations: Sequence[str] = ("pendulum", "flag"),
    mountings: int = 2,
    *,
    lasers: bool = True,
    drives: Sequence[tuple[float, float]] = ((0.0, 0.6), (0.3, 0.6), (0.3, 0.3)),
    seed: int = 1,
) -> SensingAxisResult:
    """A fitted campaign with roll in its model; `drives` are (angle / deg, frequency / Hz) of each mounting."""
    rng = np.random.default_rng(seed)
    package = package_of(axes)
    runs, mounting = [], 0
    for axis in axes:
        for configuration in configurations:
            for _ in range(mountings):
                mounting += 1
                delta = rng.normal(0.0, 2e-3, 3)
                mount = Rotation.from_rotvec(delta).as_matrix()
                seated = np.array(TRUE_AXES[axis]) + SCATTER_RAD * rng.standard_normal(3)
                on_turntable = mount @ package.turntable_from_cube(axis, configuration) @ seated
                for theta_deg, frequency_hz in drives:
                    turn = Rotation.from_euler("z", theta_deg, degrees=True).as_matrix()
                    samples = samples_of(
                        rng, turn @ mount, turn @ on_turntable, GAINS[configuration], frequency_hz, lasers
                    )
                    conditions = {
                        "axis": axis,
                        "configuration": configuration,
                        "mounting": mounting,
                        "theta_deg": theta_deg,
                        "frequency_hz": frequency_hz,
                        "approach": 1,
                        "temperature_c": 20.0,
                        "start_s": 60.0 * len(runs),
                    }
                    runs.append(reduce_run(str(len(runs) + 1), conditions, samples))
    heads = {name: HeadSettings(position=place, tilt_deg=TILT_DEG) for name, place in POSITIONS.items()}
    effects = chosen("sensing-axis", ["roll-gravity"])
    return sensing_axes(RecordingModel(observables(runs), package, heads, G, effects))


@pytest.fixture(scope="session")
def two_axes() -> SensingAxisResult:
    return result_of(("X", "Z"))


@pytest.fixture(scope="session")
def one_configuration() -> SensingAxisResult:
    return result_of(configurations=("pendulum",))


@pytest.fixture(scope="session")
def without_lasers() -> SensingAxisResult:
    return result_of(lasers=False)


@pytest.fixture(scope="session")
def uncertainties() -> Mapping[str, Mapping[str, float]]:
    return UNCERTAINTIES


@pytest.fixture(scope="module", autouse=True)
def few_draws() -> Iterator[None]:
    """The budget's own check by Monte Carlo is tested elsewhere; no figure shows it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budget, "MONTE_CARLO_DRAWS", 20)
        yield
