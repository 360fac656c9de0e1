"""Noise of the sensors along X, sixteen satellites at a time."""

from __future__ import annotations

from numba import njit

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite import layout
from simulators.worlds.satellite.layout import LANES

L = LANES
_POLES = layout.POLES
_S = layout.by_lane(layout.STATE)
_READ, _RED1, _RED2 = _S["readout"], _S["red_1"], _S["red_2"]


@njit(cache=True, nogil=True, inline="always")
def sensor_noise(
    sensor: FloatArray, noise: FloatArray, s: FloatArray, red: FloatArray, readout: float, loud: float
) -> None:
    """Of both x sensors: white and 1/f acceleration, and a position noise differentiated twice."""
    for mass in range(2):
        at = _RED1 if mass == 0 else _RED2
        held = _READ + 2 * mass * L
        for i in range(L):
            sensor[mass * L + i] = noise[mass * L + i]
        for pole in range(_POLES):
            p, r = red[mass, 0, pole], red[mass, 1, pole]
            place = at + pole * L
            for i in range(L):
                sensor[mass * L + i] += r * s[place + i]
                s[place + i] = p * s[place + i] + noise[mass * L + i]
        white = red[mass, 2, 0]
        for i in range(L):
            now = noise[(2 + mass) * L + i]
            # Second difference: the read-out's noise is one of position, and the loop measures accelerations.
            twice = now - 2.0 * s[held + i] + s[held + L + i]
            s[held + L + i] = s[held + i]
            s[held + i] = now
            sensor[mass * L + i] = loud * (white * sensor[mass * L + i] + readout * twice)
