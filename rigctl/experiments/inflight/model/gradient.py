"""Changes of the gravity gradient T, shape (3, 3, n): by attitude errors, by a moving orbit, by the Earth's J2."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.observe.gravity import EARTH_M3_S2

EARTH_RADIUS_M = 6378137.0
"""WGS 84."""

_TURN_Y = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
"""What turning the orbit from X to Z does to a direction, per radian."""


def _turned(gradient: FloatArray, generator: FloatArray) -> FloatArray:
    """The change of T when directions change by `generator`, (3, 3) or (3, 3, n)."""
    if generator.ndim == 2:
        generator = generator[:, :, None]
    generator = np.broadcast_to(generator, gradient.shape)
    return np.asarray(np.einsum("ijn,jkn->ikn", generator, gradient) - np.einsum("ijn,jkn->ikn", gradient, generator))


def attitude_error(gradient: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """The change of T in the satellite's frame when its true attitude is the estimated one less (x, y, z)."""
    zero = np.zeros(gradient.shape[2])
    x, y, z = zero + x, zero + y, zero + z
    return _turned(gradient, np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]))


def precession(
    gradient: FloatArray, orbital: float, t_s: FloatArray, perigee_rate: FloatArray, eccentricity_rate: FloatArray
) -> FloatArray:
    """The change of T when perigee and eccentricity move at these rates from `t_s` = 0 on."""
    mean = orbital * t_s
    # Over ten orbits the angle reaches hundredths: its square counts.
    angle, none, one = perigee_rate * t_s, np.zeros_like(mean), np.ones_like(mean)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, none, -s], [none, one, none], [s, none, c]])
    precessed = np.einsum("ijn,jkn,lkn->iln", turn, gradient, turn) - gradient
    # Kepler to first order in e: nu = M + 2 e sin M, (a/r)^3 = 1 + 3 e cos M.
    grown = 2.0 * np.sin(mean) * _turned(gradient, _TURN_Y) + 3.0 * np.cos(mean) * gradient
    return np.asarray(precessed + eccentricity_rate * t_s * grown)


def flattening(orbital: float, t_s: FloatArray, products: FloatArray) -> FloatArray:
    """What J2 adds to T along an orbit of angular frequency `orbital`; `products` (3, 3) are J2 times those of the
    components of the Earth's pole."""
    # The orbit's eccentricity changes what is small by a hundredth.
    cosine, sine = np.cos(orbital * t_s), np.sin(orbital * t_s)
    u = np.array([cosine, np.zeros_like(cosine), sine])
    axis_m = (EARTH_M3_S2 / orbital**2) ** (1.0 / 3.0)
    # GM / a^3 is the square of the orbital frequency.
    # What follows are second derivatives of -(GM R^2 / 2) (3 r.P.r / r^5 - tr P / r^3), with P the `products`.
    factor = -0.5 * (orbital * EARTH_RADIUS_M / axis_m) ** 2
    along = np.einsum("ij,jn->in", products, u)
    latitude = np.einsum("in,in->n", u, along)
    trace = np.trace(products)
    eye, outer = np.eye(3)[:, :, None], u[:, None] * u[None]
    return np.asarray(
        factor
        * (
            6.0 * products[:, :, None]
            - 30.0 * (along[:, None] * u[None] + u[:, None] * along[None])
            + (3.0 * trace - 15.0 * latitude) * eye
            + (105.0 * latitude - 15.0 * trace) * outer
        )
    )
