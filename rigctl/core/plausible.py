"""What a quantity cannot be, by its name: constants of a rig file or a recording, and columns of samples."""

from __future__ import annotations

import math

from rigctl.core.numbers import MAGNITUDE_MAX
from rigctl.core.units import unit_of_column

ABSOLUTE_ZERO_C = -273.15
HOTTEST_C = 1e4
"""Nothing with a sensor on it is hotter."""

ANGLE_MAX_DEG = 36_000.0
"""A hundred turns: more than any cable, and than any stage's counter is trusted for."""

GRAVITY_MAX_M_S2 = 30.0
"""Above that of Jupiter."""

GRAVITY_ON_EARTH_M_S2 = (9.76, 9.84)
"""From Huascaran to the Arctic Ocean."""

ORBIT_MIN_S = 1000.0
"""No body of ordinary matter is so dense that it can be circled faster; in minutes an orbit looks like that."""

ECCENTRICITY_MAX = 1.0


def flaw_of_constant(name: str, value: float) -> str | None:
    """Why a constant of this name cannot be `value`, and the mend; None when it can. Units are in names."""
    if not abs(value) <= MAGNITUDE_MAX:
        return f"is {value:g}, no quantity; write a number, or leave it out"
    if name == "g_m_s2" and not 0.0 < value <= GRAVITY_MAX_M_S2:
        return f"is {value:g}; write the local gravity, positive, in m/s2, about 9.8 on Earth"
    if name.startswith("gain") and value == 0.0:
        return "is 0, which measures nothing; write the scale factor, or leave it out"
    if name == "orbit_period_s" and value < ORBIT_MIN_S:
        return f"is {value:g}, shorter than any orbit; write it in seconds"
    if name == "eccentricity" and not 0.0 <= value < ECCENTRICITY_MAX:
        return f"is {value:g}, that of no orbit; write a number from 0 to below 1"
    lowest, _ = possible_range(unit_of_column(name))
    return f"is {value:g}, below absolute zero; mend it" if value < lowest else None


def doubt_of_constant(name: str, value: float) -> str | None:
    """What is strange about a constant that can be true; None for nothing."""
    low, high = GRAVITY_ON_EARTH_M_S2
    if name == "g_m_s2" and not low <= value <= high:
        return f"is {value:g}, which is found nowhere on Earth ({low:g} to {high:g}); check it"
    return None


def possible_range(unit: str) -> tuple[float, float]:
    """From the smallest to the largest value that a reading in `unit` can have."""
    ranges = {
        "degC": (ABSOLUTE_ZERO_C, HOTTEST_C),
        "K": (0.0, HOTTEST_C),
    }
    return ranges.get(unit, (-math.inf, math.inf))
