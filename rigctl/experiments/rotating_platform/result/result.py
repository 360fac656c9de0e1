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

from rigctl.experiments.rotating_platform.model.recorded_runs import Recorded
from rigctl.experiments.rotating_platform.observe.channel_runs import ChannelRun
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains
from rigctl.experiments.rotating_platform.observe.run_noise import SIDED
from rigctl.experiments.rotating_platform.result.alignment import Value, wobble
from rigctl.experiments.rotating_platform.result.chain_noise import ChainNoise, NoiseRecord
from rigctl.experiments.rotating_platform.result.run_result import RunResult, run_result

NOT_TESTED = ("theta-locked-bias", "pendulum-reaction")
"""Effects that no modulation shows: they turn with the platform as an acceleration does."""


@dataclass(frozen=True)
class PlatformResult:
    """The recording: `tilt_gain` and accelerations of the fit, wobbles where the electrical biases are known."""

    tilt_gain: Value
    accel_m_s2: Mapping[str, Value]
    wobble_rad: Mapping[str, Value] | None
    runs: tuple[RunResult, ...]
    left_out: Mapping[str, str]
    chain_noise: Mapping[str, ChainNoise]
    noise_records: tuple[NoiseRecord, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl result --json`."""
        return {
            "tilt_gain": self.tilt_gain.as_json(),
            "accel_m_s2": _each_as_json(self.accel_m_s2),
            "wobble_rad": None if self.wobble_rad is None else _each_as_json(self.wobble_rad),
            "sided": SIDED,
            "theory_noise": {channel: noise.as_json() for channel, noise in self.chain_noise.items()},
            "noise": [each.as_json() for each in self.noise_records],
            "not_tested": list(NOT_TESTED),
            "runs": [run.as_json() for run in self.runs],
            "left_out": dict(self.left_out),
        }


def _each_as_json(values: Mapping[str, Value]) -> dict[str, Any]:
    return {name: value.as_json() for name, value in values.items()}


def platform_result(
    recorded: Recorded,
    chains: Chains,
    fitted: Mapping[str, Value],
    left_out: Mapping[str, str],
    noises: Mapping[str, ChainNoise],
    noise_records: Sequence[NoiseRecord] = (),
) -> PlatformResult:
    """The result of a recording; `fitted` are the parameters of its model by name."""
    believed = {channel: each.noise.in_units_of(chains.gain_v_per_m_s2[channel]) for channel, each in noises.items()}
    by_run: dict[str, list[ChannelRun]] = {}
    for each in recorded.channels:
        by_run.setdefault(each.run.run_id, []).append(each)
    runs = tuple(run_result(channels, believed) for channels in by_run.values())
    return PlatformResult(
        fitted["tilt_gain"],
        {"y": fitted["accel_y0"], "z": fitted["accel_z0"]},
        _wobbles(runs, chains),
        runs,
        left_out,
        noises,
        tuple(noise_records),
    )


def _wobbles(runs: Sequence[RunResult], chains: Chains) -> dict[str, Value] | None:
    """Of the two sensing axes, from the biases of all runs; None without both electrical biases."""
    if set(chains.bias_v) != set(CHANNELS) or not runs:
        return None
    wobbles = {}
    for name, channel in (("a", "z"), ("b", "y")):
        biases = np.array([run.values[channel]["bias"].value for run in runs])
        biases = biases[np.isfinite(biases)]
        if not biases.size:
            return None
        alone = min(run.values[channel]["bias"].sigma for run in runs)
        # From run to run: bias noise has no finite variance, and what one run says of itself is too small.
        sigma = float(biases.std(ddof=1) / math.sqrt(biases.size)) if biases.size > 1 else alone
        wobbles[name] = wobble(
            Value(float(biases.mean()), sigma),
            # Constants of a recording come without an uncertainty.
            Value(chains.bias_v[channel], 0.0),
            Value(chains.gain_v_per_m_s2[channel], 0.0),
            chains.g_m_s2,
        )
    return wobbles
