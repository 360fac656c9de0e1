"""How gravity stands to sensors on a dividing head, and what effects are given of it; equations are README.md's.

The plate of the head has axes 1 (the turning axis), 2 (horizontal at 0 deg) and 3 (up at 0 deg), right-handed. A case
has the right-handed axes x, y, z. Everything here is in radians and m/s2, first order in seating errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.core.errors import DataError
from rigctl.effects.trial import AnyColumns

AXES = ("x", "y", "z")
"""Of the case. Sensor x has its input axis along x, its pendulous axis along y, its output axis along z."""

OUTS = tuple(sense + axis for axis in AXES for sense in "+-")
"""Which axis of the case lies along the turning axis, and in which sense."""

_STEP_RAD = 1e-5
_nothing = partial(np.empty, 0)


def case_axes(out: str, clocking_rad: float) -> FloatArray:
    """Rows are the axes x, y, z of the case in the plate's frame, shape (3, 3); equation 2.

    The axis after `out` in the order x, y, z, x lies in the plate's plane, `clocking_rad` from axis 2 towards axis 3.
    """
    along, sense = AXES.index(out[1]), 1.0 if out[0] == "+" else -1.0
    cos, sin = np.cos(clocking_rad), np.sin(clocking_rad)
    found = np.empty((3, 3))
    found[along] = (sense, 0.0, 0.0)
    found[(along + 1) % 3] = (0.0, cos, sin)
    found[(along + 2) % 3] = (0.0, -sense * sin, sense * cos)
    return found


@dataclass(frozen=True)
class TumbleRun:
    """All data of a recording at one point of the chain, SI and radians, arrays of shape (n,).

    `theta` is the head's angle as read, `approach` the sense in which it was reached, `axes` (n, 3, 3) those of the
    case. `a_i`, `a_p`, `a_o` act along input, pendulous and output axis of each datum's `sensor` (0, 1, 2), `slope_i`
    is d a_i / d theta. `temperature_0` and `t_0` are means; `signal` is the value so far at the point.
    """

    theta: FloatArray
    approach: FloatArray
    temperature: FloatArray
    t: FloatArray
    sensor: IntArray
    axes: FloatArray
    g: float
    temperature_0: float
    t_0: float
    columns: Mapping[str, FloatArray]
    a_i: FloatArray = field(default_factory=_nothing)
    a_p: FloatArray = field(default_factory=_nothing)
    a_o: FloatArray = field(default_factory=_nothing)
    slope_i: FloatArray = field(default_factory=_nothing)
    signal: FloatArray = field(default_factory=_nothing)

    def column(self, name: str) -> FloatArray:
        """A laboratory's own column of runs.csv; `DataError` when there is none of this name."""
        if name not in self.columns:
            raise DataError(f"the recording has no column '{name}'; it has {', '.join(self.columns) or 'none'}")
        return self.columns[name]

    def standing(self, angle_rad: FloatArray, elevation_rad: FloatArray, seat_rad: FloatArray) -> TumbleRun:
        """On a head whose angle errs by `angle_rad` and whose axis rises by `elevation_rad`; equations 1 and 3.

        Cases are off by `seat_rad`, shape (n, 3), a small rotation in the plate's frame.
        """
        rows = np.arange(len(self.theta))

        def felt(theta: FloatArray) -> list[FloatArray]:
            level = self.g * np.cos(elevation_rad)
            up = np.stack([self.g * np.sin(elevation_rad), level * np.sin(theta), level * np.cos(theta)], axis=1)
            along = np.einsum("nij,nj->ni", self.axes, up + np.cross(up, seat_rad))
            return [along[rows, (self.sensor + step) % 3] for step in range(3)]

        a_i, a_p, a_o = felt(self.theta + angle_rad)
        slope_i = (felt(self.theta + angle_rad + _STEP_RAD)[0] - a_i) / _STEP_RAD
        return replace(self, a_i=a_i, a_p=a_p, a_o=a_o, slope_i=slope_i)


def trial_run(point: str) -> TumbleRun:
    """Positions that differ in every condition, with the signal at a point of the chain."""
    rng, data = np.random.default_rng(1), 48
    case = np.array([case_axes(OUTS[i % len(OUTS)], 0.3 * i) for i in range(data)])
    theta, sense = rng.uniform(0.0, 2.0 * np.pi, data), np.where(np.arange(data) % 2, 1.0, -1.0)
    warm, t = rng.uniform(15.0, 30.0, data), 60.0 * np.arange(data)
    sensor, columns = np.arange(data) % len(AXES), AnyColumns((data,))
    bare = TumbleRun(theta, sense, warm, t, sensor, case, 9.81, 22.0, 1000.0, columns)
    run = bare.standing(np.zeros(data), np.zeros(data), np.zeros((data, 3)))
    scale = {"tumble_indicated_m_s2": 1.0, "tumble_output_v": 0.5}
    return replace(run, signal=scale[point] * (run.a_i + 0.01) if point in scale else np.full(data, 1e-5))
