"""Shapes in proportion to the sensor's signal, held to readings of the second world, which knows nothing of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.composition import opened_workbench
from rigctl.core.arrays import FloatArray
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.description import described
from rigctl.workbench.verdict.generic import Best
from rigctl.workbench.verdict.score import Score
from rigctl.workbench.verdict.shapes import Shape
from tests.foreign.isa_bundle import Noise, write
from tests.foreign.isa_trial import drawn
from tests.foreign.isa_world import Bench
from tests.foreign.sessions import run

QUIET = Noise(
    white_v=1e-9, flicker_v_rthz=1e-11, exponent=1.0, bump_v_rthz=0.0, drifting_v=1e-9, laser_m=1e-13, stage_m=1e-15
)


def observed(bench: Bench, directory: Path) -> Observations:
    """What the bench of trial 4 reads, almost without noise, reduced."""
    directory.mkdir()
    write(drawn(4).design, bench, QUIET, 1, directory / "quiet")
    store = directory / "quiet.rig.sqlite"
    run("import", str(directory / "quiet"), "--store", str(store))
    with opened_workbench(store, readonly=True) as workbench:
        return workbench.study.model(()).observations


@pytest.fixture(scope="module")
def bench() -> Bench:
    return drawn(4).bench.with_effects({})


@pytest.fixture(scope="module")
def bare(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> Observations:
    return observed(bench, tmp_path_factory.mktemp("bare") / "in")


def cosine(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))


@pytest.mark.parametrize(
    ("parameter", "size", "name"),
    [("gain_per_percent", 1e-4, "signal*humidity_percent"), ("K3", 3.0, "signal^3")],
)
def test_a_template_is_what_the_world_does(
    bench: Bench, bare: Observations, tmp_path: Path, parameter: str, size: float, name: str
) -> None:
    """All harmonics of the sensor in all runs at once: two configurations with gains of their own, two amplitudes."""
    changed = observed(replace(bench, effects={parameter: size}), tmp_path / "in")
    sensor = np.array([each.channel == "accel_v" and each.component != "DC" for each in bare.series])[bare.series_of]
    change = np.where(sensor, changed.value - bare.value, 0.0)
    assert cosine(bare.templates[1, name], change) > 0.999


def test_a_template_is_told_without_a_power_of_the_frequency(bare: Observations) -> None:
    """It has its own way with the frequency; and the signal is no column."""
    score = Score(9.0, 1, np.inf, 0.0, np.ones(1), np.array([2.0]), np.array([0.1]), lambda: np.zeros((0, 1)))
    for covariate, words in (
        ("signal^3", "with the cube of the signal"),
        ("signal*humidity_percent", "in proportion to the signal, with humidity_percent"),
    ):
        shape = Shape(1, 0, 0, covariate)
        best = Best(shape, 9.0, 0.0, 0.0, 1.0, 1, np.zeros((0, 1)), shape, np.zeros((0, 1)))
        told = described(bare, best, score).description
        assert told == f"accel_v nu in-phase is off by 2 ± 0.1 V, {words} (size per standard deviation of it)"


def test_a_template_has_none_of_the_noise_of_its_own_readings(bench: Bench, tmp_path: Path) -> None:
    """Made of the readings it followed what a fit leaves: a null search of its own world was no longer adequate."""
    write(drawn(4).design, bench, replace(QUIET, white_v=1.0), 0, tmp_path / "loud")
    store = tmp_path / "loud.rig.sqlite"
    run("import", str(tmp_path / "loud"), "--store", str(store))
    with opened_workbench(store, readonly=True) as workbench:
        observations = workbench.study.model(()).observations
    by_name = {name: column for (_, name), column in observations.templates.items()}
    column, components = by_name["signal*start_s"], [each.component for each in observations.series]
    in_phase = observations.series_of == components.index("nu in-phase")
    # Quadrature and multiples of the drive have noise only, of a sensor without effects.
    assert np.abs(column[~in_phase]).max() == 0.0
    runs = observations.run_of[in_phase]
    start_s, theta, amplitude, frequency, mounting = (
        observations.covariates[name][runs]
        for name in ("start_s", "theta_deg", "amplitude_mm", "frequency_hz", "mounting")
    )
    signal = column[in_phase] / ((start_s - start_s.mean()) / start_s.std())
    for number in (1, 2):
        of_one = mounting == number
        force = (amplitude * frequency**2)[of_one]
        angle = np.radians(theta[of_one])
        force_by_angle = np.stack([force * np.sin(angle), force * np.cos(angle)], axis=1)
        along = np.linalg.lstsq(force_by_angle, signal[of_one], rcond=None)[0]
        # Of usual size 1; the noise of a single reading is a hundredth of that.
        assert np.abs(signal[of_one] - force_by_angle @ along).max() < 1e-4
