"""The result of a table of readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigctl.experiments.table.model.model import TableModel
from rigctl.report.drawn import Drawn
from rigctl.report.tables.result_table import ResultTable
from rigctl.report.tables.workbench import parameters_table
from rigctl.workbench.workbench import Workbench


def tables(found: Mapping[str, Any], reference: Mapping[str, Any]) -> list[ResultTable]:
    """The fit."""
    del reference
    return [parameters_table(found)]


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """What each term of the model says beside the readings."""
    from rigctl.report.figures.table.terms import term_plates  # drawing, which a printed result does without

    del lines_hz, found
    fit = workbench.fitted()
    model = workbench.study.model(workbench.current.terms)
    assert isinstance(model, TableModel)
    values = np.array([fit.parameters[parameter.name].value for parameter in model.parameters])
    return Drawn(plates=tuple(term_plates(model, values)))
