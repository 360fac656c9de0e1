"""The sensing axis as the normal of the non-sensitivity plane.

The motion vectors found at the nulls span a plane through the origin; its normal is the sensing axis.
Lucente et al. 2022 (Planetary and Space Science 211) solve z = -a'x - b'y by the normal equations (eq. 12). They
count all scatter as one of z, so that an axis near the xy-plane is drawn off, by arcseconds for the paper's Y. Here
the result is the total-least-squares normal; eq. 12 stands beside it: the printed theta_m are a property of it.

Arrays are (n, 3), rows are points; angles are in rad unless the name says arcsec.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.analysis.decomposition import svd
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError

ARCSEC = np.pi / 648000.0
"""One second of arc in rad."""

# Of the normal equations: beyond it the vectors stand upright over one line, and z follows from nothing.
_MAX_CONDITION = 1e12
# Vectors of one configuration differ by the mounting's milliradians: a line through them is no plane.
_MIN_SPREAD = 0.05


@dataclass(frozen=True)
class Axis:
    """A unit vector and its covariance (3, 3) [rad^2], singular along itself, of `dof` degrees of freedom."""

    unit: FloatArray
    covariance: FloatArray
    dof: float = np.inf


@dataclass(frozen=True)
class AxisAngle:
    """Angle between two axes and its standard uncertainty [rad]."""

    rad: float
    sigma_rad: float


@dataclass(frozen=True)
class PaperAxis:
    """The axis `unit` (3,) by the paper's eq. 12, and the mean angle out of its plane, `theta_m_rad` (eq. 19)."""

    unit: FloatArray
    theta_m_rad: float

    @property
    def theta_m_arcsec(self) -> float:
        """Mean angle out of the plane (eq. 19), as the paper's Table 1 gives it."""
        return self.theta_m_rad / ARCSEC


@dataclass(frozen=True)
class PlaneFit:
    """The plane through the origin nearest to the vectors, and how well it is known.

    `half_cone_rad` (n,) are the vectors' angles out of the plane, positive on the side of the normal.
    `sigma_hc_rad` is their standard deviation (eq. 16, n - 1), `theta_m_rad` their mean (eq. 19).
    `paper_axis` is None where eq. 12 has no solution.
    """

    axis: Axis
    half_cone_rad: FloatArray
    sigma_hc_rad: float
    theta_m_rad: float
    paper_axis: PaperAxis | None

    @property
    def normal(self) -> FloatArray:
        """The unit normal, on the side of the nominal axis."""
        return self.axis.unit

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the unit normal [rad^2], with n - 2 degrees of freedom."""
        return self.axis.covariance

    @property
    def dof(self) -> float:
        """Degrees of freedom of the covariance: n - 2."""
        return self.axis.dof

    @property
    def vectors(self) -> int:
        """Number of vectors."""
        return self.half_cone_rad.size

    @property
    def std_hc_2sigma_arcsec(self) -> float:
        """Half-cone deviation at 2 sigma, as the paper's Table 1 gives it."""
        return 2.0 * self.sigma_hc_rad / ARCSEC

    @property
    def hc_unbiased(self) -> float:
        """By how much `sigma_hc_rad` were larger with squares over their n - 2 degrees of freedom."""
        return float(np.sqrt((self.vectors - 1.0) / self.dof))

    @property
    def theta_m_arcsec(self) -> float:
        """Mean angle out of the plane (eq. 19)."""
        return self.theta_m_rad / ARCSEC


