"""When a motion just commanded will run into something."""

from __future__ import annotations

import math

import numpy as np

from simulators.motion import MotionAxis

SAMPLES = 512
BISECTIONS = 50


def first_crossing_s(axis: MotionAxis, from_s: float, until_s: float, bound: float, side: int) -> float:
    """When the axis first is farther out than now and beyond `bound` (side 1: above it, -1: below); inf if never."""
    times_s = np.linspace(from_s, until_s, SAMPLES)
    position = axis.sample(times_s)[0]
    crossed = np.flatnonzero((side * (position - bound) > 0.0) & (side * (position - position[0]) > 0.0))
    if len(crossed) == 0:
        return math.inf
    late_s = float(times_s[crossed[0]])
    early_s = float(times_s[max(crossed[0] - 1, 0)])
    for _ in range(BISECTIONS):
        middle_s = 0.5 * (early_s + late_s)
        if side * (axis.position(middle_s) - bound) > 0.0:
            late_s = middle_s
        else:
            early_s = middle_s
    return late_s
