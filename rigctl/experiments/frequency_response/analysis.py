"""The frequency response: from a store to sensitivities, linearity and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis.kept import Progress
from rigctl.analysis.measurement_result import MeasurementResult
from rigctl.campaign.recording import RunSource
from rigctl.core.errors import DataError
from rigctl.effects.plugins import Plugin
from rigctl.experiments.frequency_response.measurement import sensitivities_measured
from rigctl.experiments.frequency_response.observables import reduction
from rigctl.experiments.frequency_response.result import ResponseResult, response_result
from rigctl.experiments.frequency_response.study import ResponseStudy, bench_of
from rigctl.workbench.workbench import Workbench


def reduced(source: RunSource, progress: Progress) -> Mapping[str, str]:
    """Which runs no sensitivity can be had of, and why."""
    del progress
    return reduction(source, bench_of(source.header).tilts_rad)[1]


def study(source: RunSource, plugins: Sequence[Plugin]) -> ResponseStudy:
    """A recording's runs as the workbench sees them."""
    return ResponseStudy(source, plugins)


def analyse(workbench: Workbench) -> ResponseResult:
    """Sensitivities of a store's runs; `DataError` where there are none."""
    studied = workbench.study
    if not isinstance(studied, ResponseStudy):
        raise DataError(f"{workbench.store.path}: no frequency response was recorded")
    return response_result(studied.data)


def measurement_result(workbench: Workbench) -> MeasurementResult:
    """Magnitude and phase of the sensitivity at every frequency, with their budgets; `DataError`."""
    return sensitivities_measured(analyse(workbench))


def result(workbench: Workbench) -> dict[str, Any]:
    """Sensitivity by frequency with its budget, linearity, directions; and the fit of the current model."""
    found = analyse(workbench).as_json()
    fit = workbench.fitted().as_json()
    return {**found, "version": workbench.current.version, **fit}
