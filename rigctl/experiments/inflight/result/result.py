"""The result of one calibration: ten parameters, by the published estimate and by the joint one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.paper import PaperEstimate, paper_estimate
from rigctl.experiments.inflight.model.parameters import NAMES, UNITS
from rigctl.experiments.inflight.result.unseen import unseen_covariance
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.workbench.findings import Estimate


def calibration(study: InflightStudy, joint: Mapping[str, Estimate], beyond: Mapping[str, float]) -> dict[str, Any]:
    """Keys of `rigctl result --json`; `joint` are parameters by name, as the study's model was fitted, `beyond` what
    no session sees."""
    paper = paper_estimate(study.data.observed.fitted_runs())
    remarks = [f"run {run.run_id}: {remark}" for run in study.data.reduced.runs for remark in run.remarks]
    return {
        "parameters": {
            name: {
                "value": joint[name].value,
                "sigma": joint[name].sigma,
                "unit": unit,
                "systematic": beyond.get(name, 0.0),
                "paper": _of(paper, name),
                "joint": {"value": joint[name].value, "sigma": joint[name].sigma},
            }
            for name, unit in zip(NAMES, UNITS, strict=True)
        },
        "sweeps": paper.sweeps,
        "remarks": [*remarks, *study.left_out.values(), *_of_repeated(study), *_of_published(paper)],
    }


def systematic(values: FloatArray, covariance: FloatArray, constants: Mapping[str, float]) -> dict[str, float]:
    """What no session sees, as standard uncertainties of the parameters that it moves; of a fit of the baseline."""
    ten = slice(len(NAMES))
    sigma = np.sqrt(np.diag(unseen_covariance(values[ten], covariance[ten, ten], constants)))
    # Others follow by rounding only.
    moved = dict(zip(NAMES, sigma.tolist(), strict=True))
    return {name: moved[name] for name in ("ac11_dx_m", "ac11_dy_m", "ac11_dz_m", "ac12_rad", "ac13_rad")}


def _of(paper: PaperEstimate, name: str) -> dict[str, float] | None:
    place = NAMES.index(name)
    value, sigma = float(paper.values[place]), float(paper.sigmas[place])
    return {"value": value, "sigma": sigma} if np.isfinite(value) else None


def _of_repeated(study: InflightStudy) -> list[str]:
    """Which runs the published estimate does not use, in one line."""
    runs = study.data.reduced.runs
    last = {run.session.name: run.run_id for run in runs}
    others = [run.run_id for run in runs if last[run.session.name] != run.run_id]
    if not others:
        return []
    return [
        f"the published estimate takes one run of each session, the last: without {', '.join(others)}, which the "
        "joint one uses"
    ]


def _of_published(paper: PaperEstimate) -> list[str]:
    """What the published estimate cannot give, and why; a line each."""
    remarks = []
    if paper.lacking:
        remarks.append(
            f"no run for {', '.join(paper.lacking)}: without it the published estimate takes zero for it in the "
            "other sessions, and the joint one uses what their lines say of it"
        )
    if not paper.settled:
        remarks.append(
            f"the published estimate has not settled in {paper.sweeps} sweeps, do not use it: a session was not "
            "flown as runs.csv says, or the sessions contradict each other; use the joint one once `rigctl compare` "
            "agrees"
        )
    return remarks
