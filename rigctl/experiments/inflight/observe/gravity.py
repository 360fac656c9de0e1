"""Whether gravity in the telemetry of a session of the test is that of its orbit and its turning."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

import numpy as np

from rigctl.campaign.layout import UnitFindings, slip_between
from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.observe.stimulus import CERTAIN_SIGMA, line_of

EARTH_M3_S2 = 3.986004418e14
"""WGS 84."""

OFF_BY = 0.5
"""Of gravity: eccentricity, dating and gaps change its line by far less."""


def gravity_findings(orbit_period_s: float, spin_hz: float, columns: Mapping[str, FloatArray]) -> UnitFindings:
    """Column g_x against the Earth's pull at the frequency of the test: what is in it goes into delta as a factor.

    t_s counts from perigee, on +X: there the pull is against X. A session without the column is left out where it is
    reduced.
    """
    if "g_x" not in columns:
        return UnitFindings()
    f_hz = 1.0 / orbit_period_s + spin_hz
    pull_m_s2 = math.cbrt(EARTH_M3_S2 * (2.0 * np.pi / orbit_period_s) ** 4)
    seen, sigma = line_of(columns["t_s"], columns["g_x"], f_hz)
    if not math.isfinite(sigma) or abs(seen + pull_m_s2) < OFF_BY * pull_m_s2:
        return UnitFindings()
    shown = f"g_x is {abs(seen):.3g} m/s2 at {f_hz:.4g} Hz"
    if abs(seen) > CERTAIN_SIGMA * sigma and (slip := slip_between(abs(seen), pull_m_s2)):
        return UnitFindings(f"{shown}, gravity there is {pull_m_s2:.3g}: off by {slip:.0e}; write it in m/s2")
    return UnitFindings(
        contradiction=f"{shown} with a phase of {round(math.degrees(cmath.phase(seen)))} deg, gravity there is "
        f"{pull_m_s2:.3g} with 180 deg; write the session and spin_frequency_hz that were flown, t_s from perigee, "
        "and g_x, g_y, g_z towards the Earth"
    )
