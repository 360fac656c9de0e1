"""Least squares for sums of exponentials and quotients of polynomials, whose minima lie in narrow valleys."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import optimize

from rigctl.analysis.least_squares import FitResult, Parameter, least_squares
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError

Function = Callable[[FloatArray], FloatArray]
_EVALUATIONS = 400


def descend(residuals: Function, jacobian: Function, parameters: Sequence[Parameter]) -> FitResult | None:
    """`least_squares` from the parameters' starts; MINPACK's scaled steps (Moré 1978) where that does not converge.

    `jacobian` is the model's, as there. None when the start is undefined or the fit is singular.
    """
    first = _fitted(residuals, jacobian, parameters)
    if first is None or first.verdict == "converged":
        return first
    free = [number for number, each in enumerate(parameters) if not each.fixed]
    start = np.array([each.start for each in parameters])

    def whole(values: FloatArray) -> FloatArray:
        full = start.copy()
        full[free] = values
        return full

    def free_residuals(values: FloatArray) -> FloatArray:
        return residuals(whole(values))

    def slopes(values: FloatArray) -> FloatArray:
        return np.asarray(-jacobian(whole(values))[:, free])

    try:
        with np.errstate(all="ignore"):
            minimum = optimize.least_squares(
                free_residuals, start[free], jac=slopes, method="lm", x_scale="jac", max_nfev=_EVALUATIONS
            )
    except (ValueError, np.linalg.LinAlgError):
        return first
    continued = [replace(each, start=float(value)) for each, value in zip(parameters, whole(minimum.x), strict=True)]
    second = _fitted(residuals, jacobian, continued)
    # Judged by our own verdict: MINPACK says converged where a direction is undetermined.
    return second if second is not None and second.chi2 <= first.chi2 else first


def _fitted(residuals: Function, jacobian: Function, parameters: Sequence[Parameter]) -> FitResult | None:
    try:
        fit = least_squares(residuals, parameters, jacobian=jacobian)
    except (ProcedureError, np.linalg.LinAlgError):
        return None
    return fit if fit.verdict in {"converged", "not-converged"} else None
