"""What the analysis sends to be shown: data, for which the program that shows them need not import the analysis."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.analysis.run_misfit import RunMisfit
from rigctl.report.picture import Picture


@dataclass(frozen=True)
class Watch:
    """Plots, the most telling first, and the runs that are far from the model."""

    pictures: tuple[Picture, ...] = ()
    far: tuple[RunMisfit, ...] = ()


@dataclass(frozen=True)
class RecordedRun:
    """What there is of a run; `can_be_marked` where a store keeps it as one."""

    run_id: str
    facts: tuple[str, ...]
    pictures: tuple[Picture, ...]
    valid: bool = True
    reason: str = ""
    can_be_marked: bool = True
