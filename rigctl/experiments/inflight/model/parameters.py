"""What a calibration finds: ten numbers with fixed names, and how the quadratic ones hang together."""

from __future__ import annotations

from typing import NamedTuple

NAMES = (
    "ac11_dx_m",
    "ac11_dy_m",
    "ac11_dz_m",
    "ac12_rad",
    "ac13_rad",
    "ad11",
    "ad12_rad",
    "ad13_rad",
    "k2d_s2_m",
    "k2c_s2_m",
)
UNITS = ("m", "m", "m", "rad", "rad", "1", "rad", "rad", "s2/m", "s2/m")

NUISANCES = ("ac11", "theta_cx", "k_y", "k_z", "ad22", "ad33")
"""What the equation of the baseline needs besides, known beforehand within limits."""

NUISANCE_UNITS = ("1", "rad", "s2/m", "s2/m", "1", "1")
SHARED = len(NAMES) + len(NUISANCES)
"""How many parameters all runs share: those of `NAMES`, then those of `NUISANCES`."""


class Quadratic(NamedTuple):
    """Quadratic factors of the two masses, in the linearised output's own scale (s2/m)."""

    k_1: float
    k_2: float


def of_masses(k2d: float, k2c: float, ad11: float) -> Quadratic:
    """k_1 and k_2 from k_d = (1 - a^2)/2 ((1 + a) k_1 - (1 - a) k_2) and k_c = (k_1 + k_2)/2, a = a'_d11."""
    difference = k2d / (1.0 - ad11**2) - ad11 * k2c
    return Quadratic(k2c + difference, k2c - difference)
