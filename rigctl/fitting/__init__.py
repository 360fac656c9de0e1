"""Fits that say whether to trust them: least squares, the plane of the motion vectors, budgets."""

from rigctl.fitting.budget import Budget, Comparison, Contribution, MonteCarlo, budget, compare, monte_carlo
from rigctl.fitting.least_squares import FitResult, Parameter, Prior, least_squares
from rigctl.fitting.plane import ARCSEC, Axis, AxisAngle, PlaneFit, angle_between, fit_plane

__all__ = [
    "ARCSEC",
    "Axis",
    "AxisAngle",
    "Budget",
    "Comparison",
    "Contribution",
    "FitResult",
    "MonteCarlo",
    "Parameter",
    "PlaneFit",
    "Prior",
    "angle_between",
    "budget",
    "compare",
    "fit_plane",
    "least_squares",
    "monte_carlo",
]
