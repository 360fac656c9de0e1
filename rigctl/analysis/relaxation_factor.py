"""The Cholesky factor of noise that relaxes along an order, at a cost that grows with the data and not their square.

Noise that is a sum of relaxations knows of its past only what each of them is at the moment: a state of as many
numbers. So its covariance is factorised block by block, the state carried from one to the next: a Kalman filter,
whose innovations are what whitening with the Cholesky factor gives (Foreman-Mackey et al., Astron. J. 154 (2017) 220,
do it datum by datum).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.triangle_solve import solve_lower
from rigctl.core.arrays import FloatArray

BLOCK = 128
"""Data that are factorised together: large enough for the linear algebra, small enough for its cube."""


@dataclass(frozen=True)
class _Block:
    """Data from `first` to `last`: their own `triangle`, what they have of the state before them, (data, states), how
    much of the state is left behind them, (states,), and what it gains from their innovations, (states, data)."""

    first: int
    last: int
    triangle: FloatArray
    before: FloatArray
    left: FloatArray
    gain: FloatArray


class RelaxationFactor:
    """L with L L' = 1 + sum of variance * exp(-|t - t'| / constant), `at` rising places t (n,).

    `relaxations` are pairs of variance and constant. Columns are (n,) or (n, k).
    """

    def __init__(self, at: FloatArray, relaxations: Sequence[tuple[float, float]]) -> None:
        variance, constant = np.array(relaxations, dtype=np.float64).T
        self.variances: FloatArray = np.full(len(at), 1.0 + float(variance.sum()))
        self._blocks: list[_Block] = []
        self._states = len(variance)
        # Of the variance of each state, and of pairs of them, what the data so far have told.
        told, since = np.zeros((len(variance),) * 2), float(at[0])
        for first in range(0, len(at), BLOCK):
            here = at[first : first + BLOCK]
            apart = np.abs(here[:, None] - here[None, :])
            own = np.eye(len(here))
            for each, slow in zip(variance, constant, strict=True):
                own += each * np.exp(-apart / slow)
            before = np.exp(-(here[:, None] - since) / constant)
            left = before[-1]
            triangle = np.linalg.cholesky(own - before @ told @ before.T)
            ahead = variance * np.exp(-(here[-1] - here)[:, None] / constant)
            gain = solve_lower(triangle, ahead - before @ (told * left)).T
            self._blocks.append(_Block(first, first + len(here), triangle, before, left, gain))
            told, since = left[:, None] * told * left + gain @ gain.T, float(here[-1])

    def solve(self, columns: FloatArray) -> FloatArray:
        """L^-1 columns."""
        return self._forward(columns, inverse=True)

    def times(self, columns: FloatArray) -> FloatArray:
        """L columns."""
        return self._forward(columns, inverse=False)

    def solve_transposed(self, columns: FloatArray) -> FloatArray:
        """L'^-1 columns."""
        return self._backward(columns, inverse=True)

    def transposed_times(self, columns: FloatArray) -> FloatArray:
        """L' columns."""
        return self._backward(columns, inverse=False)

    def log_determinant(self) -> float:
        """Of L."""
        return float(sum(np.sum(np.log(np.diag(block.triangle))) for block in self._blocks))

    def _forward(self, columns: FloatArray, *, inverse: bool) -> FloatArray:
        given = columns.reshape(len(columns), -1)
        made = np.empty_like(given, dtype=np.float64)
        state = np.zeros((self._states, given.shape[1]))
        for block in self._blocks:
            here, expected = given[block.first : block.last], block.before @ state
            new = solve_lower(block.triangle, here - expected) if inverse else here
            made[block.first : block.last] = new if inverse else block.triangle @ new + expected
            state = block.left[:, None] * state + block.gain @ new
        return made.reshape(columns.shape)

    def _backward(self, columns: FloatArray, *, inverse: bool) -> FloatArray:
        given = columns.reshape(len(columns), -1)
        made = np.empty_like(given, dtype=np.float64)
        ahead = np.zeros((self._states, given.shape[1]))
        for block in reversed(self._blocks):
            here, owed = given[block.first : block.last], block.gain.T @ ahead
            new = solve_lower(block.triangle, here - owed, transposed=True) if inverse else here
            made[block.first : block.last] = new if inverse else block.triangle.T @ new + owed
            ahead = block.before.T @ new + block.left[:, None] * ahead
        return made.reshape(columns.shape)
