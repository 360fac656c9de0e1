"""What acts on the satellite from outside, from a CSV file: accelerations, or the air's density and velocity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from rigctl.core.arrays import FloatArray

ACCELERATION = ("t_s", "accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2")
AIR = ("t_s", "density_kg_m3", "wind_x_m_s", "wind_y_m_s", "wind_z_m_s")

_MOST_M_S2 = 1e-3
"""Air at 200 km does less: beyond it a unit is wrong."""


@dataclass(frozen=True, eq=False)
class ExternalAcceleration:
    """Accelerations (times, 3) [m/s2] in the satellite's axes; the last time is the first one of the next cycle."""

    t_s: FloatArray
    accel_m_s2: FloatArray

    def at(self, time_s: FloatArray) -> FloatArray:
        """Between the rows by straight lines, cycle after cycle; shape (times, 3)."""
        first_s, last_s = float(self.t_s[0]), float(self.t_s[-1])
        within_s = first_s + np.mod(time_s - first_s, last_s - first_s)
        return np.stack([np.interp(within_s, self.t_s, column) for column in self.accel_m_s2.T], axis=1)


@lru_cache(maxsize=4)
def external_acceleration(
    path: Path, area_m2: float, drag_coefficient: float, mass_kg: float
) -> ExternalAcceleration:
    """Read a file with the columns of `ACCELERATION`, or of `AIR`: rho C A |v| v / (2 m), along the wind.

    The wind is the velocity of the air as the satellite meets it, in its axes. Raises ValueError for another file.
    """
    columns = _columns(path)
    names = next((names for names in (ACCELERATION, AIR) if set(names) <= columns.keys()), None)
    if names is None:
        raise ValueError(
            f"{path} has columns {', '.join(columns)}; give {', '.join(ACCELERATION)} or {', '.join(AIR)}"
        )
    t_s, *rest = (columns[name] for name in names)
    if len(t_s) < 2 or not (np.diff(t_s) > 0.0).all():
        raise ValueError(f"{path}: t_s has to grow from row to row, over two rows or more")
    accel = np.stack(rest[-3:], axis=1)
    if names is AIR:
        if (rest[0] < 0.0).any():
            raise ValueError(f"{path}: density_kg_m3 is negative in row {int(np.argmax(rest[0] < 0.0)) + 2}")
        speed = np.linalg.norm(accel, axis=1)
        accel *= (0.5 * drag_coefficient * area_m2 / mass_kg * rest[0] * speed)[:, None]
    if np.abs(accel).max() > _MOST_M_S2:
        raise ValueError(f"{path}: up to {np.abs(accel).max():.3g} m/s2, which no air does; look at the units")
    return ExternalAcceleration(t_s, accel)


def _columns(path: Path) -> dict[str, FloatArray]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    rows = [line.split(",") for line in lines if line.strip() and not line.startswith("#")]
    names, values = [name.strip() for name in rows[0]] if rows else [], rows[1:]
    try:
        table = np.array(values, dtype=np.float64).reshape(-1, len(names))
    except ValueError as error:
        raise ValueError(f"{path} is no table of numbers under a line of names: {error}") from error
    if not np.isfinite(table).all():
        raise ValueError(f"{path}: a value is missing in row {int(np.argmax(~np.isfinite(table).all(axis=1))) + 2}")
    return dict(zip(names, table.T, strict=True))
