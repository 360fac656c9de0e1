"""A made-up run of the platform, to try effects out on."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.trial import AnyColumns
from rigctl.experiments.rotating_platform.model.chain import PlatformRuns


def trial_run(point: str) -> PlatformRuns:
    """Cells that differ in every condition, with the signal at a point of the chain."""
    rng = np.random.default_rng(1)
    cells = 48

    def scattered(low: float, high: float) -> FloatArray:
        return np.asarray(rng.uniform(low, high, cells))

    t = np.linspace(0.0, 1410.0, cells)
    sign = np.where(np.arange(cells) % 2, -1.0, 1.0)
    a_z, a_y = scattered(1e-4, 2e-3), scattered(-1e-3, -1e-4)
    force = sign * a_z
    signals = {
        "platform_angle_rad": np.zeros(cells) + 1e-5,
        "force_m_s2": force,
        "reading_m_s2": force + scattered(-2e-3, 2e-3),
    }
    return PlatformRuns(
        channel="z",
        t=t,
        within=t - 720.0,
        cos=sign,
        sin=scattered(-1e-3, 1e-3),
        since=scattered(0.0, 20.0),
        turns=np.arange(cells, dtype=np.float64),
        turns_in_run=np.arange(cells, dtype=np.float64),
        direction=-sign,
        speed_squared=scattered(0.0, 1e-2),
        turning=scattered(-1e-2, 1e-2),
        c_y=scattered(-1e-3, 1e-3),
        c_z=scattered(0.0, 2e-3),
        temperature=scattered(15.0, 30.0),
        period=np.full(cells, 60.0),
        g=9.8,
        columns=AnyColumns((cells,)),
        a_y=a_y,
        a_z=a_z,
        along=force,
        across=sign * a_y,
        signal=signals[point],
    )
