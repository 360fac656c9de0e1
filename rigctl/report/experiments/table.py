"""The result of a table of readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.report.drawn import Drawn
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.tables.workbench import parameters_table
from rigctl.workbench.workbench import Workbench


def tables(found: Mapping[str, Any], reference: Mapping[str, Any]) -> list[ResultTable]:
    """The fit."""
    del reference
    return [parameters_table(found)]


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """Nothing beyond what every report has."""
    del workbench, lines_hz, found
    return Drawn()
