"""One satellite out of the ensemble: its instrument's true parameters, and what a calibration should find.

Equations (n) are of Hardy et al., arXiv 1707.07630. Arrays of masses have shape (2, ...): inner, outer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.keyed_random import generator
from simulators.worlds.satellite.settings import SatelliteSettings

LEVER_M = 0.02
"""Force from torque, as accelerations."""
LEVER_PER_M = 0.5
"""Torque from force, as accelerations."""


@dataclass(frozen=True, eq=False)
class Instrument:
    """What was drawn, SI."""

    delta_m: FloatArray
    """From mass 1 to mass 2."""
    centre_m: FloatArray
    """Of both, from the satellite's centre of mass."""
    scale: FloatArray
    theta_rad: FloatArray
    eta_rad: FloatArray
    quadratic_s2_m: FloatArray
    parasitic_m_s2: FloatArray
    """b1: minus parasitic force over mass."""
    bias_m_s2: FloatArray
    """b0: of the read-out."""
    gyro_bias_rad_s2: FloatArray
    tracker_bias_rad: FloatArray
    thruster: FloatArray
    """(6, 6): forces and torques done by those asked for."""

    @property
    def positions_m(self) -> FloatArray:
        """Where the masses are held, (2, 3)."""
        return np.stack([self.centre_m - 0.5 * self.delta_m, self.centre_m + 0.5 * self.delta_m])

    @property
    def rotations(self) -> FloatArray:
        """From satellite to sensor axes, (2, 3, 3)."""
        return np.stack([np.eye(3) + _antisymmetric(theta) for theta in self.theta_rad])

    @property
    def couplings(self) -> FloatArray:
        """K1 + eta, (2, 3, 3)."""
        return np.stack([np.diag(k) + _symmetric(eta) for k, eta in zip(self.scale, self.eta_rad, strict=True)])

    @property
    def matrices(self) -> FloatArray:
        """M = (K1 + eta) theta, (2, 3, 3)."""
        return np.asarray(self.couplings @ self.rotations)


def drawn(settings: SatelliteSettings, draw: int) -> Instrument:
    """The instrument of a draw: a function of the seed, the bounds and its number."""
    rng, bounds = generator(settings.seed, "instrument", draw), settings.bounds

    def within(bound: float) -> FloatArray:
        return np.asarray(rng.uniform(-1.0, 1.0, 3) * bound)

    def masses(common: float, different: float) -> FloatArray:
        c, d = within(common), within(different)
        return np.stack([c + d, c - d])

    # Drawn in this order; a new quantity goes to the end, or every satellite of a seed changes.
    return Instrument(
        delta_m=within(bounds.off_centring_m),
        centre_m=within(bounds.centre_m),
        scale=1.0 + masses(bounds.scale, bounds.scale),
        theta_rad=masses(bounds.theta_c_rad, bounds.theta_d_rad),
        eta_rad=masses(bounds.eta_rad, bounds.eta_rad),
        quadratic_s2_m=masses(bounds.quadratic_s2_m, bounds.quadratic_s2_m),
        parasitic_m_s2=masses(bounds.parasitic_c_m_s2, bounds.parasitic_d_m_s2),
        bias_m_s2=masses(bounds.bias_c_m_s2, bounds.bias_d_m_s2),
        gyro_bias_rad_s2=within(bounds.gyro_bias_rad_s2),
        tracker_bias_rad=bounds.tracker_bias_rad * rng.standard_normal(3),
        thruster=np.eye(6) + bounds.thruster * rng.uniform(-1.0, 1.0, (6, 6)) * _LEVERS,
    )


_LEVERS = np.block([[np.ones((3, 3)), np.full((3, 3), LEVER_M)], [np.full((3, 3), LEVER_PER_M), np.ones((3, 3))]])


def exact_truth(instrument: Instrument, settings: SatelliteSettings) -> dict[str, float]:
    """The ten parameters as the small signals of a session see them, where the loop holds the sensors."""
    a0 = operating_point(instrument, settings)
    # Small signals about a0 see a quadratic term as a slope 2 K2 a0.
    slopes = instrument.matrices + np.stack(
        [np.diag(2.0 * k * a) for k, a in zip(instrument.quadratic_s2_m, a0, strict=True)]
    )
    common, different = 0.5 * (slopes[0] + slopes[1]), 0.5 * (slopes[0] - slopes[1])
    ratio = different @ np.linalg.inv(common)
    of_gradient = common - ratio @ different
    k2 = instrument.quadratic_s2_m[:, 0]
    k2c, k2d = 0.5 * (k2[0] + k2[1]), 0.5 * (k2[0] - k2[1])
    # Per square of what is measured, not of what is applied.
    each = k2 / slopes[:, 0, 0] ** 2
    return _named(
        of_gradient,
        ratio,
        instrument.delta_m,
        a11=float(ratio[0, 0]),
        k2d=float((k2d - ratio[0, 0] * k2c) / common[0, 0] ** 2),
        k2c=float(np.mean(each)),
    )


