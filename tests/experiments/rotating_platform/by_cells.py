"""Samples of a recording through the cells to the estimates of its periods, as results are made."""

from __future__ import annotations

import math

import numpy as np

from rigctl.experiments.rotating_platform.observe.cutter import cells_of
from rigctl.experiments.rotating_platform.observe.estimates import estimates, outside_guard
from rigctl.experiments.rotating_platform.observe.recorded import Chains

UNIT = {"z": 1.0, "y": 1.0}


def demodulated(sampled, z, y=None, *, estimator="projection", full_scale=math.inf, theta_deg=None, moving=None):
    """The estimates of readings in m/s2, turned after the pattern's table unless the course is given."""
    periods = -(-len(z) // sampled.samples)
    sign = np.tile(sampled.sign, periods)[: len(z)]
    columns = {
        "t_s": np.arange(len(z)) / sampled.sample_rate_hz,
        "q_a_v": np.asarray(z),
        "q_b_v": np.asarray(z if y is None else y),
        "theta_deg": np.where(sign < 0, 180.0, 0.0) if theta_deg is None else theta_deg,
        "moving": (sign == 0).astype(float) if moving is None else moving,
    }
    believed = Chains(UNIT, UNIT, {}, dict.fromkeys(UNIT, full_scale), 9.81)
    cells = cells_of([columns], believed, sampled.pattern.period_s, sampled.sample_rate_hz)
    return estimates(cells, outside_guard(cells, 0.0, 0.0), sampled, estimator)
