"""How noise is correlated along an order: relaxations and power laws, wherever the data lie on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray


def kernel(name: str, apart: FloatArray, scales: tuple[float, float]) -> FloatArray:
    """Correlation of unit variance at distances `apart` along the order.

    `name` is "exp TAU" for a relaxation, "power A" for a power law 1/f^A; `scales` are the shortest and the longest
    time between the data that told it.
    """
    kind, _, value = name.partition(" ")
    if kind == "exp":
        return np.asarray(np.exp(-apart / float(value)))
    shortest, longest = scales
    # A power law as a sum of relaxations, two an octave: positive definite whatever the spacing.
    constants = np.geomspace(shortest / 4.0, 8.0 * longest, 2 * int(np.log2(32.0 * longest / shortest)) + 2)
    # A relaxation T has the density T / (1 + (2 pi f T)^2); with weights T^(a - 1) they add up to 1/f^a.
    weights = constants ** (float(value) - 1.0)
    found = np.zeros_like(apart)
    for weight, constant in zip(weights / weights.sum(), constants, strict=True):
        found += weight * np.exp(-apart / constant)
    return found


@dataclass(frozen=True)
class SlowNoise:
    """The law by which data `where` are correlated along `order`, R = 1 + sum of strength * kernel: for data that are
    still to be measured too."""

    where: IntArray
    order: str
    strengths: tuple[tuple[str, float], ...]
    scales: tuple[float, float]

    def correlation(self, at: FloatArray) -> FloatArray:
        """R of data of one group at these places on the order."""
        apart = np.abs(at[:, None] - at[None, :])
        whole = np.eye(len(at))
        for name, strength in self.strengths:
            whole += strength * kernel(name, apart, self.scales)
        return whole
