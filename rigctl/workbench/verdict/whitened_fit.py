"""A model fitted with a noise that is given."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.analysis.least_squares import FitResult, Parameter, least_squares
from rigctl.workbench.study import Model
from rigctl.workbench.verdict.noise import Noise

MAX_ITERATIONS = 80


def whitened_least_squares(
    model: Model, noise: Noise, parameters: Sequence[Parameter], max_iterations: int = MAX_ITERATIONS
) -> FitResult:
    """The parameters that explain the data best in units of their noise."""
    value = model.observations.value
    return least_squares(
        lambda p: noise.whiten(value - model.predict(p)),
        parameters,
        jacobian=lambda p: noise.whiten(model.jacobian(p)),
        max_iterations=max_iterations,
    )
