"""What thrusters make of what is asked of them."""

from __future__ import annotations

import numpy as np
from numba import njit

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite import layout
from simulators.worlds.satellite.layout import LANES

L = LANES
_ASKED = layout.STATE["asked"] * L
_C = layout.CONSTANT
_LEAST, _SMALLEST, _LARGEST = _C["least"], _C["smallest"], _C["largest"]


@njit(cache=True, nogil=True)
def quantise(s: FloatArray, c: FloatArray) -> None:
    """Thrusters with a step, a least and a largest force, as accelerations; what is below the least is not done."""
    step, smallest, largest = c[_LEAST], c[_SMALLEST], c[_LARGEST]
    for place in range(_ASKED, _ASKED + 3 * L):
        asked = s[place]
        if step > 0.0:
            asked = step * np.rint(asked / step)
        if abs(asked) < smallest:
            asked = 0.0
        if largest > 0.0:
            asked = min(max(asked, -largest), largest)
        s[place] = asked
