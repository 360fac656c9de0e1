"""The result of a table of readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.report.drawn import Drawn
from rigctl.report.terminal_workbench import print_fit
from rigctl.workbench.workbench import Workbench


def show(found: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
    """Print the fit."""
    del reference
    print_fit(found)


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """Nothing beyond what every report has."""
    del workbench, lines_hz, found
    return Drawn()
