"""What one output shows of its head: range, filter, zero, offset and hold. No wire code here."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.wiring import Signal

CUTOFFS_HZ = (300.0, 100.0, 30.0, 10.0, 3.0, 1.0, 0.3, 0.1)
"""Of the low-pass and high-pass filters, by the number that selects them."""

_POINTS = 64
_BLOCK = 1 << 16


@dataclass(frozen=True)
class Kernel:
    """A filter: the value at t is the sum of weights times the head's value at t - lags."""

    lags_s: FloatArray
    weights: FloatArray


def moving_average(cycles: int, cycle_s: float) -> Kernel:
    """The mean over the last `cycles` sampling cycles; sparse for many, with the same mean delay."""
    # The mean delay is that of all cycles; a moving average of 262144 would be sampled without end.
    points = min(cycles, _POINTS)
    return Kernel(np.linspace(0.0, cycles - 1.0, points) * cycle_s, np.full(points, 1.0 / points))


def low_pass(cutoff_hz: float) -> Kernel:
    """First order."""
    # Eight time constants: what is left is below the last digit.
    time_constants = np.linspace(0.0, 8.0, _POINTS)
    weights = np.exp(-time_constants)
    return Kernel(time_constants / (2.0 * math.pi * cutoff_hz), weights / weights.sum())


def high_pass(cutoff_hz: float) -> Kernel:
    """First order: what the low-pass takes away."""
    slow = low_pass(cutoff_hz)
    return Kernel(np.concatenate([[0.0], slow.lags_s]), np.concatenate([[1.0], -slow.weights]))


class Output:
    """One output (OUT) with its head.

    Values are in mm: NaN where there is no valid one, +-inf out of range.
    """

    def __init__(self, signal: Signal, range_mm: float) -> None:
        self.kernel = moving_average(1, 0.0)
        self.offset_mm = 0.0
        self.held_at_s: float | None = None
        self.statistics_from_s = 0.0
        self._signal = signal
        self._range_mm = range_mm
        self._zero_mm = 0.0

    def at(self, times_s: FloatArray) -> FloatArray:
        """The values at the given instants, shape (n,)."""
        return self._filtered(times_s) - self._zero_mm + self.offset_mm

    def now(self, now_s: float) -> float:
        """The value on display: now, or when it was held."""
        return float(self.at(np.array([now_s if self.held_at_s is None else self.held_at_s]))[0])

    def zero(self, now_s: float) -> None:
        """Auto-zero: what it measures now is zero from here on; without a value it stays as it was."""
        value = float(self._filtered(np.array([now_s]))[0])
        if math.isfinite(value):
            self._zero_mm = value

    def unzero(self) -> None:
        """Auto-zero off."""
        self._zero_mm = 0.0

    def reset(self, now_s: float) -> None:
        """Let go of a held value and begin the statistics anew."""
        self.held_at_s = None
        self.statistics_from_s = now_s

    def _filtered(self, times_s: FloatArray) -> FloatArray:
        lags_s, weights = self.kernel.lags_s, self.kernel.weights
        # In blocks: a storage of a million values times 64 taps would be half a gigabyte.
        rows = max(1, _BLOCK // len(lags_s))
        blocks = [times_s[i : i + rows, None] - lags_s for i in range(0, len(times_s), rows)]
        with np.errstate(invalid="ignore"):  # inf - inf: out of range both ways is no value
            return np.concatenate([np.empty(0), *(self._raw(block) @ weights for block in blocks)])

    def _raw(self, times_s: FloatArray) -> FloatArray:
        raw = np.asarray(self._signal(times_s.ravel()), dtype=np.float64).reshape(times_s.shape)
        return np.where(np.abs(raw) > self._range_mm, np.copysign(np.inf, raw), raw)
