"""All axes in the host's frame, the product: their covariance as the budgets have it, and the angles between them.

What moves all axes together (the rotation into the frame, beams, guide, gravity) correlates them. It is in the same
contribution of each budget, and counts with its sign.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.result.budget import AxisBudget
from rigctl.experiments.sensing_axis.result.result import SensingAxisResult


@dataclass(frozen=True)
class HostAxes:
    """Unit vectors (n, 3) in the host's frame and their covariance (3 n, 3 n) [rad^2].

    `correlation` (2 n, 2 n) is that of the budgets' components, two of each axis.
    """

    names: tuple[str, ...]
    units: FloatArray
    covariance: FloatArray
    correlation: FloatArray

    def block(self, a: int, b: int) -> FloatArray:
        """The covariance of axis number `a` with axis number `b`, (3, 3)."""
        return self.covariance[3 * a : 3 * a + 3, 3 * b : 3 * b + 3]

    def angle_sigma_rad(self, a: int, b: int) -> float:
        """Standard uncertainty of the angle between two axes that are not parallel; what turns both is not in it."""
        one, two = self.units[a], self.units[b]
        cosine, sine = float(one @ two), float(np.linalg.norm(np.cross(one, two)))
        slopes = np.concatenate([(cosine * one - two) / sine, (cosine * two - one) / sine])
        both = np.block([[self.block(a, a), self.block(a, b)], [self.block(b, a), self.block(b, b)]])
        return math.sqrt(max(float(slopes @ both @ slopes), 0.0))

    def as_json(self) -> dict[str, Any]:
        """Within `rigctl result --json`."""
        return {
            "axes": list(self.names),
            "covariance": self.covariance.tolist(),
            "component_correlation": self.correlation.tolist(),
        }


def host_axes(result: SensingAxisResult, budgets: Mapping[str, AxisBudget]) -> HostAxes:
    """The axes of a result as their budgets have them."""
    names = tuple(result.axes)
    units = np.array([result.axes[name].host.matrix @ result.axes[name].plane.normal for name in names])
    components = _components([budgets[name] for name in names])
    turned = np.zeros((3 * len(names), 2 * len(names)))
    for place, name in enumerate(names):
        turned[3 * place : 3 * place + 3, 2 * place : 2 * place + 2] = budgets[name].basis_uoaf.T
    covariance = components @ components.T
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    return HostAxes(names, units, turned @ covariance @ turned.T, correlation)


def _components(budgets: list[AxisBudget]) -> FloatArray:
    """Two components of each axis by what is uncertain, (2 axes, inputs): a column for what all axes share."""
    columns: dict[tuple[str, str], FloatArray] = {}
    for place, each in enumerate(budgets):
        for contribution, of_axis in zip(each.budget.contributions, each.budget.components.T, strict=True):
            key = ("" if contribution.name in each.common else each.axis, contribution.name)
            columns.setdefault(key, np.zeros(2 * len(budgets)))[2 * place : 2 * place + 2] = of_axis
    return np.stack(list(columns.values()), axis=1)


def with_host_axes(numbers: Mapping[str, Any], host: HostAxes) -> dict[str, Any]:
    """Keys of `SensingAxisResult.as_json`, with the budgets' uncertainties in the host's frame and of the angles."""
    axes = {
        name: {**numbers["axes"][name], "uoaf_covariance": host.block(place, place).tolist()}
        for place, name in enumerate(host.names)
    }
    angles = {
        f"{a}{b}": {**numbers["angles"][f"{a}{b}"], "sigma_deg": math.degrees(host.angle_sigma_rad(i, j))}
        for (i, a), (j, b) in combinations(enumerate(host.names), 2)
    }
    return {**numbers, "axes": axes, "angles": angles, "host": host.as_json()}
