"""What an experiment makes of its recordings: `analysis_of` gives the module that its declaration names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from rigctl.analysis.kept import Progress
from rigctl.analysis.measurement_result import MeasurementResult
from rigctl.campaign.recording import RunSource
from rigctl.core.experiments import part_of
from rigctl.effects.plugins import Plugin
from rigctl.workbench.study import Study
from rigctl.workbench.workbench import Workbench


class Result(Protocol):
    """What an experiment finds, with everything it was made from; its further attributes are its own."""

    def as_json(self) -> dict[str, Any]:
        """Its numbers, as `rigctl result --json` gives them."""


class Analysis(Protocol):
    """The analysis of an experiment. The module that its declaration names as `analysis` has these functions."""

    def reduced(self, source: RunSource, progress: Progress) -> Mapping[str, str]:
        """Reduce the valid runs once and for all; which were left out, and why."""

    def study(self, source: RunSource, plugins: Sequence[Plugin]) -> Study:
        """A recording's runs as the workbench sees them."""

    def analyse(self, workbench: Workbench) -> Result:
        """What a store amounts to, for a notebook. `DataError`, `ProcedureError`."""

    def result(self, workbench: Workbench) -> dict[str, Any]:
        """What a store amounts to: keys of `rigctl result --json`. `DataError`, `ProcedureError`."""


@runtime_checkable
class Measuring(Protocol):
    """An analysis whose result is more than the fit of its model: its module has this function too."""

    def measurement_result(self, workbench: Workbench) -> MeasurementResult:
        """What a certificate certifies: quantities with the sources of their uncertainty. `DataError`,
        `ProcedureError`."""


def analysis_of(experiment: str, path: Path | str = "") -> Analysis:
    """The analysis of an experiment, named in a store or a bundle (`path`); `DataError` when it is not installed."""
    found: Analysis = part_of(experiment, "analysis", path)
    return found


def measurement_result_of(workbench: Workbench) -> MeasurementResult:
    """The measurement result of a store, of any experiment; `DataError`, `ProcedureError` where there is none."""
    # Here, for it brings scipy along, which what a store keeps already is told without.
    from rigctl.workbench.fit_measurement import fit_measurement

    analysis = analysis_of(workbench.store.header.experiment, workbench.store.path)
    return analysis.measurement_result(workbench) if isinstance(analysis, Measuring) else fit_measurement(workbench)
