"""The result of one calibration: ten parameters, by the published estimate and by the joint one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rigctl.experiments.inflight.model.paper import PaperEstimate, paper_estimate
from rigctl.experiments.inflight.model.parameters import NAMES, UNITS
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.workbench.findings import Estimate

TRACKER_BIAS_RAD = 1e-4
COUPLING_RAD = 1e-4 / math.sqrt(3.0)
"""Standard uncertainties of the star tracker's alignment and of the sensors' coupling angles, unless recorded."""


def calibration(study: InflightStudy, joint: Mapping[str, Estimate]) -> dict[str, Any]:
    """Keys of `rigctl result --json`; `joint` are parameters by name, as the study's model was fitted."""
    paper = paper_estimate(study.data.observed.fitted_runs())
    beyond = systematic(joint, study.source.header.constants)
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
        "remarks": [*remarks, *study.left_out.values(), *_missing(paper)],
    }


def systematic(joint: Mapping[str, Estimate], constants: Mapping[str, float]) -> dict[str, float]:
    """What no session sees, as standard uncertainties: the star tracker's alignment s and the coupling eta.

    a_c12 is off by -s_z - eta_z, a_c13 by s_y - eta_y / 2, Dx and Dz by 2 s_y times the other.
    """
    s = float(constants.get("tracker_bias_rad", TRACKER_BIAS_RAD))
    eta = float(constants.get("coupling_rad", COUPLING_RAD))
    return {
        "ac11_dx_m": 2.0 * s * abs(joint["ac11_dz_m"].value),
        "ac11_dz_m": 2.0 * s * abs(joint["ac11_dx_m"].value),
        "ac12_rad": math.hypot(s, eta),
        "ac13_rad": math.hypot(s, 0.5 * eta),
    }


def _of(paper: PaperEstimate, name: str) -> dict[str, float] | None:
    place = NAMES.index(name)
    value, sigma = float(paper.values[place]), float(paper.sigmas[place])
    return {"value": value, "sigma": sigma} if np.isfinite(value) else None


def _missing(paper: PaperEstimate) -> list[str]:
    """Which parameters the published estimate cannot give, in one line."""
    names = [name for name, value in zip(NAMES, paper.values, strict=True) if not np.isfinite(value)]
    if not names:
        return []
    return [
        f"no run for {', '.join(names)}: without it the published estimate takes zero for it in the other sessions, "
        "and the joint one uses what their lines say of it"
    ]
