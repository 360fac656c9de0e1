"""Made-up runs of the turntable, to try effects out on."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.trial import AnyColumns
from rigctl.experiments.sensing_axis.model.chain import Origins, Runs, periodic_motion


def trial_run(point: str) -> Runs:
    """Runs that differ in every condition, with the signal at a point of the chain."""
    rows = list(product("XYZ", ("pendulum", "flag"), (0.3, 0.6), (-1.0, 1.0)))
    rng = np.random.default_rng(1)

    def column(values: Any) -> FloatArray:
        return np.asarray(values, dtype=np.float64)[:, None]

    def scattered(low: float, high: float) -> FloatArray:
        return column(rng.uniform(low, high, len(rows)))

    omega = column([2.0 * np.pi * frequency for _, _, frequency, _ in rows])
    amplitude = scattered(3e-3, 6e-3)
    t, x, v, a = periodic_motion(np.asarray(-1j * amplitude, dtype=np.complex128), omega)
    theta, theta0 = scattered(-0.02, 0.02), scattered(-0.01, 0.01)
    force = -np.sin(theta - theta0) * a
    signals = {
        "motion_m": x,
        "angle_rad": theta,
        "null_rad": theta0,
        "specific_force_m_s2": force,
        "sensor_output_v": 80.0 * force + scattered(-1.0, 1.0),
        "laser_m": 0.9 * x,
    }
    start = column(120.0 * np.arange(len(rows)))
    temperature = scattered(-10.0, 50.0)
    return Runs(
        t=t,
        x=x,
        v=v,
        a=a,
        theta=theta,
        theta0=theta0,
        omega=omega,
        amplitude=amplitude,
        g=9.8,
        temperature=temperature,
        approach=column([approach for *_, approach in rows]),
        start=start,
        middle=start + 30.0,
        axis=np.array([[axis] for axis, *_ in rows]),
        configuration=np.array([[configuration] for _, configuration, *_ in rows]),
        origins=Origins(float(temperature.mean()), float(start.mean()) + 30.0),
        columns=AnyColumns((len(rows), 1)),
        signal=signals[point],
        head="laser_2_mm" if point == "laser_m" else "",
        along=np.full((len(rows), 1), 0.999),
        across=scattered(-0.01, 0.01),
        tilt=0.09,
        side=np.ones((len(rows), 1)),
    )
