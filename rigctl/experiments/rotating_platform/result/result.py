"""What a recording of the rotating platform amounts to: the tilt's gain, the accelerations, the biases, run by run.

Means and precisions are those of the paper's projection wherever a run's mask is as it was planned; a period with
faults, and a run whose turns wander, is fitted jointly to what is left (Lenoir, Christophe, Reynaud, Measurement 46
(2013) 1411; `estimates`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.campaign.recording import Header
from rigctl.campaign.stated import uncertainties_of
from rigctl.experiments.rotating_platform.model.recorded_runs import Recorded
from rigctl.experiments.rotating_platform.observe.channel_runs import ChannelRun
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, chains
from rigctl.experiments.rotating_platform.observe.run_noise import SIDED
from rigctl.experiments.rotating_platform.result.alignment import Fitted, MeanBias, Value
from rigctl.experiments.rotating_platform.result.budget import SENSORS, PlatformBudget, platform_budget
from rigctl.experiments.rotating_platform.result.chain_noise import ChainNoise, NoiseRecord
from rigctl.experiments.rotating_platform.result.run_result import RunResult, run_result

RESULTS = ("tilt_gain", "accel_z0", "accel_y0")
"""The parameters of a model that are results."""

NOT_TESTED = ("theta-locked-bias", "pendulum-reaction")
"""Effects that no modulation shows: they turn with the platform as an acceleration does."""


@dataclass(frozen=True)
class PlatformResult:
    """The recording: `tilt_gain` and accelerations of the fit, wobbles where the electrical biases are known."""

    budget: PlatformBudget
    tilt_gain: Value
    accel_m_s2: Mapping[str, Value]
    wobble_rad: Mapping[str, Value] | None
    runs: tuple[RunResult, ...]
    left_out: Mapping[str, str]
    chain_noise: Mapping[str, ChainNoise]
    noise_records: tuple[NoiseRecord, ...] = ()
    warnings: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl result --json`."""
        return {
            "tilt_gain": self.tilt_gain.as_json(),
            "accel_m_s2": _each_as_json(self.accel_m_s2),
            "budget": self.budget.as_json(),
            "wobble_rad": None if self.wobble_rad is None else _each_as_json(self.wobble_rad),
            "sided": SIDED,
            "theory_noise": {channel: noise.as_json() for channel, noise in self.chain_noise.items()},
            "noise": [each.as_json() for each in self.noise_records],
            "not_tested": list(NOT_TESTED),
            "runs": [run.as_json() for run in self.runs],
            "left_out": dict(self.left_out),
            "warnings": list(self.warnings),
        }


def _each_as_json(values: Mapping[str, Value]) -> dict[str, Any]:
    return {name: value.as_json() for name, value in values.items()}


def platform_result(
    recorded: Recorded,
    header: Header,
    fitted: Fitted,
    left_out: Mapping[str, str],
    noises: Mapping[str, ChainNoise],
    noise_records: Sequence[NoiseRecord] = (),
    warnings: Sequence[str] = (),
) -> PlatformResult:
    """The result of a recording; `fitted` are `RESULTS` of its model, `warnings` what speaks against that fit."""
    believed = chains(header)
    noise = {channel: each.noise.in_units_of(believed.gain_v_per_m_s2[channel]) for channel, each in noises.items()}
    by_run: dict[str, list[ChannelRun]] = {}
    for each in recorded.channels:
        by_run.setdefault(each.run.run_id, []).append(each)
    runs = tuple(run_result(channels, noise, believed.command_v_per_m_s2["z"]) for channels in by_run.values())
    biases = _biases(runs) if set(believed.bias_v) == set(CHANNELS) else {}
    budget = platform_budget(fitted.values, fitted.covariance, biases, believed, uncertainties_of(header))
    told = {
        name: Value(float(value), float(sigma))
        for name, value, sigma in zip(
            budget.first.outputs, budget.first.values, budget.first.standard_uncertainty, strict=True
        )
    }
    return PlatformResult(
        budget,
        fitted.quantity("tilt_gain"),
        {axis: fitted.quantity(f"accel_{axis}0") for axis in ("y", "z")},
        {name: told[f"wobble_{name}"] for name in SENSORS} if biases else None,
        runs,
        left_out,
        noises,
        tuple(noise_records),
        tuple(warnings),
    )


def _biases(runs: Sequence[RunResult]) -> dict[str, MeanBias]:
    """Of both channels, from all runs; empty where one has none."""
    biases = {}
    for channel in CHANNELS:
        means = np.array([run.values[channel]["bias"].value for run in runs])
        means = means[np.isfinite(means)]
        if not means.size:
            return {}
        # From run to run: bias noise has no finite variance, and what one run says of itself is too small.
        if means.size > 1:
            scatter = float(means.std(ddof=1)) / math.sqrt(means.size)
            biases[channel] = MeanBias(float(means.mean()), scatter, means.size - 1.0)
        else:
            biases[channel] = MeanBias(float(means[0]), min(r.values[channel]["bias"].sigma for r in runs), math.inf)
    return biases
