"""What no session sees: how the star tracker stands, and how the sensors' axes couple.

With the tracker off by s the satellite stands at -s, and nobody knows. a_c12 is then off by -s_z - eta_z, a_c13 by
s_y - eta_y / 2. The gradient turned by these angles mixes the off-centrings: Dx is off by -2 s_y Dz + s_z Dy, Dz by
2 s_y Dx. What is wrong of a_c12 and a_c13 is corrected for in the other sessions, and the off-centrings follow as
their covariance says: of the whole, s_y leaves -Dz in Dx and Dx in Dz.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.budget import Contribution
from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.parameters import NAMES

TRACKER_BIAS_RAD = 1e-4
COUPLING_RAD = 1e-4 / math.sqrt(3.0)
"""Standard uncertainties of the star tracker's alignment and of the sensors' coupling angles, unless recorded."""


@dataclass(frozen=True)
class Unseen:
    """An angle, and what a radian of it does to the parameters of `NAMES`, (10,)."""

    angle: Contribution
    effect: FloatArray


def unseen(values: FloatArray, covariance: FloatArray, constants: Mapping[str, float]) -> tuple[Unseen, ...]:
    """For parameters (10,) with their covariance by noise (10, 10).

    `constants` of the recording may have `tracker_bias_rad` and `coupling_rad`.
    """
    of = dict(zip(NAMES, values, strict=True))
    with_ac12, with_ac13 = (_following(covariance, NAMES.index(name)) for name in ("ac12_rad", "ac13_rad"))
    tracker, coupling = (
        float(constants.get(name, usual))
        for name, usual in (("tracker_bias_rad", TRACKER_BIAS_RAD), ("coupling_rad", COUPLING_RAD))
    )
    turned_y = _effect({"ac11_dx_m": -2.0 * of["ac11_dz_m"], "ac11_dz_m": 2.0 * of["ac11_dx_m"]})
    turned_z = _effect({"ac11_dx_m": of["ac11_dy_m"]})
    return (
        Unseen(_angle("star tracker about y", tracker), with_ac13 + turned_y),
        Unseen(_angle("star tracker about z", tracker), turned_z - with_ac12),
        Unseen(_angle("coupling eta_y", coupling), -0.5 * with_ac13),
        Unseen(_angle("coupling eta_z", coupling), -with_ac12),
    )


def unseen_covariance(values: FloatArray, covariance: FloatArray, constants: Mapping[str, float]) -> FloatArray:
    """Of the parameters, (10, 10), beyond their covariance by noise."""
    parts = np.array(
        [each.angle.standard_uncertainty * each.effect for each in unseen(values, covariance, constants)]
    )
    return np.asarray(parts.T @ parts)


def _following(covariance: FloatArray, place: int) -> FloatArray:
    """By what the parameters move when one of them is moved by a unit, (10,)."""
    return np.asarray(covariance[:, place] / covariance[place, place])


def _angle(name: str, u_rad: float) -> Contribution:
    return Contribution(name, 0.0, u_rad, "rad", source="constants of the recording")


def _effect(by_name: Mapping[str, float]) -> FloatArray:
    return np.array([by_name.get(name, 0.0) for name in NAMES])
