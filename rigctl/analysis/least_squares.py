"""Nonlinear least squares whose result says whether to trust it.

`residuals(p)` are whitened: (data - model) / sigma, so that chi-squared is their square sum and the
covariance is the inverse of J^T J as it stands. Gauss-Newton steps by orthogonal decomposition of the
column-scaled Jacobian, damped (Levenberg-Marquardt) only where the full step does not descend, by as much as the
linear model has failed (H. B. Nielsen, IMM-REP-1999-05): along a curved valley steps stay as long as it allows.
A fit that has not ended by then learns from its steps what the second derivatives add.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from rigctl.analysis.decomposition import Triangle, triangle_of
from rigctl.analysis.lengths import lengths
from rigctl.core.arrays import BoolArray, FloatArray, IntArray
from rigctl.core.errors import ProcedureError

Verdict = Literal["converged", "ill-conditioned", "at-limit", "not-converged"]
Function = Callable[[FloatArray], FloatArray]

# The step that is left would lower chi-squared by less: a ten-thousandth of a sigma, or rounding.
_CHI2_LEFT, _CHI2_ROUNDING = 1e-8, 1e-13
# Of chi-squared, aimed at where steps still descend: p-values have six digits then, whatever sigma was stated.
_CHI2_AIMED_AT = 1e-14
# A parameter with less than this share of a null direction is in it by rounding only.
_NULL_SHARE = 1e-5

# So many steps go by the first derivatives alone: most fits have ended by then.
_PLAIN = 30

# Of the damping, in units of the largest eigenvalue of the unit columns' Gram matrix: the first, and what is none.
_LEAST_DAMPING, _NO_DAMPING = 1e-6, 1e-7


@dataclass(frozen=True)
class Prior:
    """A Gaussian belief about a parameter; it counts as one more datum."""

    mean: float
    sigma: float


@dataclass(frozen=True)
class Parameter:
    """One parameter of a fit: where to start and what is known of it.

    `step`, in the parameter's own unit, is for models that differentiate by finite differences; the fit does not
    use it. A parameter with `fixed` keeps its start.
    """

    name: str
    start: float
    step: float | None = None
    lower: float = -np.inf
    upper: float = np.inf
    prior: Prior | None = None
    fixed: bool = False


@dataclass(frozen=True)
class FitResult:
    """Values, covariance and whether to trust them.

    `residuals` are the whitened data - model at the solution, `jacobian` (data, parameters) the whitened
    model's derivative; `chi2` and `dof` count the priors as data. `covariance` has zeros for fixed parameters. What
    the data cannot determine is NaN, never a number: the parameters in the null space of a singular
    problem (verdict `ill-conditioned`) and the covariance of those at a limit (`at-limit`).
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    dof: int
    chi2: float
    verdict: Verdict
    reason: str

    @property
    def chi2_per_dof(self) -> float:
        """Reduced chi-squared; NaN without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    def value(self, name: str) -> float:
        """Value of a parameter; NaN when undetermined."""
        return float(self.values[self._index(name)])

    def sigma(self, name: str) -> float:
        """Standard uncertainty of a parameter; 0 when fixed, NaN when undetermined."""
        index = self._index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def _index(self, name: str) -> int:
        try:
            return self.names.index(name)
        except ValueError:
            raise ProcedureError(f"no parameter {name!r} in this fit: it has {', '.join(self.names)}") from None


def least_squares(
    residuals: Function,
    parameters: Sequence[Parameter],
    *,
    jacobian: Function,
    max_iterations: int = 50,
    rcond: float = 1e-8,
) -> FitResult:
    """Minimise the square sum of `residuals(p)` plus priors over the free parameters.

    `residuals` takes all parameters, fixed ones included, and gives (data,) whitened data - model;
    `jacobian(p)` gives d (whitened model) / d p = -d residuals / d p, (data, parameters). `rcond` is the relative
    singular value of the column-scaled Jacobian below which a direction counts as undetermined. Raises
    `ProcedureError` for non-finite residuals at the start, two parameters of one name, or a start outside its
    limits; otherwise the verdict says how it went.
    """
    problem = _Problem(residuals, tuple(parameters), jacobian, rcond)
    p = problem.start()
    state = problem.linearise(p, problem.extended(p))
    damping, growth, iterations = 0.0, 2.0, 0
    curvature = _Curvature()
    while iterations < max_iterations and state.predicted_fall > _CHI2_AIMED_AT * state.chi2:
        iterations += 1
        if (step := curvature.step(state)) is not None and (r := problem.at(state, step)) is not None:
            before, state = state, problem.linearise(problem.clipped(state.p + step), r)
            curvature.learn(before, state)
            continue
        step = state.step(damping)
        if (r := problem.at(state, step)) is not None:
            damping, growth = damping * state.relief(damping, float(r @ r)), 2.0
            damping = damping if damping > _NO_DAMPING else 0.0
            before, state = state, problem.linearise(problem.clipped(state.p + step), r)
            if iterations > _PLAIN:
                curvature.learn(before, state)
        # A step this short that still ascends: the derivative is wrong, or chi-squared is at its rounding.
        elif damping > 1e8 or state.is_close:
            break
        else:
            damping, growth = max(growth * damping, _LEAST_DAMPING), 2.0 * growth
    return problem.result(state, state.is_close, iterations)


@dataclass(frozen=True)
class _State:
    """The linearised problem at `p` without the columns of held parameters.

    The Jacobian's active columns are Q R scale; `triangle` is of R, `projected` is Q^T r.
    """

    p: FloatArray
    r: FloatArray
    J: FloatArray
    active: IntArray
    scale: FloatArray
    triangle: Triangle
    projected: FloatArray

    @property
    def chi2(self) -> float:
        return float(self.r @ self.r)

    @cached_property
    def predicted_fall(self) -> float:
        return float(np.sum(self.triangle.within(self.projected) ** 2))

    @property
    def is_close(self) -> bool:
        """Judged by what a full step would still gain, not by its length, which depends on the parameters' units."""
        return self.predicted_fall <= _CHI2_LEFT + _CHI2_ROUNDING * self.chi2

    def step(self, damping: float) -> FloatArray:
        """Step over all parameters; nothing moves along the null space."""
        step = np.zeros(self.p.size)
        step[self.active] = self.triangle.solve(self.projected, damping) / self.scale
        return step

    def relief(self, damping: float, chi2: float) -> float:
        """By how much the damping changes after a step that ended at `chi2`: a tenth where the linear model held."""
        promised = self.triangle.fall(self.projected, damping) if damping > 0.0 else self.predicted_fall
        kept = (self.chi2 - chi2) / promised
        return max(0.1, 1.0 - (2.0 * kept - 1.0) ** 3)

    def covariance(self) -> FloatArray:
        """Pseudo-inverse of J^T J over the active parameters."""
        root = self.triangle.inverse / self.scale[:, None]
        return np.asarray(root @ root.T)


