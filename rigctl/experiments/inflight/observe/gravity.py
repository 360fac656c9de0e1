"""Whether gravity in the telemetry can be gravity: its gradient has no trace, its pull is that of the orbit."""

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

DIAGONAL = ("t_xx", "t_yy", "t_zz")

TRACELESS = 3e-4
"""Of the gradient: what moves an off-centring of 20 um by its sigma, 6 nm."""


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


def trace_remark(columns: Mapping[str, FloatArray]) -> str | None:
    """That the gradient in the telemetry is none, as Laplace's equation has its trace zero; None when it may be one.

    Whatever the orbit and the attitude are: a factor in one element would pass for another off-centring.
    """
    diagonal = np.array([columns[name] for name in DIAGONAL])
    diagonal = diagonal[:, np.isfinite(diagonal).all(axis=0)]
    trace = diagonal.sum(axis=0)
    largest = max(map(_rms, diagonal))
    if _rms(trace) <= TRACELESS * largest:
        return None
    shown = f"t_xx + t_yy + t_zz is {_rms(trace):.2g} 1/s2 (rms), and zero for any gravity"
    # How much larger each element would have to be, were it alone.
    factors = [1.0 - float(each @ trace) / max(float(each @ each), np.finfo(float).tiny) for each in diagonal]
    left = [_rms(trace + (factor - 1.0) * each) for factor, each in zip(factors, diagonal, strict=True)]
    best = int(np.argmin(left))
    if left[best] > TRACELESS * largest:
        return f"{shown}: write the gradient as orbit and attitude give it, without what turning adds"
    return (
        f"{shown}: {DIAGONAL[best]} would have to be {factors[best]:.5g} times as large; write it as orbit and "
        "attitude give it"
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
