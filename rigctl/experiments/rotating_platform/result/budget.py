"""Where the uncertainty of accelerations and wobbles comes from: a budget after the GUM, checked by Monte Carlo.

Noise of the fit and scatter of the biases between runs are statistics (type A); scale factors, electrical biases and
gravity are the rig file's constants with their `u`, the platform's angles its certificate (type B). The scale factor
of a sensor acts on its acceleration and on its wobble: what is common to two outputs is in their covariance. The gain
of the tilt compares two chains as they are believed to be, and has no uncertainty from them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.analysis.budget import Budget, Comparison, Contribution, Measurement, budget, compare, monte_carlo
from rigctl.analysis.measurement_result import Source, sources_of
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, READINGS, Chains
from rigctl.experiments.rotating_platform.result.alignment import MeanBias, wobble_of

SENSORS: Mapping[str, str] = {"a": "z", "b": "y"}
"""The paper's names of the sensors, and the channel of each."""

_DRAWS = 2000
_FITTED = ("tilt_gain", "accel_z", "accel_y")
_NOISE, _OF_ALL_RUNS = "noise of the fit", "fit of all runs"
_ZERO, _HALF_TURN, _GRAVITY = "zero of the platform", "half a turn", "gravity"


@dataclass(frozen=True)
class PlatformBudget:
    """The budget of the tilt's gain, of the accelerations [m/s2] and, where they are known, of the wobbles [rad]."""

    first: Budget
    check: Comparison

    @property
    def covariance(self) -> FloatArray:
        """Of the outputs, in their order: what they have in common correlates them."""
        return np.asarray(self.first.components @ self.first.components.T)

    @property
    def sources(self) -> list[Source]:
        """What the outputs are uncertain by; the fit's noise is one source, in whatever directions it is divided."""
        every = sources_of(self.first)
        fitted = [each for each in every if each.name in _directions()]
        noise = np.asarray(sum(each.covariance for each in fitted))
        others = [each for each in every if each.name not in _directions()]
        return [Source(_NOISE, "A", noise, fitted[0].dof, origin=_OF_ALL_RUNS), *others]

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        first = self.first
        return {
            "outputs": list(first.outputs),
            "values": first.values.tolist(),
            "contributions": [self._noise_row(), *self._other_rows()],
            "combined": first.standard_uncertainty.tolist(),
            "expanded_95": first.expanded.tolist(),
            "covariance": self.covariance.tolist(),
            "monte_carlo": {"validated": all(self.check.validated), "reason": self.check.reason},
        }

    def _noise_row(self) -> dict[str, Any]:
        """The fit's noise: its directions are independent only taken together."""
        directions = [each.name in _directions() for each in self.first.contributions]
        u = np.linalg.norm(self.first.components[:, directions], axis=1)
        return {"name": _NOISE, "type": "A", "input": "", "source": _OF_ALL_RUNS, "u": u.tolist()}

    def _other_rows(self) -> list[dict[str, Any]]:
        return [
            {
                "name": each.name,
                "type": each.type,
                "input": f"{each.standard_uncertainty:.3g} {each.unit}",
                "source": each.source,
                "u": np.abs(self.first.components[:, i]).tolist(),
            }
            for i, each in enumerate(self.first.contributions)
            if each.name not in _directions()
        ]


def platform_budget(
    values: FloatArray,
    covariance: FloatArray,
    biases: Mapping[str, MeanBias],
    chains: Chains,
    uncertainties: Mapping[str, Mapping[str, float]],
) -> PlatformBudget:
    """Of the fit's `values` tilt gain, acceleration along z and y with their `covariance`, shape (3,) and (3, 3).

    `biases` by channel, empty without both electrical biases; `uncertainties` are the rig file's.
    """
    contributions = [
        *_noise(),
        *_scale_factors(chains, uncertainties.get("constants", {})),
        *_angles(uncertainties.get("platform", {})),
        *(_of_wobbles(biases, chains, uncertainties.get("constants", {})) if biases else ()),
    ]
    outputs = [*_FITTED, *(f"wobble_{name}" for name in SENSORS if biases)]
    measured = _measurement(values, covariance, biases, chains)
    first = budget(measured, contributions, outputs)
    return PlatformBudget(first, compare(first, monte_carlo(measured, contributions, outputs, draws=_DRAWS, seed=1)))


