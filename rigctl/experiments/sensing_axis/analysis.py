"""The sensing axes of accelerometers on a turntable: from a store to axes, angles and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis.kept import Progress
from rigctl.analysis.measurement_result import MeasurementResult
from rigctl.campaign.recording import RunSource
from rigctl.campaign.stated import uncertainties_of
from rigctl.core.errors import DataError
from rigctl.effects.plugins import Plugin
from rigctl.experiments.sensing_axis.observe.store_reduction import reduction
from rigctl.experiments.sensing_axis.result.budget import AxisBudget, axis_budgets
from rigctl.experiments.sensing_axis.result.host_axes import host_axes, with_host_axes
from rigctl.experiments.sensing_axis.result.measurement import axes_measured
from rigctl.experiments.sensing_axis.result.misfit import misfit
from rigctl.experiments.sensing_axis.result.result import SensingAxisResult, sensing_axes
from rigctl.experiments.sensing_axis.study import SensingAxisStudy
from rigctl.workbench.workbench import Workbench


def reduced(source: RunSource, progress: Progress) -> Mapping[str, str]:
    """Their harmonics, run by run."""
    return reduction(source, progress=progress).left_out


def study(source: RunSource, plugins: Sequence[Plugin]) -> SensingAxisStudy:
    """A recording's runs as the workbench sees them."""
    return SensingAxisStudy(source, plugins)


def result(workbench: Workbench) -> dict[str, Any]:
    """Axes, angles, nulls and the uncertainty budget; after a quick check what it said."""
    store = workbench.store
    quick = [event.data["result"] for event in store.events("once") if event.data["key"] == "quick check"]
    axes = analyse(workbench)
    found = {
        **numbers(axes, axis_budgets(axes, uncertainties_of(store.header))),
        "warnings": misfit(axes.fit, workbench.current.version),
    }
    return {**found, "quick_check": quick[-1]} if quick else found


def numbers(axes: SensingAxisResult, budgets: Mapping[str, AxisBudget]) -> dict[str, Any]:
    """Keys of `rigctl result --json`: the axes, in the host's frame with the covariance of their budgets."""
    found = axes.as_json()
    in_host = with_host_axes(found, host_axes(axes, budgets)) if budgets else found
    return {**in_host, "budget": {name: each.as_json() for name, each in budgets.items()}}


def measurement_result(workbench: Workbench) -> MeasurementResult:
    """The axes with everything their uncertainty is made of; `DataError`, `ProcedureError`."""
    axes = analyse(workbench)
    return axes_measured(axes, axis_budgets(axes, uncertainties_of(workbench.store.header)))


def analyse(workbench: Workbench) -> SensingAxisResult:
    """Fit a store's runs with its current model and find the axes; `DataError` where there are none to find."""
    store, studied = workbench.store, workbench.study
    if not isinstance(studied, SensingAxisStudy):
        raise DataError(f"{store.path}: '{store.header.experiment}' recordings have no sensing axes")
    return sensing_axes(studied.model(workbench.current.terms).inner)
