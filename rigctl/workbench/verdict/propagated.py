"""What the uncertainty of a model's inputs does to its fitted parameters, by the law of propagation (GUM 5.2.2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigctl.analysis.least_squares import FitResult
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import UNFIT, ProcedureError
from rigctl.workbench.known_inputs import HasKnownInputs, KnownInputs
from rigctl.workbench.study import Model
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.whitened_fit import whitened_least_squares

_STEP_IN_U = 0.1
"""Small beside the range over which the first order is trusted, large beside where a fit ends."""


def propagated(model: HasKnownInputs, noise: Noise, result: FitResult, inputs: KnownInputs) -> FloatArray:
    """Covariance (m, m) of the parameters of a fit that comes from its inputs.

    Sensitivities are those of the estimates: the model is fitted anew with a little more and less of each input.
    `ProcedureError` where that is no fit.
    """
    slopes = np.column_stack(
        [
            _slope(model, noise, result, name, value, _STEP_IN_U * variance**0.5)
            for name, value, variance in zip(inputs.names, inputs.values, np.diag(inputs.covariance), strict=True)
        ]
    )
    return np.asarray(slopes @ inputs.covariance @ slopes.T)


def _slope(
    model: HasKnownInputs, noise: Noise, result: FitResult, name: str, value: float, step: float
) -> FloatArray:
    """d estimates / d input, (m,), by central differences."""
    above, below = (_refitted(model.with_inputs({name: at}), noise, result) for at in (value + step, value - step))
    if not (np.isfinite(above).all() and np.isfinite(below).all()):
        raise ProcedureError(
            f"the model cannot be fitted with {name} {step:.3g} beside its value {value:g};"
            " mend its standard uncertainty, or the baseline"
        )
    return np.asarray((above - below) / (2.0 * step))


def _refitted(model: Model, noise: Noise, result: FitResult) -> FloatArray:
    """Where a fit from the end of another one ends, NaN for nowhere; what had no variance there stays."""
    free = np.diag(result.covariance) > 0.0
    parameters = [
        replace(each, start=float(value), fixed=not varies)
        for each, value, varies in zip(model.parameters, result.values, free, strict=True)
    ]
    try:
        return whitened_least_squares(model, noise, parameters).values
    except UNFIT:
        return np.full(len(parameters), np.nan)
