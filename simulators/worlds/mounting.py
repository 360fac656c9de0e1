"""How the package sits on the turntable after somebody has mounted and levelled it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.rotations import (
    Configuration,
    about_x,
    nominal_table_from_cube,
    rotation,
    rotation_vector,
)

_ARCSEC_RAD = math.radians(1.0 / 3600.0)


@dataclass(frozen=True, eq=False)
class Mounting:
    """One mounting: the cube's rotation into the turntable's frame and the sensing axis in the cube's.

    `level_v` is where the operator's hand leaves the DC level; `laser_zero_m` what each head reads with the
    cube where it was aimed.
    """

    axis: str
    configuration: Configuration
    number: int
    table_from_cube: FloatArray
    sensing_axis_cube: FloatArray
    level_v: float
    laser_zero_m: dict[str, float]

    @property
    def key(self) -> tuple[str, str, int]:
        """What randomness of this mounting is keyed with."""
        return self.axis, self.configuration, self.number

    @property
    def sensing_axis_table(self) -> FloatArray:
        """The sensing axis in the turntable's frame."""
        return self.table_from_cube @ self.sensing_axis_cube


def mount(settings: BenchSettings, axis: str, configuration: Configuration, number: int) -> Mounting:
    """The package put in place, not yet levelled; the same numbers give the same mounting."""
    sensor = settings.sensors[axis]
    rng = generator(settings.seed, "mounting", axis, configuration, number)
    # New draws go to the end: before these they would change every mounting of a seed.
    delta = settings.mounting_sigma_rad * rng.standard_normal(3)
    strain = settings.scatter_arcsec * _ARCSEC_RAD * rng.standard_normal(2)
    level_v = settings.level_residual_v * rng.uniform(-1.0, 1.0)
    zero_m = {head: 1e-3 * settings.laser_zero_mm * rng.uniform(-1.0, 1.0) for head in settings.lasers}
    return Mounting(
        axis=axis,
        configuration=configuration,
        number=number,
        table_from_cube=rotation(delta) @ nominal_table_from_cube(sensor.cube_axis, configuration),
        sensing_axis_cube=_tilted(np.array(sensor.true_axis), strain),
        level_v=level_v,
        laser_zero_m=zero_m,
    )


def levelled(mounting: Mounting, vertical_table: FloatArray, component: float) -> Mounting:
    """The package turned about x_T until the vertical's component along the sensing axis is `component`."""
    axis = mounting.sensing_axis_table
    # vertical . Rx(turn) axis = fixed + across cos(turn) + along sin(turn), solved for the smaller turn.
    fixed = vertical_table[0] * axis[0]
    across = vertical_table[1] * axis[1] + vertical_table[2] * axis[2]
    along = vertical_table[2] * axis[1] - vertical_table[1] * axis[2]
    centre = math.atan2(along, across)
    swing = math.acos((component - fixed) / math.hypot(across, along))
    turn = min((centre - swing, centre + swing), key=abs)
    return replace(mounting, table_from_cube=about_x(turn) @ mounting.table_from_cube)


def truth(settings: BenchSettings, mounting: Mounting) -> dict[str, object]:
    """What a measurement of this mounting would like to know."""
    nominal = nominal_table_from_cube(settings.sensors[mounting.axis].cube_axis, mounting.configuration)
    x, y, _ = mounting.sensing_axis_table
    return {
        "axis": mounting.axis,
        "configuration": mounting.configuration,
        "mounting": mounting.number,
        "delta_rad": [float(v) for v in rotation_vector(mounting.table_from_cube @ nominal.T)],
        "sensing_axis_coc": [float(v) for v in mounting.sensing_axis_cube],
        # Turned by theta0 it has no component along the motion: x cos - y sin = 0.
        "theta0_deg": math.degrees(math.atan2(x, y)),
        "laser_zero_mm": {head: 1e3 * zero for head, zero in mounting.laser_zero_m.items()},
    }


def _tilted(axis: FloatArray, angles_rad: FloatArray) -> FloatArray:
    # The direction least along the axis: the product with it cannot vanish.
    least = int(np.argmin(np.abs(axis)))
    first = np.cross(axis, np.eye(3)[least])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    tilted = axis + math.tan(angles_rad[0]) * first + math.tan(angles_rad[1]) * second
    return np.asarray(tilted / np.linalg.norm(tilted), dtype=np.float64)
