"""What an experiment shows of its results: `drawing_of` gives the module that its declaration names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from rigctl.campaign.store.store import Store
from rigctl.core.experiments import part_of
from rigctl.report.picture import Picture
from rigctl.report.tables.result_table import ResultTable
from rigctl.workbench.workbench import Workbench

if TYPE_CHECKING:
    from rigctl.report.figures.data import Plate  # drawing, which a printed result does without


@dataclass(frozen=True)
class Drawn:
    """What an experiment adds to a report: its result as `--json` prints it, figures, and why one is not there."""

    result: Mapping[str, Any] = field(default_factory=dict)
    plates: Sequence[Plate[Any]] = ()
    spectra: Sequence[Plate[Any]] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)


class Drawing(Protocol):
    """What an experiment shows. The module that its declaration names as `report` has these functions."""

    def tables(self, found: Mapping[str, Any], reference: Mapping[str, Any]) -> Sequence[ResultTable]:
        """A result as tables, beside a campaign file's reference values: printed, in a report and in the console."""

    def draw(self, workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
        """What a report shows; `lines_hz` are lines the model has, `found` those it has not (study.Line)."""


@runtime_checkable
class DrawingForConsole(Protocol):
    """What an experiment plots beside the tables of its result, where its `report` module has this function too."""

    def pictures(self, workbench: Workbench) -> Sequence[Picture]:
        """Plots beside the tables of the result."""


@runtime_checkable
class DrawingOfProgress(Protocol):
    """What an experiment plots while its runs come, where its `report` module has this function too."""

    def progress(self, store: Store) -> Sequence[Picture]:
        """What is measured, as far as it is known, the most telling first; none before there is any."""


def drawing_of(experiment: str, path: Path | str = "") -> Drawing:
    """What an experiment shows, named in a store (`path`); `DataError` when it is not installed."""
    found: Drawing = part_of(experiment, "report", path)
    return found