def fit_plane(vectors: FloatArray, nominal_axis: FloatArray) -> PlaneFit:
    """Fit the plane through the origin to `vectors`, shape (n, 3), of any length and either sign.

    Only directions count: vectors are normalised first. `nominal_axis` (3,) settles the normal's sign. The
    covariance is the scatter s^2 = sum theta^2 / (n - 2) times the inverse of the in-plane second moments. Raises
    `ProcedureError` for fewer than three vectors, vectors that are not finite or zero, all (nearly) parallel, or a
    nominal axis lying in the plane.
    """
    units = _unit_rows(vectors)
    n = units.shape[0]
    _, singular, rows = svd(units)
    if singular[1] < _MIN_SPREAD * singular[0]:
        raise ProcedureError("all motion vectors are parallel: a plane needs both pendulum and flag mountings")
    # Vectors of one axis leave their plane by milliradians at most: these fill all space.
    if singular[2] > 0.5 * singular[1]:
        raise ProcedureError("the motion vectors span no plane: check axis, configuration and frame of each")
    normal = rows[2] * _sign_towards(nominal_axis, rows[2])
    half_cone = np.arcsin(np.clip(units @ normal, -1.0, 1.0))
    # A normal has two free angles.
    scatter = float(half_cone @ half_cone) / (n - 2)
    covariance = scatter * (rows[:2].T / singular[:2] ** 2) @ rows[:2]
    theta_m = float(half_cone.mean())
    return PlaneFit(
        Axis(normal, covariance, float(n - 2)),
        half_cone,
        float(np.sqrt(np.sum((half_cone - theta_m) ** 2) / (n - 1))),
        theta_m,
        _normal_equations(units, normal),
    )


def plane_normals(vectors: FloatArray, nominal_axis: FloatArray) -> FloatArray:
    """The normals alone that `fit_plane` gives of vectors (..., n, 3), shape (..., 3): of many planes at once."""
    units = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    normals = np.linalg.svd(units, full_matrices=False)[2][..., 2, :]
    return np.asarray(normals * np.sign(normals @ nominal_axis)[..., None])


def angle_between(a: Axis, b: Axis) -> AxisAngle:
    """Give the angle between two independent axes with its sigma from their covariances."""
    cosine = float(a.unit @ b.unit)
    sine = float(np.linalg.norm(np.cross(a.unit, b.unit)))
    if sine < 1e-9:
        # Parallel: the direction of the difference is not defined, so the worst one counts.
        sigma = float(np.sqrt(np.linalg.eigvalsh(a.covariance + b.covariance)[-1]))
    else:
        towards_b, towards_a = (b.unit - cosine * a.unit) / sine, (a.unit - cosine * b.unit) / sine
        variance = towards_b @ a.covariance @ towards_b + towards_a @ b.covariance @ towards_a
        sigma = float(np.sqrt(variance))
    # The arc cosine would lose half the digits for axes nearly parallel.
    return AxisAngle(float(np.arctan2(sine, cosine)), sigma)


def _unit_rows(vectors: FloatArray) -> FloatArray:
    vectors = np.asarray(vectors, dtype=np.float64)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ProcedureError(f"motion vectors have shape {vectors.shape}: rows of three components expected")
    if vectors.shape[0] < 3:
        raise ProcedureError(f"the plane and its scatter need at least three motion vectors, not {vectors.shape[0]}")
    lengths = np.linalg.norm(vectors, axis=1)
    bad = np.flatnonzero(~(np.isfinite(lengths) & (lengths > 0.0)))
    if bad.size:
        raise ProcedureError(f"motion vector {bad[0]} is zero or not finite: mark its mounting invalid")
    return np.asarray(vectors / lengths[:, None])


def _sign_towards(nominal_axis: FloatArray, normal: FloatArray) -> float:
    nominal = np.asarray(nominal_axis, dtype=np.float64)
    along = float(nominal @ normal)
    # Nearer than six degrees to the plane, the side of the normal would be a guess.
    if not abs(along) > 0.1 * float(np.linalg.norm(nominal)):
        raise ProcedureError(
            "the nominal axis lies in the plane of the motion vectors: check which axis these mountings belong to"
        )
    return 1.0 if along > 0.0 else -1.0


def _normal_equations(units: FloatArray, normal: FloatArray) -> PaperAxis | None:
    """Solve z = -a'x - b'y by the normal equations (eq. 12): the axis is (a', b', 1), on the normal's side."""
    horizontal, vertical = units[:, :2], units[:, 2]
    if np.linalg.cond(horizontal.T @ horizontal) > _MAX_CONDITION:
        return None
    a, b = np.linalg.solve(horizontal.T @ horizontal, -horizontal.T @ vertical)
    axis: FloatArray = np.array([a, b, 1.0]) / np.sqrt(a * a + b * b + 1.0)
    axis = axis if axis @ normal > 0.0 else -axis
    return PaperAxis(axis, float(np.arcsin(np.clip(units @ axis, -1.0, 1.0)).mean()))
