"""Whether a model leaves so much of the data that the uncertainties of its parameters do not hold."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.run_misfit import said_of_misfit
from rigctl.workbench.verdict.account import LEVEL
from rigctl.workbench.verdict.adequacy import p_as_a_whole
from rigctl.workbench.verdict.attempt import Attempt


def of_misfit(attempt: Attempt, version: int) -> list[str]:
    """That the model does not describe the data, in one line, where chi-square tells it to `rigctl compare` too."""
    # A few lines far off, of hundreds, hardly raise chi2/dof, and move a parameter by a hundred sigma.
    if not p_as_a_whole(attempt, None) < LEVEL:
        return []
    ratio = attempt.result.chi2 / attempt.result.dof
    given, left = attempt.model.observations, attempt.whitened()
    worst = int(np.argmax(np.abs(left)))
    series = given.series[given.series_of[worst]]
    where = f"run {given.run_ids[given.run_of[worst]]}, {series.channel}, {series.component}"
    return [said_of_misfit(version, ratio, where, float(left[worst]))]
