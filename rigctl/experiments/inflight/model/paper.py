"""The published estimate: one parameter per session at its own line, swept until nothing changes.

Each session yields its parameter from twice the differential acceleration along X, less what the other parameters do
there by their newest values (Hardy et al., eq. 16 to 30, with the terms they leave out).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.inflight.model.equation import slope_in_loop_of_one_mass
from rigctl.experiments.inflight.model.parameters import NAMES
from rigctl.experiments.inflight.observe.series import Amplitudes, with_true_attitude
from rigctl.experiments.inflight.observe.sessions import MASS_MOTION, Session

SWEEPS = 8
SETTLED = 1e-3
"""A sweep that moves nothing by more than so many sigmas is the last that matters."""

_BESIDE = {"theta_cx": "ac12", "ad22": "ad12", "ad33": "ad13"}
"""What else the corrections need, and the session that tells it."""

_ROWS = ("dx", "dz", "dy", "ac12", "ac13", "ad11", "ad12", "ad13", "k2d", "k2c_1", "k2c_2", *_BESIDE)
_AT = {name: place for place, name in enumerate(_ROWS)}
# Bounds of the parameters: steps of differences and units of the linear algebra.
_SIZES = np.array([2e-5, 2e-5, 2e-5, 3e-3, 3e-3, 1e-2, 2e-3, 2e-3, 1e4, 1e4, 1e4, 3e-3, 1e-2, 1e-2])
_OWN = {"ad22": "y", "ad33": "z"}
_QUADRATIC = {"k2c_1": ("m1", "m2", 1.0), "k2c_2": ("m2", "m1", -1.0)}


@dataclass(frozen=True)
class FittedRun:
    """A session with its amplitudes at `Session.fitted_lines`, and the standard uncertainties of cosine and sine of
    the differential channel there, shape (lines, 2)."""

    session: Session
    amplitudes: Amplitudes
    sigma: FloatArray


@dataclass(frozen=True)
class PaperEstimate:
    """`values` and standard uncertainties of the parameters `NAMES`, NaN for those that are `lacking` a session.

    Where the sweeps have not `settled` the others are no estimates either, NaN where they grew beyond all numbers.
    """

    values: FloatArray
    sigmas: FloatArray
    sweeps: int
    lacking: tuple[str, ...]
    settled: bool


def paper_estimate(runs: Mapping[str, FittedRun]) -> PaperEstimate:
    """All parameters from the sessions' runs, by session name; a missing session's is NaN and counts as zero.

    `sweeps` is the first sweep that changes no parameter by more than a thousandth of its sigma, at most `SWEEPS`.
    """
    rows = _rows_of(runs)
    a = np.zeros(len(_ROWS))
    moves = []
    # What a session is said to be and is not lets the sweeps grow without bound: they have not settled then.
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(SWEEPS):
            before = a.copy()
            for place, run in rows.items():
                # The newest values at once (Gauss and Seidel), in the order of the paper's table.
                a[place] = _solved(place, a, run)
            moves.append(a - before)
        covariance = _covariance(a, rows)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    there = list(rows)
    settled = [bool(np.all(np.abs(move[there]) <= SETTLED * sigma[there])) for move in moves]
    return _named(a, covariance, set(rows), settled.index(True) + 1 if any(settled) else None)


def _rows_of(runs: Mapping[str, FittedRun]) -> dict[int, FittedRun]:
    both = {name: runs["dx+dz"] for name in ("dx", "dz") if "dx+dz" in runs}
    beside = {name: runs[session] for name, session in _BESIDE.items() if session in runs}
    run_of = {**both, **beside, **runs}
    return {_AT[name]: run_of[name] for name in _ROWS if name in run_of}


def _solved(place: int, a: FloatArray, run: FittedRun) -> float:
    y, regressor = _equation(place, a, run)
    # Only what is in phase with the regressor: the quadrature belongs to nothing that is sought.
    return float(np.real(np.vdot(regressor, y)) / np.real(np.vdot(regressor, regressor)))


def _equation(place: int, a: FloatArray, run: FittedRun) -> tuple[ComplexArray, ComplexArray]:
    """Corrected complex amplitudes y and the regressor's, at the parameter's own lines."""
    name, session = _ROWS[place], run.session
    own = slice(0, 2 if session.name in MASS_MOTION else 1)
    table = with_true_attitude(session, session.fitted_lines(), run.amplitudes)
    if name in _OWN:
        return table.of(f"own {_OWN[name]}")[own], 2.0 * table.of(_OWN[name])[own]
    linear, rest = _terms(table)
    if name in _QUADRATIC:
        moving, fixed, sign = _QUADRATIC[name]
        gradient = sum(a[k] * linear[k] for k in range(3)) + _cross(a, table)
        linked = a[5] * table.of(fixed) + a[6] * table.of("y") + a[7] * table.of("z")
        # Less the sensor held fixed, the drag-free residual cancels; left in, it costs 1e4 s2/m. The gradient on the
        # moved mass would bias k_1 and k_2 by 90 s2/m, always with the same sign.
        y = table.of(moving) - table.of(fixed) - sign * (gradient + 2.0 * linked) + table.of("moved g_xx")
        # Of the newest value: the correction is a small one, and sweeps settle it.
        share = slope_in_loop_of_one_mass(a[place], session, table) ** -2
        return y[own], share * table.of(f"{moving}^2")[own]
    y = table.of("m1") - table.of("m2") - _cross(a, table) - _cubic(a, table)
    for other, series in enumerate((*linear, *rest)):
        if other != place:
            y = y - a[other] * series
    if session.name in MASS_MOTION:
        y, regressor = _of_moved(name, y, a, table)
        return y[own], regressor[own]
    return y[own], (*linear, *rest)[place][own]


def _terms(table: Amplitudes) -> tuple[tuple[ComplexArray, ...], tuple[ComplexArray, ...]]:
    """What multiplies dx, dz, dy; and ac12, ac13 (beside displacements: nothing), ad11, ad12, ad13, k_d."""
    nothing = np.zeros(len(table.table), dtype=np.complex128)
    m_c = table.of("m1") + table.of("m2")
    square = 0.25 * (table.of("m1^2") + table.of("m2^2") + 2.0 * table.of("m1 m2"))
    linear = (table.of("t_xx"), table.of("t_xz") - table.of("dw_y"), table.of("t_xy") + table.of("dw_z"))
    return linear, (nothing, nothing, m_c, 2.0 * table.of("y"), 2.0 * table.of("z"), 2.0 * square)


def _cross(a: FloatArray, table: Amplitudes) -> ComplexArray:
    """The gradient along Y and Z, which rotation and coupling let into X."""
    dx, dz, dy = a[:3]
    along_y = (table.of("t_xy") - table.of("dw_z")) * dx + table.of("t_yy") * dy
    along_z = table.of("t_xz") * dx + table.of("t_zz") * dz
    return np.asarray(a[3] * along_y + a[4] * along_z)


def _cubic(a: FloatArray, table: Amplitudes) -> ComplexArray:
    """-(k_1^2 - k_2^2) m_cx^3, which two parabolas with one slope at rest leave in 2 m_dx."""
    return np.asarray(0.5 * (a[_AT["k2c_2"]] ** 2 - a[_AT["k2c_1"]] ** 2) * (table.of("m1^3") + table.of("m2^3")))


def _of_moved(name: str, y: ComplexArray, a: FloatArray, table: Amplitudes) -> tuple[ComplexArray, ComplexArray]:
    """Less the gradient on masses that move along their own axes, with a_c11 = 1; see `equation._put_moved`."""
    xx, xy, xz, yy, zz = (table.of(f"moved g_{axes}") for axes in ("xx", "xy", "xz", "yy", "zz"))
    ac12, ac13, ad12, ad13, theta_cx = (a[_AT[each]] for each in ("ac12", "ac13", "ad12", "ad13", "theta_cx"))
    if name == "ac13":
        return y - xz + theta_cx * xy + ad13 * a[_AT["ad33"]] * xx, zz - xx
    y = y - xy - ac13 * theta_cx * zz + ad12 * a[_AT["ad22"]] * xx
    if name == "theta_cx":
        return y - ac12 * (yy - xx), xz
    return y - theta_cx * xz, yy - xx


def _covariance(a: FloatArray, rows: Mapping[int, FittedRun]) -> FloatArray:
    """Of the solution of all equations together: what one parameter leaves in another's session is counted."""
    there = list(rows)
    slopes = np.zeros((len(there), len(there)))
    variance = np.zeros(len(there))
    for i, place in enumerate(there):
        run = rows[place]
        _, regressor = _equation(place, a, run)
        parts = np.stack([regressor.real, regressor.imag], axis=1)
        variance[i] = np.sum((parts * run.sigma[: len(parts)]) ** 2) / np.sum(parts**2) ** 2
        for j, other in enumerate(there):
            step = np.zeros(len(a))
            step[other] = _SIZES[other]
            change = _solved(place, a + step, run) - _solved(place, a - step, run)
            # Of the equations a - solved(a) = 0, whose inverse carries the noise of each session into all parameters.
            slopes[i, j] = (i == j) - 0.5 * change / _SIZES[other]
    # Metres and s2/m in one matrix: inverted in units of the bounds.
    inverse = np.linalg.inv(slopes * _SIZES[there] / _SIZES[there][:, None])
    inverse *= _SIZES[there][:, None] / _SIZES[there]
    covariance = np.zeros((len(a), len(a)))
    covariance[np.ix_(there, there)] = inverse @ np.diag(variance) @ inverse.T
    return covariance


def _named(a: FloatArray, covariance: FloatArray, there: set[int], sweeps: int | None) -> PaperEstimate:
    turn = np.zeros((len(NAMES), len(_ROWS)))
    for number, name in enumerate(("dx", "dy", "dz", "ac12", "ac13", "ad11", "ad12", "ad13", "k2d")):
        turn[number, _AT[name]] = 1.0
    turn[-1, [_AT["k2c_1"], _AT["k2c_2"]]] = 0.5
    missing = np.array([any(place not in there for place in np.flatnonzero(row)) for row in turn])
    with np.errstate(over="ignore", invalid="ignore"):
        sigmas = np.sqrt(np.diag(turn @ covariance @ turn.T))
    return PaperEstimate(
        np.where(missing, np.nan, turn @ a),
        np.where(missing, np.nan, sigmas),
        SWEEPS if sweeps is None else sweeps,
        tuple(name for name, lacks in zip(NAMES, missing, strict=True) if lacks),
        sweeps is not None,
    )
