"""Whether the model behind the axes describes the runs: where it does not, all nulls may be displaced alike."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.run_misfit import said_of_misfit
from rigctl.experiments.sensing_axis.model.fit import ACCEL_COLUMNS, RecordingFit, measured_at
from rigctl.experiments.sensing_axis.observe.reduction import ACCEL
from rigctl.workbench.verdict.score import p_of
from rigctl.workbench.workbench import ALPHA


def misfit(fit: RecordingFit, version: int) -> list[str]:
    """That the model does not describe the runs, in one line, by all whose noise their own spectra tell.

    A mean's sigma is no more than a weight: means are left out, with the levels that they tell.
    """
    run, column = measured_at(fit.model)
    told = column != ACCEL_COLUMNS.index("mean")
    levels = sum(parameter.name.startswith("dc[") for parameter in fit.model.parameters)
    left, dof = fit.result.residuals[told], fit.result.dof - int(np.sum(~told)) + levels
    series = [*((ACCEL, part) for part in ACCEL_COLUMNS), *((head, ACCEL_COLUMNS[0]) for head in fit.model.heads)]
    data = [(fit.model.runs[r], *series[c]) for r, c in zip(run[told], column[told], strict=True)]
    known = [(each.accel_v if name == ACCEL else each.lasers_m[name]).dof[1] for each, name, _ in data]
    # Satterthwaite: the noise of each datum is known from so many degrees of freedom.
    noise_dof = len(left) ** 2 / np.sum(1.0 / np.maximum(known, 1.0))
    chi2 = float(left @ left)
    if dof < 1 or not p_of(chi2, dof, noise_dof) < ALPHA:
        return []
    worst = int(np.argmax(np.abs(left)))
    of, name, part = data[worst]
    where = f"run {of.run_id}, {name}, {part}"
    return [said_of_misfit(version, chi2 / dof, where, float(left[worst]), "at nu alone ")]
