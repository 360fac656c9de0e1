"""In-flight calibration of a drag-free differential accelerometer: from a store to its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigctl.analysis.kept import Progress
from rigctl.campaign.recording import RunSource
from rigctl.effects.plugins import Plugin
from rigctl.experiments.inflight.observe.store_reduction import reduction
from rigctl.experiments.inflight.result.monte_carlo import DRAW, Draw, tables
from rigctl.experiments.inflight.result.result import calibration
from rigctl.experiments.inflight.study import InflightStudy
from rigctl.workbench.verdict.fit import parameters_of
from rigctl.workbench.workbench import Workbench


def reduced(source: RunSource, progress: Progress) -> Mapping[str, str]:
    """Their lines, run by run."""
    return reduction(source, progress=progress).left_out


def study(source: RunSource, plugins: Sequence[Plugin]) -> InflightStudy:
    """A recording's runs as the workbench sees them."""
    return InflightStudy(source, plugins)


@dataclass(frozen=True)
class InflightResult:
    """`numbers` as `rigctl result --json` has them: of one calibration, or of all draws of a Monte Carlo study."""

    numbers: Mapping[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl result --json`."""
        return dict(self.numbers)


def result(workbench: Workbench) -> dict[str, Any]:
    """The ten parameters of one calibration; of a Monte Carlo study the paper's tables 2 and 3; `DataError`."""
    return analyse(workbench).as_json()


def analyse(workbench: Workbench) -> InflightResult:
    """A calibration fitted with its current model, or all draws of a Monte Carlo study; `DataError`."""
    draws = [Draw.from_json(document.data) for document in workbench.store.documents(DRAW)]
    if draws:
        return InflightResult(tables(draws))
    studied = workbench.study
    assert isinstance(studied, InflightStudy)
    version = workbench.current
    numbers = calibration(studied, parameters_of(studied, version.terms))
    return InflightResult({"version": version.version, **numbers})