def _measurement(
    values: FloatArray, covariance: FloatArray, biases: Mapping[str, MeanBias], chains: Chains
) -> Measurement:
    root = _root(covariance)

    def measured(given: Mapping[str, float]) -> FloatArray:
        gain, along_z, along_y = values + root @ np.array([given[name] for name in _directions()])
        gains = {channel: given[_scale_factor(channel)] for channel in CHANNELS}
        along_z *= chains.gain_v_per_m_s2["z"] / gains["z"]
        along_y *= chains.gain_v_per_m_s2["y"] / gains["y"]
        # A platform at rest beside 0 and half a turn shows each sensor some of what is along the other.
        turned_rad = given[_ZERO] + 0.5 * given[_HALF_TURN]
        outputs = [gain, along_z + turned_rad * along_y, along_y - turned_rad * along_z]
        for name, channel in SENSORS.items() if biases else ():
            bias = given[_bias(name)] * chains.gain_v_per_m_s2[channel] / gains[channel]
            outputs.append(wobble_of(bias, given[_electrical(name)], gains[channel], given[_GRAVITY]))
        return np.array(outputs)

    return measured


def _noise() -> list[Contribution]:
    """Directions of the fit's noise that are independent of each other."""
    return [Contribution(name, 0.0, 1.0, "sigma", "A", source="fit of all runs") for name in _directions()]


def _root(covariance: FloatArray) -> FloatArray:
    # A gain that nothing tells is held: its variance is zero, and a Cholesky factor there is none.
    size, turn = np.linalg.eigh(covariance)
    return np.asarray(turn * np.sqrt(np.maximum(size, 0.0)))


def _scale_factors(chains: Chains, constants: Mapping[str, float]) -> list[Contribution]:
    return [
        Contribution(
            _scale_factor(channel),
            chains.gain_v_per_m_s2[channel],
            constants.get(f"gain_{_column(channel)}_v_per_m_s2", 0.0),
            "V s2/m",
            source="constants",
        )
        for channel in CHANNELS
    ]


def _angles(certified: Mapping[str, float]) -> list[Contribution]:
    return [
        Contribution(name, 0.0, math.radians(certified.get(key, 0.0)), "rad", source="certificate of platform")
        for name, key in ((_ZERO, "zero_deg"), (_HALF_TURN, "half_turn_deg"))
    ]


def _of_wobbles(biases: Mapping[str, MeanBias], chains: Chains, constants: Mapping[str, float]) -> list[Contribution]:
    found = [Contribution(_GRAVITY, chains.g_m_s2, constants.get("g_m_s2", 0.0), "m/s2", source="constants")]
    for name, channel in SENSORS.items():
        bias, electrical_v = biases[channel], constants.get(f"bias_{_column(channel)}_v", 0.0)
        found += [
            Contribution(
                _bias(name),
                bias.value,
                bias.sigma,
                "m/s2",
                "A",
                "t" if math.isfinite(bias.dof) else "normal",
                bias.dof,
                "scatter between runs" if math.isfinite(bias.dof) else "noise of the run",
            ),
            Contribution(_electrical(name), chains.bias_v[channel], electrical_v, "V", source="constants"),
        ]
    return found


def _directions() -> list[str]:
    return [f"noise {number}" for number in range(1, len(_FITTED) + 1)]


def _column(channel: str) -> str:
    return READINGS[channel].removesuffix("_v")


def _scale_factor(channel: str) -> str:
    return f"scale factor of {channel}"


def _bias(sensor: str) -> str:
    return f"bias of sensor {sensor.upper()}"


def _electrical(sensor: str) -> str:
    return f"electrical bias of sensor {sensor.upper()}"
