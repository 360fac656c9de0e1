"""Whether the model behind the axes describes the runs: where it does not, all nulls may be displaced alike."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.run_misfit import said_of_misfit
from rigctl.experiments.sensing_axis.model.fit import ACCEL_COLUMNS, RecordingFit, measured_at
from rigctl.workbench.verdict.score import p_of
from rigctl.workbench.workbench import ALPHA


def misfit(fit: RecordingFit, version: int) -> list[str]:
    """That the model does not describe the runs, in one line, by all whose noise their own spectra tell.

    A mean's sigma is no more than a weight: means are left out, with the levels that they tell.
    """
    places = measured_at(fit.model)
    told = np.array([column != ACCEL_COLUMNS.index("mean") for _, column in places])
    levels = sum(parameter.name.startswith("dc[") for parameter in fit.model.parameters)
    left, dof = fit.result.residuals[told], fit.result.dof - int(np.sum(~told)) + levels
    runs = [fit.model.runs[run] for (run, _), counts in zip(places, told, strict=True) if counts]
    columns = [column for (_, column), counts in zip(places, told, strict=True) if counts]
    channels = [*(["accel_v"] * len(ACCEL_COLUMNS)), *fit.model.heads]
    known = [
        (run.accel_v if channels[column] == "accel_v" else run.lasers_m[channels[column]]).dof[1]
        for run, column in zip(runs, columns, strict=True)
    ]
    # Satterthwaite: the noise of each datum is known from so many degrees of freedom.
    noise_dof = len(left) ** 2 / np.sum(1.0 / np.maximum(known, 1.0))
    chi2 = float(left @ left)
    if dof < 1 or not p_of(chi2, dof, noise_dof) < ALPHA:
        return []
    worst = int(np.argmax(np.abs(left)))
    part = ACCEL_COLUMNS[columns[worst]] if columns[worst] < len(ACCEL_COLUMNS) else "nu in-phase"
    return [
        said_of_misfit(
            version, chi2 / dof, f"run {runs[worst].run_id}, {channels[columns[worst]]}, {part}", float(left[worst])
        )
    ]
