"""Whether a model leaves so much of the data that the uncertainties of its parameters do not hold."""

from __future__ import annotations

import numpy as np

from rigctl.workbench.verdict.attempt import Attempt

MISFIT = 2.0
"""Residuals of so many times the noise, rms, are no bad luck: every sigma is too small by as much, or more."""


def of_misfit(attempt: Attempt, version: int) -> list[str]:
    """That the model does not describe the data, in one line, where it leaves far more than the noise."""
    ratio = attempt.result.chi2 / max(attempt.result.dof, 1)
    if ratio <= MISFIT**2:
        return []
    given, left = attempt.model.observations, attempt.whitened()
    worst = int(np.argmax(np.abs(left)))
    series = given.series[given.series_of[worst]]
    return [
        f"the model, version {version}, does not describe these data, and no sigma holds: chi2/dof is {ratio:.3g}, "
        f"and run {given.run_ids[given.run_of[worst]]}, {series.channel}, {series.component} is {left[worst]:+.1f} "
        "sigma off; look with `rigctl compare`, then mend runs.csv or extend the model"
    ]
