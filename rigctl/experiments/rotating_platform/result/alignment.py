"""Where the sensing axes and the platform's axis point: the flip, the angle scan, the regression on commanded tilts.

The model is that of Lenoir, Christophe, Reynaud, Measurement 46 (2013) 1411, eq. 3, with 1 + k where it prints k, and

    bias = electrical bias / scale factor - g wobble

for both sensors: so its wobbles come out, to all digits for A (its eq. 5a has the other sign for B). The wobble is
the elevation of a sensing axis out of the plane normal to the rotation axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import special

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError

_MAX_CONDITION = 1e8
# Readings that scatter like this by chance one time in a thousand have another noise.
_CONTRADICTED_P = 1e-3


@dataclass(frozen=True)
class Fitted:
    """Parameters of a linear fit in the order of `names` with their covariance.

    Sigmas are those given with the data; where none were given they are the scatter of the residuals.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray

    def value(self, name: str) -> float:
        """A parameter."""
        return float(self.values[self.names.index(name)])

    def sigma(self, name: str) -> float:
        """Its standard uncertainty."""
        index = self.names.index(name)
        return math.sqrt(float(self.covariance[index, index]))

    def quantity(self, name: str) -> Value:
        """Both."""
        return Value(self.value(name), self.sigma(name))

    def as_json(self, unit: float = 1.0) -> dict[str, Any]:
        """Every parameter, `unit` times as large, within `rigctl result --json`."""
        return {name: Value(unit * self.value(name), unit * self.sigma(name)).as_json() for name in self.names}


@dataclass(frozen=True)
class Value:
    """A value with its standard uncertainty."""

    value: float
    sigma: float

    def as_json(self) -> dict[str, float | None]:
        """Within `rigctl result --json`; None for what is not known."""
        return {name: number if math.isfinite(number) else None for name, number in vars(self).items()}


def flip(g_sign: Sequence[float], readings_v: FloatArray, g_m_s2: float, sigma_v: FloatArray | None = None) -> Fitted:
    """Scale factor `gain_v_per_m_s2` and electrical bias `bias_v` of a chain from readings with +g and -g along it.

    Raises `DataError` unless both directions are among them.
    """
    along = np.asarray(g_sign, dtype=np.float64) * g_m_s2
    columns = np.stack([along, np.ones_like(along)], axis=1)
    what = "the flip: read the chain with its axis up and down"
    return _fit(
        ("gain_v_per_m_s2", "bias_v"), columns, readings_v, None if sigma_v is None else np.diag(sigma_v**2), what
    )


def angle_scan(
    theta_rad: FloatArray, readings: FloatArray, noise: FloatArray | None = None, *, level_known: bool = True
) -> Fitted:
    """Offset, cos and sin of a reading over the platform's angle, in the readings' unit (eq. 6).

    Each channel is fitted freely: that both see one acceleration with axes at a right angle is not assumed. `noise`
    is the covariance of the readings, shape (angles, angles): a bias wanders from one to the next, which a scatter
    about the fit shows a part of only. Its level is that of the residuals unless it is known, or where they
    contradict it. Raises `DataError` when the angles are too few to tell them.
    """
    columns = np.stack([np.ones_like(theta_rad), np.cos(theta_rad), np.sin(theta_rad)], axis=1)
    what = "the angle scan: dwell at more angles, over a full turn"
    fitted = _fit(("offset", "cos", "sin"), columns, readings, noise, what)
    if noise is None:
        return fitted
    left = readings - columns @ fitted.values
    chi2, dof = float(left @ np.linalg.solve(noise, left)), len(readings) - 3
    if level_known and special.chdtrc(dof, chi2) >= _CONTRADICTED_P:
        return fitted
    return replace(fitted, covariance=fitted.covariance * chi2 / dof) if dof else fitted


@dataclass(frozen=True)
class Axes:
    """Two sensors' axes by what they see of one acceleration: ratio of y to z, and their angle beyond a right one."""

    amplitude_ratio: Value
    nonorthogonality_rad: Value


