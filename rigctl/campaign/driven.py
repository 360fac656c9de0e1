"""How far and how fast a column swings that follows a sinusoidal drive."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray

SAMPLES_MIN = 16
# Enough to know amplitude and frequency, whatever the length of a run.
_SAMPLES_LOOKED_AT = 1_000_000


def swing_of(column: FloatArray) -> float:
    """Half of peak to peak, in the column's unit; NaN for a few samples."""
    low, high = _ends(column[:_SAMPLES_LOOKED_AT])
    return 0.5 * (high - low)


def frequency_of(t_s: FloatArray, column: FloatArray) -> float:
    """From the times at which it passes from one side to the other [Hz]; NaN when it passes less than three times."""
    t_s, column = t_s[:_SAMPLES_LOOKED_AT], column[:_SAMPLES_LOOKED_AT]
    low, high = _ends(column)
    # Near the middle, noise would pass from side to side many times. NaN is on no side.
    far = np.abs(column - 0.5 * (low + high)) > 0.25 * (high - low)
    side, at_s = np.sign(column[far] - 0.5 * (low + high)), t_s[far]
    passes_s = at_s[1:][np.diff(side) != 0]
    # Passes are half a period apart.
    return 0.5 * (passes_s.size - 1) / float(passes_s[-1] - passes_s[0]) if passes_s.size > 2 else math.nan


def _ends(column: FloatArray) -> tuple[float, float]:
    known = column[np.isfinite(column)]
    if known.size < SAMPLES_MIN:
        return math.nan, math.nan
    # A jump of the encoder is no swing.
    low, high = np.percentile(known, [1.0, 99.0])
    return float(low), float(high)