class _Curvature:
    """What second derivatives of the model add to J^T J, learnt from steps (Dennis, Gay and Welsch, ACM Trans. Math.
    Softw. 7 (1981) 348).

    Where a model is far from its data, steps by J^T J alone go to and fro across a valley and creep along it.
    """

    def __init__(self) -> None:
        self._active: IntArray | None = None
        self._added = np.zeros((0, 0))

    def learn(self, before: _State, after: _State) -> None:
        """From a step that descended."""
        if self._active is None or not np.array_equal(self._active, before.active):
            self._active, self._added = before.active, np.zeros((before.active.size,) * 2)
        if not np.array_equal(before.active, after.active):
            return
        moved = (after.p - before.p)[self._active]
        old, new = (each.J[:, self._active] for each in (before, after))
        turned = old.T @ before.r - new.T @ after.r
        bent = (old - new).T @ after.r
        along = float(turned @ moved)
        if along > 0.0:
            known = self._added @ moved
            size = abs(float(moved @ known))
            # What was learnt farther away is too much where the residuals have become small.
            share = min(1.0, abs(float(moved @ bent)) / size) if size > 0.0 else 1.0
            off = bent - share * known
            self._added = share * self._added + (np.outer(off, turned) + np.outer(turned, off)) / along
            self._added -= float(moved @ off) * np.outer(turned, turned) / along**2

    def step(self, state: _State) -> FloatArray | None:
        """Where the quadratic model has its minimum, over all parameters; None where nothing is learnt, or it has
        none."""
        inverse = state.triangle.certain_inverse
        if self._active is None or inverse is None or not np.array_equal(self._active, state.active):
            return None
        root = inverse / state.scale[:, None]
        with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
            # In units in which J^T J is the unit matrix.
            lower = np.linalg.cholesky(np.eye(len(root)) + root.T @ self._added @ root)
            step = np.zeros(state.p.size)
            step[self._active] = root @ np.linalg.solve(lower.T, np.linalg.solve(lower, state.projected))
            return step
        return None


