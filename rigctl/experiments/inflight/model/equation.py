"""The equation of the baseline: how the amplitudes of all series of a session depend on each other.

With y_k the linearised x output of mass k, G = T - In, D the off-centring and a = a'_d11,

    (1 - a) y_1 - (1 + a) y_2
        = sum_jl a_c1j G_jl D_l + 2 a_d12 (m_cy - K_y m_cy^2) + 2 a_d13 (m_cz - K_z m_cz^2) + moved

in every session. Left side less right side is linear in the amplitudes of the series, with coefficients that the
parameters give: `coefficients`. It keeps what the published first-order equation leaves out, and holds at every line.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.experiments.inflight.model.parameters import of_masses
from rigctl.experiments.inflight.observe.series import INDEX, SERIES, Amplitudes
from rigctl.experiments.inflight.observe.sessions import QUADRATIC, Session, moved_axis

AnyArray = NDArray[Any]


def coefficients(session: Session, amplitudes: Amplitudes, p: AnyArray) -> AnyArray:
    """Of each series in left side less right side, for parameters (shared, k), complex or not; shape (series, k).

    Of `amplitudes` only the constant levels are used.
    """
    dx, dy, dz, ac12, ac13, ad11, ad12, ad13, k2d, k2c, ac11, theta_cx, k_y, k_z, ad22, ad33 = p
    c = np.zeros((len(SERIES), p.shape[1]), dtype=p.dtype)

    def put(name: str, value: AnyArray) -> None:
        c[INDEX[name]] = value

    k_1, k_2 = of_masses(k2d, k2c, ad11)
    # The loop holds the mean of both outputs at zero: unequal squares move the two levels apart by this much.
    level = 0.5 * (k_1 - k_2) * amplitudes.mean_square
    factors, curves = [1.0 - ad11, -(1.0 + ad11)], [k_1, k_2]
    if session.name in QUADRATIC:
        level = np.zeros_like(dx)
        slopes = [slope_in_loop_of_one_mass(k, session, amplitudes) for k in curves]
        # a'_d11 is of the slopes that the masses have where the mean of both is held.
        factors = [factor / slope for factor, slope in zip(factors, slopes, strict=True)]
        curves = [k / slope**2 for k, slope in zip(curves, slopes, strict=True)]
    for name, factor, curve, mu in zip(("m1", "m2"), factors, curves, (level, -level), strict=True):
        # y = m - k m^2 + 2 k^2 m^3 (E10), written out for m counted from its level mu.
        put(name, factor * (1.0 - 2.0 * curve * mu + 6.0 * curve**2 * mu**2))
        put(f"{name}^2", factor * (6.0 * curve**2 * mu - curve))
        put(f"{name}^3", factor * 2.0 * curve**2)
    # The parameters are a_c11 times the off-centring; the other rows need the off-centring itself.
    x, y, z = dx / ac11, dy / ac11, dz / ac11
    put("t_xx", -dx)
    put("t_xy", -(dy + ac12 * x))
    put("t_xz", -(dz + ac13 * x))
    put("t_yy", -ac12 * y)
    put("t_yz", -(ac12 * z + ac13 * y))
    put("t_zz", -ac13 * z)
    # In is antisymmetric in the angular acceleration; w^2 is nothing where the pointing is inertial.
    put("dw_x", ac13 * y - ac12 * z)
    put("dw_y", dz - ac13 * x)
    put("dw_z", ac12 * x - dy)
    put("y", -2.0 * ad12)
    put("y^2", 2.0 * ad12 * k_y)
    put("z", -2.0 * ad13)
    put("z^2", 2.0 * ad13 * k_z)
    for axis, value in zip("xyz", (ac11, ac12, ac13), strict=True):
        put(f"force {axis}", -value)
    _put_moved(session.name, put, (ac11, ac12, ac13), theta_cx, (ad22 * ad12, ad33 * ad13))
    return c


def slope_in_loop_of_one_mass(k: Any, session: Session, amplitudes: Amplitudes) -> Any:
    """Slope J of a mass's output where the loop holds one mass at zero, over that where it holds the mean of both.

    The output is higher there by half the masses' distance, m_dx; k = K2 / J^2 is smaller by the slope's square.
    """
    higher = amplitudes.apart if session.name == "k2c_1" else -amplitudes.apart
    return 1.0 + 2.0 * k * higher


def _put_moved(
    name: str, put: Any, ac1: tuple[AnyArray, ...], theta_cx: AnyArray, beyond: tuple[AnyArray, AnyArray]
) -> None:
    """The gradient on what was moved, along the masses' own axes, theta_c^T e: (-theta_cz, 1, theta_cx) for Y,
    (theta_cy, -theta_cx, 1) for Z; a_c11 theta_cz = a_c12 + a_d22 a_d12, -a_c11 theta_cy = a_c13 + a_d33 a_d13."""
    ac11, ac12, ac13 = ac1
    if name == "ac12":
        put("moved g_xx", ac12 + beyond[0])
        put("moved g_xy", -ac11)
        put("moved g_xz", -ac11 * theta_cx)
        put("moved g_yy", -ac12)
        put("moved g_zz", -ac13 * theta_cx)
    elif name == "ac13":
        put("moved g_xx", ac13 + beyond[1])
        put("moved g_xy", ac11 * theta_cx)
        put("moved g_xz", -ac11)
        put("moved g_zz", -ac13)
    elif name in QUADRATIC:
        put("moved g_xx", ac11 if name == "k2c_1" else -ac11)


def gain_ratio(apart: complex, common: complex) -> float:
    """a_d22 or a_d33 from amplitudes of m_1 - m_2 and m_c along that axis, where control shakes the satellite."""
    # Half the gains' difference over their mean: the slope of m_1 - m_2 on 2 m_c, in phase.
    return float(0.5 * np.real(np.conj(common) * apart) / np.abs(common) ** 2)


def own_channel(session: Session) -> AnyArray:
    """Coefficients of the series that make the moved masses' own channel, m_1 - m_2 along the motion; (series,)."""
    return own_series("xyz"[moved_axis(session)])


def own_series(axis: str) -> AnyArray:
    """Coefficients of m_1 - m_2 along an axis, (series,)."""
    c = np.zeros(len(SERIES))
    c[INDEX[f"own {axis}"]] = 1.0
    return c


def common_series(axis: str) -> AnyArray:
    """Coefficients of (m_1 + m_2) / 2 along an axis, (series,)."""
    c = np.zeros(len(SERIES))
    c[[INDEX[name] for name in (("m1", "m2") if axis == "x" else (axis,))]] = 0.5 if axis == "x" else 1.0
    return c


def own_force(session: Session) -> AnyArray:
    """Coefficients of the series that make the force in that channel, before the sensor's gain; (series,).

    An oscillation's acceleration is -(2 pi f)^2 of the displacement, of mass 1 less that of mass 2.
    """
    c = np.zeros(len(SERIES))
    square = (2.0 * math.pi * session.frequency_hz) ** 2
    c[INDEX["moved"]] = -square if session.name == "k2c_1" else square
    c[INDEX[f"force {'xyz'[moved_axis(session)]}"]] = 1.0
    return c
