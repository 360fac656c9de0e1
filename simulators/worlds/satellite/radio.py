"""From the sensors to the ground: what the clocks of the two sensors do, and what never arrives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from simulators.keyed_random import generator
from simulators.worlds.satellite.forcing import Command
from simulators.worlds.satellite.settings import SatelliteSettings


class Radio:
    """The telemetry of a run, chunk after chunk."""

    def __init__(self, settings: SatelliteSettings, draws: Sequence[int], run: int, command: Command) -> None:
        self._late_s = settings.size("sensor-skew", "delay")
        self._step_s = settings.sample_period_s
        self._before: FloatArray | None = None
        missing = settings.missing
        self._missing: list[BoolArray] = []
        if missing.fraction > 0.0:
            burst = max(round(missing.burst_s / settings.sample_period_s), 1)
            self._missing = [
                _bursts(generator(settings.seed, draw, run, "missing"), command.samples, missing.fraction, burst)
                for draw in draws
            ]

    def received(self, sent: FloatArray, first: int) -> FloatArray:
        """What arrives of (samples, columns, draws), the first of them number `first`; NaN where nothing does."""
        if self._late_s and len(sent):
            self._skew(sent)
        for draw, missing in enumerate(self._missing):
            sent[missing[first : first + len(sent)], :, draw] = np.nan
        return sent

    def _skew(self, sent: FloatArray) -> None:
        """Sensor 1 is read half the delay early and sensor 2 late: to first order, by the slope."""
        common = 0.5 * (sent[:, 0:3] + sent[:, 3:6])
        # Before the first sample nothing is known: it gets no slope.
        before = common[:1] if self._before is None else self._before
        slope = np.diff(np.concatenate([before, common]), axis=0) / self._step_s
        # For the slope across the border of two chunks.
        self._before = common[-1:].copy()
        sent[:, 0:3] += 0.5 * self._late_s * slope
        sent[:, 3:6] -= 0.5 * self._late_s * slope


def _bursts(rng: np.random.Generator, samples: int, fraction: float, longest: int) -> BoolArray:
    """Which samples are lost: bursts of up to `longest`, until the fraction is reached."""
    lost = np.zeros(samples, dtype=np.bool_)
    while lost.sum() < fraction * samples:
        at, length = int(rng.integers(samples)), int(rng.integers(1, longest + 1))
        lost[at : at + length] = True
    return lost
