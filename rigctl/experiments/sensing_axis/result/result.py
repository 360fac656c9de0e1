"""The result of a campaign: sensing axes with their uncertainty, and the angles between them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from rigctl.analysis.plane import PlaneFit, angle_between, fit_plane
from rigctl.analysis.rotation import FrameRotation
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ProcedureError
from rigctl.experiments.sensing_axis.model.fit import NullPoint, RecordingFit, fit_recording
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.files.package import Package


@dataclass(frozen=True)
class AxisResult:
    """One sensing axis: its plane of null vectors, `vectors` of shape (n, 3) in the cube's frame.

    `host` takes it into the host's frame, where it is wanted.
    """

    name: str
    plane: PlaneFit
    nulls: tuple[NullPoint, ...]
    vectors: FloatArray
    host: FrameRotation
    requirement_arcsec: float
    requirement_is_stated: bool = True

    @property
    def passed(self) -> bool:
        """True when the half-cone deviation at 2 sigma is within the requirement."""
        return self.plane.std_hc_2sigma_arcsec <= self.requirement_arcsec


@dataclass(frozen=True)
class SensingAxisResult:
    """All axes of a campaign. `missing` says why an axis has no result."""

    axes: Mapping[str, AxisResult]
    missing: Mapping[str, str]
    fit: RecordingFit

    def as_json(self) -> dict[str, Any]:
        """The keys of `rigctl result --json`."""
        axes = {name: _axis_json(axis) for name, axis in self.axes.items()}
        package = self.fit.model.package
        return {
            "axes": axes,
            "angles": self._angles(),
            "missing": dict(self.missing),
            "nulls": self._nulls(),
            "stated": {"requirement": package.states_requirement, "host_frame": package.states_host_frame},
        }

    def _angles(self) -> dict[str, Any]:
        angles = {}
        # Axes are measured in mountings of their own: their errors are independent.
        for a, b in combinations(self.axes, 2):
            angle = angle_between(self.axes[a].plane.axis, self.axes[b].plane.axis)
            degrees = math.degrees(angle.rad)
            angles[f"{a}{b}"] = {
                "deg": degrees,
                # Without a sign: which side of an axis is positive is a choice.
                "offset_deg": abs(degrees - 90.0),
                "sigma_deg": math.degrees(angle.sigma_rad),
            }
        return angles

    def _nulls(self) -> list[dict[str, Any]]:
        return [
            {
                "axis": null.axis,
                "configuration": null.configuration,
                "mounting": null.mounting,
                "theta0_deg": math.degrees(null.theta0_rad),
                "theta0_sigma_arcsec": math.degrees(null.theta0_sigma_rad) * 3600.0,
                "vector_coc": None if null.vector_coc is None else null.vector_coc.tolist(),
            }
            for null in self.fit.nulls()
        ]


def sensing_axes(model: RecordingModel) -> SensingAxisResult:
    """Fit a model to its runs and find the axes; `ProcedureError` when the runs do not determine its parameters."""
    fit = fit_recording(model)
    axes: dict[str, AxisResult] = {}
    missing: dict[str, str] = {}
    for name in dict.fromkeys(run.axis for run in model.runs):
        try:
            axes[name] = axis_result(name, model.package, [null for null in fit.nulls() if null.axis == name])
        except ProcedureError as error:
            missing[name] = str(error)
    return SensingAxisResult(axes, missing, fit)


def axis_result(name: str, package: Package, nulls: Sequence[NullPoint]) -> AxisResult:
    """The axis that the nulls of its mountings give; `ProcedureError` where they span no plane."""
    usable = [null for null in nulls if null.vector_coc is not None]
    vectors = np.array([null.vector_coc for null in usable]).reshape(-1, 3)
    plane = fit_plane(vectors, package.axes[name].nominal_axis)
    required = package.requirement_arcsec, package.states_requirement
    return AxisResult(name, plane, tuple(usable), vectors, package.uoaf_rotation(), *required)


def _axis_json(axis: AxisResult) -> dict[str, Any]:
    plane = axis.plane
    paper = plane.paper_axis
    uoaf, uoaf_covariance = axis.host.carried(plane.normal, plane.covariance)
    return {
        "coc": plane.normal.tolist(),
        "uoaf": uoaf.tolist(),
        "uoaf_covariance": uoaf_covariance.tolist(),
        "std_hc_2sigma_arcsec": plane.std_hc_2sigma_arcsec,
        "theta_m_arcsec": plane.theta_m_arcsec,
        "vectors": plane.vectors,
        "covariance": plane.covariance.tolist(),
        "dof": plane.dof,
        "requirement_arcsec": axis.requirement_arcsec,
        "pass": axis.passed,
        "eq12": None if paper is None else {"coc": paper.unit.tolist(), "theta_m_arcsec": paper.theta_m_arcsec},
    }
