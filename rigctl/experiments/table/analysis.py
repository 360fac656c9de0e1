"""Anybody's calibration, a table of readings: the fit is the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigctl.analysis.kept import Progress
from rigctl.campaign.recording import RunSource
from rigctl.effects.plugins import Plugin
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.fit_result import analyse, result

__all__ = ["analyse", "reduced", "result", "study"]


def reduced(source: RunSource, progress: Progress) -> Mapping[str, str]:
    """Readings are taken as they are."""
    del source, progress
    return {}


def study(source: RunSource, plugins: Sequence[Plugin]) -> TableStudy:
    """A recording's readings as the workbench sees them."""
    return TableStudy(source, plugins)