def axes(scan_y: Fitted, scan_z: Fitted) -> Axes:
    """The two sensors' amplitudes and directions from their angle scans; eq. 3 says 1 and 0 but for scale factors.

    Raises `DataError` when a channel sees no acceleration.
    """
    (amplitude_y, phase_y), (amplitude_z, phase_z) = _polar(scan_y), _polar(scan_z)
    # The reading of z lags that of y by a right angle: m_z goes as -a_Y sin + a_Z cos, m_y as a_Y cos + a_Z sin.
    excess = math.remainder(phase_y.value - phase_z.value - 0.5 * math.pi, 2.0 * math.pi)
    ratio = amplitude_y.value / amplitude_z.value
    relative = math.hypot(amplitude_y.sigma / amplitude_y.value, amplitude_z.sigma / amplitude_z.value)
    return Axes(Value(ratio, ratio * relative), Value(excess, math.hypot(phase_y.sigma, phase_z.sigma)))


@dataclass(frozen=True)
class MeanBias:
    """The mean bias of a sensor over all runs [m/s2] with its standard uncertainty; `dof` infinite for one run."""

    value: float
    sigma: float
    dof: float


def wobble_of(bias_m_s2: float, electrical_bias_v: float, gain_v_per_m_s2: float, g_m_s2: float) -> float:
    """The wobble of a sensor [rad] from its bias, its chain's electrical bias and assumed scale factor."""
    return (electrical_bias_v / gain_v_per_m_s2 - bias_m_s2) / g_m_s2


def _polar(scan: Fitted) -> tuple[Value, Value]:
    """Amplitude and phase of cos and sin."""
    cos, sin = scan.value("cos"), scan.value("sin")
    amplitude = math.hypot(cos, sin)
    if not amplitude > 0.0:
        raise DataError("the angle scan of a channel shows no acceleration: tilt the platform, or look at its cable")
    part = scan.covariance[1:, 1:]
    # Gradients of amplitude and phase by cos and sin.
    along, across = np.array([cos, sin]) / amplitude, np.array([-sin, cos]) / amplitude**2
    return (
        Value(amplitude, math.sqrt(along @ part @ along)),
        Value(math.atan2(sin, cos), math.sqrt(across @ part @ across)),
    )


def _fit(
    names: tuple[str, ...], columns: FloatArray, values: FloatArray, noise: FloatArray | None, what: str
) -> Fitted:
    """Least squares by the covariance of the values; raises `DataError` that ends with `what` the data should be."""
    count, width = columns.shape
    dof = count - width
    if not np.isfinite(values).all() or not np.isfinite(columns).all():
        raise DataError(f"a value that is no number cannot enter {what}")
    if noise is not None and not (np.isfinite(noise).all() and (np.diag(noise) > 0.0).all()):
        raise DataError(f"a value without an uncertainty (a reading that never changes has none) cannot enter {what}")
    if dof < (1 if noise is None else 0) or not np.linalg.cond(columns / _sizes(columns)) < _MAX_CONDITION:
        raise DataError(f"{count} values do not tell {' and '.join(names)} in {what}")
    whitened = columns / _sizes(columns)
    if noise is not None:
        root = np.linalg.cholesky(noise)
        whitened, values = np.linalg.solve(root, whitened), np.linalg.solve(root, values)
    left, size, right = np.linalg.svd(whitened, full_matrices=False)
    inverse = (right.T / size) / _sizes(columns)[:, None]
    fitted = inverse @ (left.T @ values)
    # Without a stated noise the residuals' scatter is it.
    scale = float(((values - left @ (left.T @ values)) ** 2).sum()) / dof if noise is None else 1.0
    return Fitted(names, fitted, scale * inverse @ inverse.T)


def _sizes(columns: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.abs(columns).max(axis=0), np.finfo(float).tiny))
