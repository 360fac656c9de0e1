"""What the estimates of a known instrument ought to be: exactly, and to the order the paper keeps.

A simulated calibration knows its instrument; this is the arithmetic that turns its numbers into the ten parameters.
Matrices are M_k = (K1_k + eta_k) theta_k, with the antisymmetric convention of `rotation_matrix`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.interfaces import FloatArray

_ITERATIONS = 12


@dataclass(frozen=True)
class Instrument:
    """Two masses (rows: inner, outer) on three axes: all arrays (2, 3) but `off_centring_m` (3,), O1 to O2.

    `scale` K1, `rotation_rad` and `coupling_rad` the three angles of theta and eta, `quadratic_s2_m` K2,
    `parasitic_m_s2` b1 (minus parasitic force over mass), `bias_m_s2` b0.
    """

    off_centring_m: FloatArray
    scale: FloatArray
    rotation_rad: FloatArray
    coupling_rad: FloatArray
    quadratic_s2_m: FloatArray
    parasitic_m_s2: FloatArray
    bias_m_s2: FloatArray

    def gains(self) -> FloatArray:
        """K1 + eta of both masses, (2, 3, 3)."""
        return np.array([np.diag(self.scale[k]) + coupling_matrix(self.coupling_rad[k]) for k in (0, 1)])

    def matrices(self) -> FloatArray:
        """M of both masses, (2, 3, 3)."""
        return np.array([self.gains()[k] @ (np.eye(3) + rotation_matrix(self.rotation_rad[k])) for k in (0, 1)])


def rotation_matrix(angles: FloatArray) -> FloatArray:
    """theta - 1 for small angles about x, y, z."""
    x, y, z = angles
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def coupling_matrix(angles: FloatArray) -> FloatArray:
    """eta: symmetric, without a diagonal."""
    x, y, z = angles
    return np.array([[0.0, z, y], [z, 0.0, x], [y, x, 0.0]])


def exact_truth(instrument: Instrument) -> FloatArray:
    """The small-signal values at the operating point, in the order of `parameters.NAMES`."""
    applied = operating_point(instrument) + instrument.parasitic_m_s2
    slope = instrument.matrices()
    for k in (0, 1):
        slope[k] += np.diag(2.0 * instrument.quadratic_s2_m[k] * applied[k])
    common, difference = _halves(slope)
    a_d = (difference @ np.linalg.inv(common))[0]
    a_c = _along_x(slope)
    k2_c, k2_d = _halves(instrument.quadratic_s2_m[:, 0])
    k_d = (k2_d - a_d[0] * k2_c) / common[0, 0] ** 2
    k_1, k_2 = instrument.quadratic_s2_m[:, 0] / slope[:, 0, 0] ** 2
    return np.array([*(a_c[0] * instrument.off_centring_m), *a_c[1:], *a_d, k_d, 0.5 * (k_1 + k_2)])


def paper_truth(instrument: Instrument) -> FloatArray:
    """The values to the order the paper keeps (eq. 21, 25, 26), in the order of `parameters.NAMES`."""
    matrices = instrument.matrices()
    common, difference = _halves(matrices)
    a_d = (difference @ np.linalg.inv(common))[0]
    a_c = _along_x(matrices)
    k1_c, _ = _halves(instrument.scale[:, 0])
    k2_c, k2_d = _halves(instrument.quadratic_s2_m[:, 0])
    _, b1_d = _halves(instrument.parasitic_m_s2[:, 0])
    b0_c, _ = _halves(instrument.bias_m_s2[:, 0])
    a_d[0] += 2.0 * k2_c / k1_c * b1_d - 2.0 * k2_d / k1_c * b0_c
    return np.array([*(a_c[0] * instrument.off_centring_m), *a_c[1:], *a_d, k2_d / k1_c**2, k2_c / k1_c**2])


def operating_point(instrument: Instrument) -> FloatArray:
    """The constant acceleration of the satellite, less parasitic forces, at which the mean output is nil; (3,)."""
    satellite = np.zeros(3)
    matrices, gains = instrument.matrices(), instrument.gains()
    free = instrument.parasitic_m_s2
    for _ in range(_ITERATIONS):
        outputs = [
            instrument.bias_m_s2[k]
            + matrices[k] @ satellite
            + gains[k] @ free[k]
            + instrument.quadratic_s2_m[k] * (satellite + free[k]) ** 2
            for k in (0, 1)
        ]
        satellite = satellite - 0.5 * (outputs[0] + outputs[1])
    return satellite


def _halves(of_masses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Half sum and half difference, inner less outer."""
    return 0.5 * (of_masses[0] + of_masses[1]), 0.5 * (of_masses[0] - of_masses[1])


def _along_x(matrices: FloatArray) -> FloatArray:
    """First row of A_c = M_c - M_d M_c^-1 M_d."""
    common, difference = _halves(matrices)
    return np.asarray((common - difference @ np.linalg.inv(common) @ difference)[0])
