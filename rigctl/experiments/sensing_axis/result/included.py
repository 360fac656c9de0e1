"""What the scatter between mountings contains already, and a budget must not count again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.plane import ARCSEC
from rigctl.experiments.sensing_axis.result.result import AxisResult


@dataclass(frozen=True)
class Included:
    """A part of the measured scatter, as one mounting has it [rad, 1 sigma out of the plane]."""

    name: str
    rad: float


def included_of(axis: AxisResult, uncertainties: Mapping[str, Mapping[str, float]]) -> tuple[Included, ...]:
    """Parts of the scatter that are known by themselves."""
    normal = axis.plane.normal
    covariances = [null.vector_covariance for null in axis.nulls if null.vector_covariance is not None]
    fitted = np.sqrt(np.mean([normal @ covariance @ normal for covariance in covariances]))
    nulls = np.sqrt(np.mean([null.theta0_sigma_rad**2 for null in axis.nulls]))
    # Uniform within a step.
    resolution = uncertainties.get("rotation", {}).get("resolution_arcsec", 0.0) * ARCSEC / math.sqrt(12.0)
    return (
        Included("null search (noise of the accelerometer)", float(nulls)),
        Included("null search and lasers together", float(fitted)),
        Included("resolution of the rotation stage", resolution),
    )