def _lengths(columns: FloatArray) -> FloatArray:
    """Lengths of columns, of those too whose squares overflow: an exponential far from its data."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = lengths(columns)
    if not np.isfinite(found).all():
        largest = np.maximum(np.abs(columns).max(axis=0), np.finfo(np.float64).tiny)
        found = largest * lengths(columns / largest)
    return found


class _Problem:
    def __init__(
        self, residuals: Function, parameters: tuple[Parameter, ...], jacobian: Function, rcond: float
    ) -> None:
        self.parameters = parameters
        self.names = tuple(each.name for each in parameters)
        self._residuals, self._jacobian, self._rcond = residuals, jacobian, rcond
        self.lower = np.array([each.lower for each in parameters])
        self.upper = np.array([each.upper for each in parameters])
        self.free = np.array([not each.fixed for each in parameters], dtype=bool)
        self.with_prior = [i for i, each in enumerate(parameters) if each.prior is not None and not each.fixed]
        priors = [each.prior for each in parameters if each.prior is not None and not each.fixed]
        self.prior_mean = np.array([each.mean for each in priors])
        self.prior_sigma = np.array([each.sigma for each in priors])

    def start(self) -> FloatArray:
        p = np.array([each.start for each in self.parameters], dtype=np.float64)
        if len(set(self.names)) < len(self.names):
            raise ProcedureError("two parameters of a fit share a name: rename one")
        for each in self.parameters:
            if not each.lower <= each.start <= each.upper:
                raise ProcedureError(
                    f"start {each.start:g} of {each.name} is outside [{each.lower:g}, {each.upper:g}]"
                )
            if each.prior is not None and not each.prior.sigma > 0.0:
                raise ProcedureError(f"prior of {each.name} has sigma {each.prior.sigma:g}: fix it instead")
        if not np.isfinite(self.extended(p)).all():
            raise ProcedureError("residuals are not finite at the start of the fit: check data and start values")
        return p

    def clipped(self, p: FloatArray) -> FloatArray:
        return np.asarray(np.clip(p, self.lower, self.upper))

    def extended(self, p: FloatArray) -> FloatArray:
        """Residuals with those of the priors (mean - p) / sigma appended."""
        data = np.asarray(self._residuals(p), dtype=np.float64).ravel()
        return np.concatenate([data, (self.prior_mean - p[self.with_prior]) / self.prior_sigma])

    def at(self, state: _State, step: FloatArray) -> FloatArray | None:
        """Residuals after a step that descends; None where it does not."""
        # A step too far may leave the model's domain or overflow: it is then refused like any other ascent.
        with np.errstate(all="ignore"):
            r = self.extended(self.clipped(state.p + step))
            return r if r @ r < state.chi2 else None

    def linearise(self, p: FloatArray, r: FloatArray) -> _State:
        J = self._derivative(p, r)
        # Held only while chi-squared falls beyond the limit: decided anew at every point, a parameter may come back.
        with np.errstate(over="ignore"):
            at_limit = self._pushed_to_limit(p, -(J.T @ r))
        active = np.flatnonzero(self.free & ~at_limit)
        columns = J if active.size == p.size else J.take(active, axis=1)
        norms = self._lengths(J)[active]
        # Columns of unit length: the rank then depends on how alike columns are and not on the parameters' units.
        scale = np.where(norms > 0.0, norms, 1.0)
        triangle, projected = triangle_of(columns, scale, r, self._rcond)
        return _State(p, r, J, active, scale, triangle, projected)

    def result(self, state: _State, converged: bool, iterations: int) -> FitResult:
        n = len(self.parameters)
        data = state.r.size - len(self.with_prior)
        values, covariance = state.p.copy(), np.zeros((n, n))
        covariance[np.ix_(state.active, state.active)] = state.covariance()
        # A parameter at its limit was fitted there: it has no column, but costs a degree of freedom (below).
        limited = np.setdiff1d(np.flatnonzero(self.free), state.active)
        null = state.triangle.null
        lost = state.active[np.abs(null).max(axis=0, initial=0.0) > _NULL_SHARE]
        values[lost] = np.nan
        for i in (*lost, *limited):
            covariance[i, :] = covariance[:, i] = np.nan
        verdict, reason = self._verdict(converged, iterations, limited, state, null)
        return FitResult(
            self.names,
            values,
            covariance,
            state.r[:data],
            state.J[:data],
            state.r.size - state.triangle.rank - limited.size,
            state.chi2,
            verdict,
            reason,
        )

    def _derivative(self, p: FloatArray, r: FloatArray) -> FloatArray:
        data = r.size - len(self.with_prior)
        J: FloatArray = np.asarray(self._jacobian(p), dtype=np.float64)
        if self.with_prior:
            below = np.zeros((r.size - data, p.size), order="F")
            below[np.arange(r.size - data), self.with_prior] = 1.0 / self.prior_sigma
            J = np.concatenate([J, below])
        return J

    def _lengths(self, J: FloatArray) -> FloatArray:
        found = _lengths(J)
        if not np.isfinite(found).all():
            bad = self.names[int(np.flatnonzero(~np.isfinite(found))[0])]
            raise ProcedureError(f"the derivative with respect to {bad} is not finite: check its start")
        return found

    def _pushed_to_limit(self, p: FloatArray, gradient: FloatArray) -> BoolArray:
        low = (p <= self.lower) & (gradient > 0.0)
        high = (p >= self.upper) & (gradient < 0.0)
        return np.asarray((low | high) & self.free)

    def _verdict(
        self, converged: bool, iterations: int, limited: IntArray, state: _State, null: FloatArray
    ) -> tuple[Verdict, str]:
        if len(null):
            directions = "; ".join(self._direction(row, state) for row in _reduced(null))
            return (
                "ill-conditioned",
                f"the data leave undetermined: {directions}; fix one or measure otherwise",
            )
        if not converged:
            return "not-converged", (
                f"chi-squared {state.chi2:.6g} after {iterations} steps could still fall by "
                f"{state.predicted_fall:.2g}: check start values and model"
            )
        if limited.size:
            at = ", ".join(f"{self.names[i]} = {state.p[i]:g}" for i in limited)
            return "at-limit", f"pushed against a limit: {at}"
        return "converged", f"converged in {iterations} steps"

    def _direction(self, row: FloatArray, state: _State) -> str:
        """Name a direction of the null space by its parameters, the largest share first."""
        order = [i for i in np.argsort(-np.abs(row)) if abs(row[i]) > _NULL_SHARE * np.abs(row).max()]
        steps = row / state.scale
        terms = [_term(steps[i] / steps[order[0]], self.names[state.active[i]]) for i in order]
        return " ".join(terms).removeprefix("+ ")


def _term(coefficient: float, name: str) -> str:
    size = f"{abs(coefficient):.3g} "
    return f"{'-' if coefficient < 0.0 else '+'} {'' if size == '1 ' else size}{name}"


def _reduced(null: FloatArray) -> FloatArray:
    """Mix the rows of a null space so that each names as few parameters as it can (Gauss-Jordan)."""
    rows = null.copy()
    for k in range(len(rows)):
        pivot = int(np.argmax(np.abs(rows[k])))
        rows[k] /= rows[k, pivot]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, pivot] * rows[k]
    return rows