def paper_truth(instrument: Instrument) -> dict[str, float]:
    """The ten parameters to the order at which the paper's eq. 21, 25 and 26 stop."""
    matrices = instrument.matrices
    common, different = 0.5 * (matrices[0] + matrices[1]), 0.5 * (matrices[0] - matrices[1])
    ratio = different @ np.linalg.inv(common)
    k1c = float(np.mean(instrument.scale[:, 0]))
    k2 = instrument.quadratic_s2_m[:, 0]
    k2c, k2d = 0.5 * float(k2[0] + k2[1]), 0.5 * float(k2[0] - k2[1])
    b1, b0 = instrument.parasitic_m_s2[:, 0], instrument.bias_m_s2[:, 0]
    b1d, b0c = 0.5 * float(b1[0] - b1[1]), 0.5 * float(b0[0] + b0[1])
    return _named(
        common - ratio @ different,
        ratio,
        instrument.delta_m,
        # The loop holds the mean of the common output, C0, at zero.
        a11=float(ratio[0, 0]) + 2.0 * k2c / k1c * b1d - 2.0 * k2d / k1c * b0c,
        k2d=k2d / k1c**2,
        k2c=k2c / k1c**2,
    )


def operating_point(instrument: Instrument, settings: SatelliteSettings) -> FloatArray:
    """What the electrodes apply on the average, (2, 3) m/s2, while the loop holds the mean common output at zero."""
    n = 2.0 * math.pi / settings.orbit_period_s
    # Means over an orbit: of mu / r^3, and of a direction that goes round in X and Z.
    gradient = n**2 * (1.0 - settings.eccentricity**2) ** -1.5 * np.diag([0.5, -1.0, 0.5])
    held = -instrument.positions_m @ gradient + instrument.parasitic_m_s2
    matrices, couplings = instrument.matrices, instrument.couplings
    common = np.zeros(3)
    # What is not linear is small, and smaller by as much in every round.
    for _ in range(6):
        applied = common + held
        measured = (
            instrument.bias_m_s2
            + np.einsum("kij,kj->ki", matrices, applied - instrument.parasitic_m_s2)
            + np.einsum("kij,kj->ki", couplings, instrument.parasitic_m_s2)
            + instrument.quadratic_s2_m * applied**2
        )
        common = common - np.linalg.solve(0.5 * (matrices[0] + matrices[1]), measured.mean(axis=0))
    return np.asarray(common + held)


def _named(
    of_gradient: FloatArray, ratio: FloatArray, delta_m: FloatArray, *, a11: float, k2d: float, k2c: float
) -> dict[str, float]:
    ac11 = float(of_gradient[0, 0])
    return {
        "ac11_dx_m": ac11 * float(delta_m[0]),
        "ac11_dy_m": ac11 * float(delta_m[1]),
        "ac11_dz_m": ac11 * float(delta_m[2]),
        "ac12_rad": float(of_gradient[0, 1]),
        "ac13_rad": float(of_gradient[0, 2]),
        "ad11": a11,
        "ad12_rad": float(ratio[0, 1]),
        "ad13_rad": float(ratio[0, 2]),
        "k2d_s2_m": k2d,
        "k2c_s2_m": k2c,
    }


def truths(settings: SatelliteSettings, draw: int) -> dict[str, Mapping[str, float]]:
    """`exact_truth` and `paper_truth` of a draw, by these names; the test's `delta` as `test_truth`."""
    instrument = drawn(settings, draw)
    return {
        "exact_truth": exact_truth(instrument, settings),
        "paper_truth": paper_truth(instrument),
        "test_truth": {"delta": settings.eotvos},
    }


def _antisymmetric(t: FloatArray) -> FloatArray:
    # The axes turn by t and vectors stay: the transpose of what turns a vector.
    return np.array([[0.0, t[2], -t[1]], [-t[2], 0.0, t[0]], [t[1], -t[0], 0.0]])


def _symmetric(e: FloatArray) -> FloatArray:
    return np.array([[0.0, e[2], e[1]], [e[2], 0.0, e[0]], [e[1], e[0], 0.0]])
