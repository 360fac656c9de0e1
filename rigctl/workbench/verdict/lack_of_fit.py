"""Readings taken again at the same settings tell a noise that no model can have spoiled: the pure error.

What a model leaves beyond it is its lack of fit (Draper and Smith, Applied Regression Analysis, 3rd ed., 2.1).
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from rigctl.core.arrays import IntArray
from rigctl.workbench.findings import LackOfFit, Unexplained
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.attempt import Attempt


def lack_of_fit(attempt: Attempt) -> LackOfFit | None:
    """The F test of what a fitted model leaves against the scatter among repeats; None where there are too few of
    either, or where readings are not independent, for then repeats share more than their settings."""
    given, noise = attempt.model.observations, attempt.noise
    if not len(attempt.estimator.rows) or noise.factors or len(given.series) != 1:
        return None
    setting_of = _settings(given)[given.run_of]
    count = np.bincount(setting_of)
    pure_dof = len(given.value) - len(count)
    lack_dof = attempt.result.dof - pure_dof
    if pure_dof < 1 or lack_dof < 1:
        return None
    weight = given.sigma**-2
    mean = np.bincount(setting_of, weight * given.value) / np.bincount(setting_of, weight)
    # A setting's readings scatter about their own mean, whatever the model says of that setting.
    pure = float(np.sum(weight * (given.value - mean[setting_of]) ** 2))
    left = float(np.sum(weight * attempt.unexplained() ** 2))
    if pure <= 0.0:
        return None
    f = max(left - pure, 0.0) / lack_dof / (pure / pure_dof)
    scale = float(np.sqrt(np.mean(given.sigma**2)))
    return LackOfFit(
        f=f,
        dof=lack_dof,
        pure_dof=pure_dof,
        p_value=float(fdtrc(lack_dof, pure_dof, f)),
        pure_error=scale * float(np.sqrt(pure / pure_dof)),
        channel=given.series[0].channel,
        unit=given.series[0].unit,
    )


def unexplained_between_settings(lack: LackOfFit) -> Unexplained:
    """What is said of a lack of fit that neither an effect nor a plain shape describes."""
    return Unexplained(
        lack.channel,
        "",
        f"{lack.channel} is off by more from setting to setting than readings at one setting scatter "
        f"({lack.pure_error:.3g} {lack.unit}".rstrip()
        + f"), F({lack.dof}, {lack.pure_dof}) = {lack.f:.3g}, as no single column tells",
        lack.p_value,
    )


def _settings(given: Observations) -> IntArray:
    """The setting of each run by number: runs share one where they agree in every condition that is recorded."""
    if not given.covariates:
        # Nothing says that anything was set: these are no repeats of a setting.
        return np.arange(len(given.run_ids), dtype=np.intp)
    conditions = np.nan_to_num(np.stack(list(given.covariates.values()), axis=1), nan=np.inf)
    return np.asarray(np.unique(conditions, axis=0, return_inverse=True)[1], dtype=np.intp).ravel()
