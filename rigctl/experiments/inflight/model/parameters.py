"""What a calibration finds: ten numbers with fixed names, and how the quadratic ones depend on each other."""

from __future__ import annotations

from typing import Any

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


def of_masses(k2d: Any, k2c: Any, ad11: Any) -> tuple[Any, Any]:
    """Quadratic factors k_1, k_2 of the masses in the linearised output's scale [s2/m], for numbers or arrays, from
    k_d = (1 - a^2)/2 ((1 + a) k_1 - (1 - a) k_2) and k_c = (k_1 + k_2)/2, a = a'_d11."""
    difference = k2d / (1.0 - ad11**2) - ad11 * k2c
    return k2c + difference, k2c - difference
