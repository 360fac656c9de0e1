"""How noise is correlated along an order: relaxations and power laws, wherever the data lie on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.analysis.correlated_groups import Triangle
from rigctl.analysis.relaxation_factor import RelaxationFactor
from rigctl.core.arrays import FloatArray, IntArray

LARGEST_MATRIX = 400
"""Data whose correlation is worked out as a matrix; of more as a sum of relaxations."""

Strengths = tuple[tuple[str, float], ...]
"""Kernels by name, and the variance of each in units of the white part's."""


def kernel(name: str, apart: FloatArray, scales: tuple[float, float]) -> FloatArray:
    """Correlation of unit variance at distances `apart` along the order.

    `name` is "exp TAU" for a relaxation, "power A" for a power law 1/f^A; `scales` are the shortest and the longest
    time between the data that told it.
    """
    found = np.zeros_like(apart)
    for share, constant in relaxations(name, scales):
        found += share * np.exp(-apart / constant)
    return found


def relaxations(name: str, scales: tuple[float, float]) -> list[tuple[float, float]]:
    """The relaxations that a kernel is a sum of: of each its share of the variance and its time constant."""
    kind, _, value = name.partition(" ")
    if kind == "exp":
        return [(1.0, float(value))]
    shortest, longest = scales
    # A power law as a sum of relaxations, two an octave: positive definite whatever the spacing.
    constants = np.geomspace(shortest / 4.0, 8.0 * longest, 2 * int(np.log2(32.0 * longest / shortest)) + 2)
    # A relaxation T has the density T / (1 + (2 pi f T)^2); with weights T^(a - 1) they add up to 1/f^a.
    weights = constants ** (float(value) - 1.0)
    return list(zip((weights / weights.sum()).tolist(), constants.tolist(), strict=True))


def summed(strengths: Strengths, scales: tuple[float, float]) -> list[tuple[float, float]]:
    """Variance and time constant of each of the relaxations that kernels so strong are sums of."""
    variances: dict[float, float] = {}
    for name, strength in strengths:
        # Power laws are sums of the same relaxations.
        for share, constant in relaxations(name, scales):
            variances[constant] = variances.get(constant, 0.0) + strength * share
    return [(variance, constant) for constant, variance in variances.items()]


@dataclass(frozen=True)
class SlowNoise:
    """The law by which data `where` are correlated along `order`, R = 1 + sum of strength * kernel: for data that are
    still to be measured too."""

    where: IntArray
    order: str
    strengths: Strengths
    scales: tuple[float, float]

    def factor(self, at: FloatArray) -> Triangle:
        """The Cholesky factor of R of data of one group at these places on the order."""
        if len(at) > LARGEST_MATRIX and np.all(np.diff(at) >= 0.0):
            return RelaxationFactor(at, summed(self.strengths, self.scales))
        return np.asarray(np.linalg.cholesky(self.correlation(at)), dtype=np.float64)

    def correlation(self, at: FloatArray) -> FloatArray:
        """R of data of one group at these places on the order."""
        apart = np.abs(at[:, None] - at[None, :])
        whole = np.eye(len(at))
        for name, strength in self.strengths:
            whole += strength * kernel(name, apart, self.scales)
        return whole
