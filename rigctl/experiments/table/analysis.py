"""Anybody's calibration, a table of readings: the fit is the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis.kept import Progress
from rigctl.campaign.recording import RunSource
from rigctl.effects.plugins import Plugin
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.findings import ModelFit
from rigctl.workbench.verdict.fit import fit
from rigctl.workbench.workbench import Workbench


def reduced(source: RunSource, progress: Progress) -> Mapping[str, str]:
    """Readings are taken as they are."""
    del source, progress
    return {}


def study(source: RunSource, plugins: Sequence[Plugin]) -> TableStudy:
    """A recording's readings as the workbench sees them."""
    return TableStudy(source, plugins)


def result(workbench: Workbench) -> dict[str, Any]:
    """The fit, with the version of its model."""
    return {"version": workbench.current.version, **analyse(workbench).as_json()}


def analyse(workbench: Workbench) -> ModelFit:
    """The fit is the result."""
    return fit(workbench.study, workbench.current.terms)
