"""Gravity and its gradient as they come down: by the orbit and the attitude that the ground knows."""

from __future__ import annotations

from numba import njit

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite import layout
from simulators.worlds.satellite.layout import LANES

L = LANES
_BELIEVED = layout.FORCING["believed"]


@njit(cache=True, nogil=True, inline="always")
def believed_gravity(o: FloatArray, f: FloatArray) -> None:
    """Columns 6 to 11 and 21 to 23 of telemetry `o`, from its attitude and the forcing `f`."""
    g, cosine, sine, pull = f[_BELIEVED], f[_BELIEVED + 1], f[_BELIEVED + 2], f[_BELIEVED + 3]
    for i in range(L):
        # Columns 15 to 17: the attitude that comes down, not the true one.
        qx, qy, qz = 0.5 * o[15 * L + i], 0.5 * o[16 * L + i], 0.5 * o[17 * L + i]
        r = 2.0 / (1.0 + qx * qx + qy * qy + qz * qz)
        ux, uy, uz = qy * sine, qz * cosine - qx * sine, -qy * cosine
        rx = cosine - r * (ux - (qy * uz - qz * uy))
        ry = -r * (uy - (qz * ux - qx * uz))
        rz = sine - r * (uz - (qx * uy - qy * ux))
        o[6 * L + i] = g * (3.0 * rx * rx - 1.0)
        o[7 * L + i] = 3.0 * g * rx * rz
        o[8 * L + i] = g * (3.0 * ry * ry - 1.0)
        o[9 * L + i] = g * (3.0 * rz * rz - 1.0)
        o[10 * L + i] = 3.0 * g * rx * ry
        o[11 * L + i] = 3.0 * g * ry * rz
        o[21 * L + i], o[22 * L + i], o[23 * L + i] = -pull * rx, -pull * ry, -pull * rz
