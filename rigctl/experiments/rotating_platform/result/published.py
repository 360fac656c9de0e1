"""What Lenoir, Christophe, Reynaud print in Measurement 46 (2013) 1411-1420, for results to be shown beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping

SOURCE = "Lenoir, Christophe, Reynaud 2013 (Measurement 46, 1411)"

TILT_GAIN, INTERCEPT_M_S2 = 0.964, 2.8757e-4
"""Eq. 13."""

ACCEL_Y_M_S2 = -2.98e-4
BIAS_M_S2: Mapping[str, float] = {"z": 10.54e-4, "y": -14.33e-4}
"""Eq. 6."""

SCAN_COMMANDED_M_S2 = -0.5 / 825.0
"""Eq. 6: the tilt during the scan, V_Z = -0.5 V: there eq. 13 gives an acceleration along Z of the printed sign."""


GAIN_V_PER_M_S2: Mapping[str, float] = {"z": 846.73, "y": 804.32}
"""Scale factors of the two Q-Flex chains: what is printed is of these."""


def same_sensors(gain_v_per_m_s2: Mapping[str, float]) -> bool:
    """Whether chains believed to have these scale factors are those that the paper has numbers for."""
    return all(math.isclose(gain_v_per_m_s2[each], gain, rel_tol=0.01) for each, gain in GAIN_V_PER_M_S2.items())


def scanned_alike(commanded_m_s2: float) -> bool:
    """Whether a scan under this commanded tilt is one that eq. 6 has numbers for."""
    return math.isclose(commanded_m_s2, SCAN_COMMANDED_M_S2, rel_tol=0.01)


SCAN_M_S2: Mapping[str, Mapping[str, float]] = {
    "y": {"offset": BIAS_M_S2["y"], "cos": -2.94e-4, "sin": -2.98e-4},
    "z": {"offset": BIAS_M_S2["z"], "cos": -3.34e-4, "sin": 3.02e-4},
}
"""Eq. 6, by channel: readings over the platform's angle."""

PRECISION_THEORY_M_S2 = 1.8073e-7
PRECISION_M_S2: Mapping[float, float] = {10.0: 1.6631e-7, 100.0: 1.5718e-7, 200.0: 1.2524e-7}
"""Table 4: in an hour with pattern c of 1 min, by sampling rate [Hz]."""

BIAS_PP_M_S2, BIAS_PP_MEASURED_M_S2 = 3.15e-4, 3.06e-4
SHIFT_MIN = 17.5
"""Figure 8: bias of pattern a, 5 min, under a sine of 60 min and amplitude 1 V; stamped at the end of the window."""

SINE_TAU_S, SINE_V = 300.0, 1.0
