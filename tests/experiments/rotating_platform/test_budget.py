"""The budget of the platform's results: against Monte Carlo, and against twins whose natures are drawn from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.platform_sampler import BIASES, GAINS, SampledRun, sampled
from rigctl.experiments.rotating_platform.analysis import results_of
from rigctl.experiments.rotating_platform.observe.recorded import Chains
from rigctl.experiments.rotating_platform.result.alignment import MeanBias
from rigctl.experiments.rotating_platform.result.budget import PlatformBudget, platform_budget
from rigctl.experiments.rotating_platform.result.chain_noise import chain_noise
from rigctl.experiments.rotating_platform.result.result import platform_result
from rigctl.experiments.rotating_platform.study import PlatformStudy
from rigctl.files.rig_file import parse_rig
from rigctl.workbench.verdict.attempt import Attempt
from simulators.worlds.platform_settings import PlatformSettings

CHAINS = Chains(
    gain_v_per_m_s2={"z": 846.73, "y": 804.32},
    command_v_per_m_s2={"z": 825.0, "y": 805.0},
    bias_v={"z": 0.2221, "y": -0.0527},
    full_scale_v={"z": 10.0, "y": 10.0},
    g_m_s2=9.81,
)
FITTED = np.array([0.964, 2.9e-4, -3.0e-4])
COVARIANCE = np.array([[1e-8, -3e-12, 0.0], [-3e-12, 4e-15, 1e-15], [0.0, 1e-15, 9e-15]])
WANDERING = {"z": MeanBias(1.054e-3, 2e-7, 8.0), "y": MeanBias(-1.433e-3, 3e-7, 8.0)}
U = {"gain_q_a_v_per_m_s2": 0.85, "gain_q_b_v_per_m_s2": 0.8, "g_m_s2": 1e-3, "bias_q_a_v": 0.04, "bias_q_b_v": 0.03}
ANGLES = {"zero_deg": 0.2, "half_turn_deg": 0.1}


def made(uncertainties: Mapping[str, Mapping[str, float]]) -> PlatformBudget:
    return platform_budget(FITTED, COVARIANCE, WANDERING, CHAINS, uncertainties)


def test_without_certificates_the_fit_is_all_there_is() -> None:
    found = made({})
    assert found.first.outputs == ("tilt_gain", "accel_z", "accel_y", "wobble_a", "wobble_b")
    assert found.first.values[:3] == pytest.approx(FITTED, rel=1e-12, abs=0.0)
    assert found.covariance[:3, :3] == pytest.approx(COVARIANCE, rel=1e-9, abs=1e-22)
    assert found.first.standard_uncertainty[3:] == pytest.approx([2e-7 / 9.81, 3e-7 / 9.81], rel=1e-9)
    assert found.check.validated == (True,) * 5


def test_what_two_outputs_share_correlates_them() -> None:
    """By hand: d a/a = -dG/G, wobble = (V/G - b)/g with b as 1/G, and angles turn y into z."""
    found = made({"constants": U, "platform": ANGLES})
    a_z, a_y = FITTED[1:]
    turned = math.hypot(math.radians(0.2), 0.5 * math.radians(0.1))
    assert found.first.standard_uncertainty[1] == pytest.approx(
        math.sqrt(4e-15 + (a_z * 0.85 / 846.73) ** 2 + (a_y * turned) ** 2), rel=1e-5
    )
    assert found.first.standard_uncertainty[0] == pytest.approx(1e-4, rel=1e-9)
    wobble = (0.2221 / 846.73 - 1.054e-3) / 9.81
    parts = (2e-7 / 9.81, 0.04 / 846.73 / 9.81, wobble * 0.85 / 846.73, wobble * 1e-3 / 9.81)
    assert found.first.standard_uncertainty[3] == pytest.approx(math.sqrt(sum(each**2 for each in parts)), rel=1e-5)
    # Both go as one over the scale factor of z.
    both = a_z * wobble * (0.85 / 846.73) ** 2
    assert found.covariance[1, 3] == pytest.approx(both, rel=1e-3, abs=0.0)
    between = 1e-15 - a_z * a_y * turned**2
    assert found.covariance[1, 2] == pytest.approx(between, rel=1e-3, abs=0.0)
    assert all(found.check.validated), found.check.reason


def test_a_gain_that_nothing_tells_and_no_electrical_bias() -> None:
    held = np.diag([0.0, 4e-15, 9e-15])
    found = platform_budget(np.array([1.0, *FITTED[1:]]), held, {}, CHAINS, {"constants": U})
    assert found.first.outputs == ("tilt_gain", "accel_z", "accel_y")
    assert found.first.standard_uncertainty[0] == 0.0
    assert found.as_json()["expanded_95"][1] == pytest.approx(1.96 * found.first.standard_uncertainty[1], rel=1e-3)


TWINS = 30
CAMPAIGNS = Path(__file__).parents[3] / "campaigns"


def test_pulls_of_twins_drawn_from_the_budget_are_standard_normal() -> None:
    """Scale factors, electrical biases and gravity are drawn from what the rig file states of them."""
    rig = (CAMPAIGNS / "bias-rejection-rig.toml").read_text(encoding="utf-8")
    stated = parse_rig(rig, Path("rig file")).uncertainties["constants"]
    assert {name: stated[name] for name in U} == U
    pulls = np.array([_pulls(seed, rig) for seed in range(TWINS)])
    spread = np.sqrt((pulls**2).mean(axis=0))
    # The fit's noise comes from a run's own periods, and a bias has no finite variance: u of the electrical biases is
    # large enough to hold both.
    assert np.all(np.abs(spread - 1.0) < 3.3 / math.sqrt(2 * TWINS)), spread
    assert np.all(np.abs(pulls.mean(axis=0)) < 3.3 / math.sqrt(TWINS)), pulls.mean(axis=0)


def _believed() -> list[tuple[str, float]]:
    return list({**GAINS, **BIASES, "g_m_s2": 9.81}.items())


def _pulls(seed: int, rig_toml: str) -> list[float]:
    """Accelerations and wobbles of a twin, less nature's, over the budget's uncertainties."""
    rng = np.random.default_rng([14, seed])
    drawn = {name: value + U.get(name, 0.0) * float(rng.standard_normal()) for name, value in _believed()}
    g_m_s2 = drawn["g_m_s2"]
    nature = PlatformSettings.model_validate(
        {
            "kind": "rotating-platform",
            "seed": 5000 + seed,
            "g_m_s2": g_m_s2,
            "chain_a": {
                "scale_v_per_m_s2": drawn["gain_q_a_v_per_m_s2"],
                "amplifier": 1010.9,
                "bias_v": drawn["bias_q_a_v"],
                "wobble_rad": -8.07e-5,
            },
            "chain_b": {
                "scale_v_per_m_s2": drawn["gain_q_b_v_per_m_s2"],
                "amplifier": 990.54,
                "bias_v": drawn["bias_q_b_v"],
                "wobble_rad": 1.394e-4,
            },
        }
    )
    recording = sampled(nature, [SampledRun("c", 60.0, 12, v_z_v=level) for level in (0.0, 1.0)])
    recording = replace(recording, header=replace(recording.header, rig_toml=rig_toml))
    study = PlatformStudy(recording)
    noises = chain_noise(recording.header, ())
    first = platform_result(study.recorded, recording.header, results_of(Attempt(study, ())), {}, noises).budget.first
    servo_z, servo_y = nature.servo_z, nature.servo_y
    truth = [
        -servo_z.bias_v / servo_z.scale_v_per_m_s2 - g_m_s2 * servo_z.misalignment_rad,
        -servo_y.bias_v / servo_y.scale_v_per_m_s2 - g_m_s2 * servo_y.misalignment_rad,
        -8.07e-5,
        1.394e-4,
    ]
    return ((first.values[1:] - truth) / first.standard_uncertainty[1:]).tolist()
