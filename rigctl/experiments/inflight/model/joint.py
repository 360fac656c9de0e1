"""All parameters from all lines of all sessions at once, weighted by their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.least_squares import FitResult, least_squares
from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.baseline import Baseline, Stretch
from rigctl.experiments.inflight.model.parameters import NAMES


@dataclass(frozen=True)
class JointEstimate:
    """The fit of the baseline; the first ten of its parameters are the calibration's."""

    fit: FitResult

    @property
    def values(self) -> FloatArray:
        """Of `parameters.NAMES`."""
        return self.fit.values[: len(NAMES)]

    @property
    def covariance(self) -> FloatArray:
        """Of the same, (10, 10)."""
        return self.fit.covariance[: len(NAMES), : len(NAMES)]

    @property
    def sigmas(self) -> FloatArray:
        """Standard uncertainties of the same."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def joint_estimate(stretches: Sequence[Stretch]) -> JointEstimate:
    """Fit the baseline to reduced stretches; `ProcedureError` when residuals are not finite."""
    baseline = Baseline(stretches)
    sigma = baseline.sigma()
    fit = least_squares(
        lambda p: baseline.residual(p) / sigma,
        baseline.parameters,
        jacobian=lambda p: baseline.jacobian(p) / sigma[:, None],
        rcond=1e-12,
    )
    return JointEstimate(fit)
