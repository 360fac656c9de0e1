"""Orbit and gravity gradient of the second satellite: Kepler's equation solved, the field's second derivatives exact.

X points to the perigee, the orbit runs from X to Z. Angles turn coordinates: rho = R(alpha) r_hat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tests.foreign.satellite_loop import Floats

GM_M3_S2 = 3.986004418e14
EARTH_M = 6378136.3
J2 = 1.08263e-3


@dataclass(frozen=True)
class Orbit:
    period_s: float
    eccentricity: float
    inclination_rad: float
    perigee_argument_rad: float

    @property
    def rate_rad_s(self) -> float:
        return 2.0 * np.pi / self.period_s

    @property
    def frequency_hz(self) -> float:
        return 1.0 / self.period_s

    @property
    def axis_m(self) -> float:
        return float((GM_M3_S2 / self.rate_rad_s**2) ** (1.0 / 3.0))

    @property
    def pole(self) -> Floats:
        """The Earth's axis in (X, Y, Z); the orbit turns about -Y."""
        tilt, perigee = self.inclination_rad, self.perigee_argument_rad
        return np.array([np.sin(tilt) * np.sin(perigee), -np.cos(tilt), np.sin(tilt) * np.cos(perigee)])

    def place(self, time_s: Floats, turned_rad: Floats | float = 0.0) -> tuple[Floats, Floats]:
        """Unit vector (one row a sample) and distance, m; ``turned_rad`` turns the line of apsides."""
        mean = self.rate_rad_s * time_s
        eccentric = mean.copy()
        for _ in range(6):
            miss = eccentric - self.eccentricity * np.sin(eccentric) - mean
            eccentric -= miss / (1.0 - self.eccentricity * np.cos(eccentric))
        e = self.eccentricity
        x, z = np.cos(eccentric) - e, np.sqrt(1.0 - e**2) * np.sin(eccentric)
        anomaly = np.arctan2(z, x) + turned_rad
        direction = np.column_stack([np.cos(anomaly), np.zeros_like(anomaly), np.sin(anomaly)])
        return direction, np.asarray(self.axis_m * np.hypot(x, z))


def sphere_gradient(direction: Floats, distance_m: Floats) -> Floats:
    """Of GM / r, 1/s2, as matrices behind the samples."""
    g3 = GM_M3_S2 / distance_m**3
    return np.asarray(g3[:, None, None] * (3.0 * direction[:, :, None] * direction[:, None, :] - np.eye(3)))


def oblate_gradient(direction: Floats, distance_m: Floats, pole: Floats) -> Floats:
    """Of -GM J2 R^2 (3 z^2 - r^2) / (2 r^5), z along the pole."""
    z = direction @ pole
    both = direction[:, :, None] * direction[:, None, :]
    mixed = direction[:, :, None] * pole + pole[:, None] * direction[:, None, :]
    square = (
        2.0 * np.outer(pole, pole)
        - 10.0 * z[:, None, None] * mixed
        + (z**2)[:, None, None] * (35.0 * both - 5.0 * np.eye(3))
    )
    scale = -0.5 * GM_M3_S2 * J2 * EARTH_M**2 / distance_m**5
    return np.asarray(scale[:, None, None] * (3.0 * square - (15.0 * both - 3.0 * np.eye(3))))


def in_satellite(tensor: Floats, angles_rad: Floats) -> Floats:
    """R T R' for angles of one row a sample."""
    turn = Rotation.from_rotvec(-angles_rad).as_matrix()
    return np.asarray(turn @ tensor @ np.swapaxes(turn, 1, 2))
