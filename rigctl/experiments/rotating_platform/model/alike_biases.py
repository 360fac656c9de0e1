"""Where else a chain's curve may lie: the size with which a sensor's bias is the same in all runs.

A curve h adds x h(m) to the reading m = a c + b, c being the sign of the stop. The bias b of every run is free, so
that x = 0 with biases b + x h and the true x with alike ones read the same but for terms of second order; of a square
these vanish at both. Data may lie at either: a fit that begins at one end does not see the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.experiments.rotating_platform.model.chain import PlatformRuns
from rigctl.workbench.placed import Placed

READING = "reading_m_s2"

_ROUNDS = 6
_FEWEST_RUNS = 4
# Of a curve's size: what no gain imitates. With less of it biases are alike where the gain leaves nothing of them.
_BENT = 1e-3
# Of the biases' scatter: by so much they are more alike before that counts for anything.
_MUCH_MORE_ALIKE = 0.5


@dataclass(frozen=True)
class AlikeBiases:
    """A `size` of a curve in one channel with which biases are most alike, the `levels` they have then (runs,), and
    `gain`, by which accelerations are then larger; `likelier` where the levels scatter much less than those of the
    size there was."""

    size: float
    levels: FloatArray
    gain: float
    likelier: bool


def is_curve(one: Placed, run: PlatformRuns) -> bool:
    """Whether an effect is one amplitude times a function of what is read, not proportional to it."""
    if one.effect.on != READING or len(one.effect.parameters) != 1 or one.effect.scope != "channel":
        return False
    here, twice = (_shape(one, run, factor * (run.along + run.signal)) for factor in (1.0, 2.0))
    # A gain that is read twice would be twice as much.
    return bool(np.any(here != twice))


def alike_biases(one: Placed, run: PlatformRuns, levels: FloatArray, size: float) -> AlikeBiases | None:
    """For a curve in the channel of `run`, at rest with a bias of `levels` (runs,) and the curve's `size` there.

    None where the runs do not tell.
    """
    numbers: IntArray = np.repeat(np.arange(len(levels)), [each.period.size for each in run.cells])
    straight = run.along + run.signal
    added = size * _shape(one, run, straight)
    reading, read = straight + added, levels + _mean_by_run(run, numbers, added)
    for _ in range(_ROUNDS):
        shape = _shape(one, run, straight)
        curved = _mean_by_run(run, numbers, shape)
        if len(levels) < _FEWEST_RUNS or not np.ptp(curved) > 1e-9 * np.abs(curved).max():
            return None
        bent = shape - (shape @ straight) / (straight @ straight) * straight
        if np.linalg.norm(bent) < _BENT * np.linalg.norm(shape):
            return None
        slope, level = np.polyfit(curved - curved.mean(), read, 1)
        found, alike = float(slope), np.asarray(read - slope * curved)
        # What was read is given, and with it the acceleration behind a curve: its gain too is another.
        straight = reading - found * shape
        if not np.isfinite(level) or not np.abs(slope * curved).max() < np.abs(run.along + run.signal).max():
            return None
    weight = _counts(run) * run.along
    gain = float(weight @ (straight - alike[numbers]) / (weight @ run.along)) if weight.any() else 1.0
    return AlikeBiases(found, alike, gain, bool(np.std(alike) < _MUCH_MORE_ALIKE * np.std(levels)))


def _shape(one: Placed, run: PlatformRuns, signal: FloatArray) -> FloatArray:
    """What the effect adds to a reading for a size of 1."""
    (argument,) = one.effect.parameters
    return np.asarray(one.effect(run.at(signal=signal), **{argument: 1.0}))


def _counts(run: PlatformRuns) -> FloatArray:
    return np.concatenate([each.count for each in run.cells])


def _mean_by_run(run: PlatformRuns, numbers: IntArray, values: FloatArray) -> FloatArray:
    """What a bias would be that does this: the mean over both stops, run by run."""
    at_stops = []
    for side in (True, False):
        there = _counts(run) * ((run.cos >= 0.0) == side)
        at_stops.append(np.bincount(numbers, there * values) / np.maximum(np.bincount(numbers, there), 1e-300))
    return np.asarray(0.5 * (at_stops[0] + at_stops[1]))
