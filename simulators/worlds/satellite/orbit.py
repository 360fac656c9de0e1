"""Where the satellite is, and the gravity gradient there, in axes that do not turn.

X points to the perigee, the motion goes from X to Z, Y is along the normal of the orbit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray

EARTH_M3_S2 = 3.986004418e14
EARTH_RADIUS_M = 6378137.0

NEARLY_ROUND = 0.02
"""Up to this eccentricity the series that Kepler's equation begins with is right to 1e-5, and Newton squares that."""


@dataclass(frozen=True)
class Place:
    """Along an orbit: cosine and sine of the angle from X, and mu / r^3 [1/s2]; each (n,)."""

    cosine: FloatArray
    sine: FloatArray
    strength_s2: FloatArray


def place(
    time_s: FloatArray, period_s: float, eccentricity: FloatArray | float, turned_rad: FloatArray | float
) -> Place:
    """Kepler's motion, at perigee at time 0; `turned_rad` is how far the perigee has gone from X."""
    n = 2.0 * math.pi / period_s
    mean = n * time_s
    e = np.asarray(eccentricity, dtype=np.float64)
    sine, cosine = np.sin(mean), np.cos(mean)
    anomaly = mean + e * sine * (1.0 + e * cosine)
    step = np.zeros_like(mean)
    # A number of steps that does not depend on which times are asked for together.
    for _ in range(2 if np.max(e) < NEARLY_ROUND else 7):
        sine, cosine = np.sin(anomaly), np.cos(anomaly)
        step = (anomaly - e * sine - mean) / (1.0 - e * cosine)
        anomaly = anomaly - step
    # The last step is so small that its first order will do: no further sine and cosine.
    sine, cosine = sine - step * cosine, cosine + step * sine
    # a / r; with mu = n^2 a^3 its cube gives mu / r^3.
    nearness = 1.0 / (1.0 - e * cosine)
    cosine, sine = (cosine - e) * nearness, np.sqrt(1.0 - e**2) * sine * nearness
    if np.any(turned_rad):
        c, s = np.cos(turned_rad), np.sin(turned_rad)
        cosine, sine = cosine * c - sine * s, sine * c + cosine * s
    return Place(cosine, sine, n**2 * nearness**3)


def oblateness(at: Place, period_s: float, j2: float, inclination_rad: float, perigee_rad: float) -> FloatArray:
    """What the Earth's oblateness adds to the gradient, columns xx yy zz xy xz yz; (n, 6) 1/s2.

    Second derivatives of -mu J2 R^2 (3 (k r)^2 / r^5 - 1 / r^3) / 2, k the Earth's pole.
    """
    semi_axis_m = (EARTH_M3_S2 * (period_s / (2.0 * math.pi)) ** 2) ** (1.0 / 3.0)
    mean_strength = (2.0 * math.pi / period_s) ** 2
    radius_ratio = EARTH_RADIUS_M / semi_axis_m * (at.strength_s2 / mean_strength) ** (1.0 / 3.0)
    pole = np.array(
        [
            math.sin(inclination_rad) * math.sin(perigee_rad),
            math.cos(inclination_rad),
            math.sin(inclination_rad) * math.cos(perigee_rad),
        ]
    )
    u = np.stack([at.cosine, np.zeros_like(at.cosine), at.sine])
    latitude = pole @ u
    factor = -0.5 * j2 * at.strength_s2 * radius_ratio**2
    rows = []
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        same = 1.0 if i == j else 0.0
        rows.append(
            factor
            * (
                6.0 * pole[i] * pole[j]
                - 30.0 * latitude * (pole[i] * u[j] + pole[j] * u[i])
                + (3.0 - 15.0 * latitude**2) * same
                + (105.0 * latitude**2 - 15.0) * u[i] * u[j]
            )
        )
    return np.stack(rows, axis=1)
