"""The scans of a long table as sums over its rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl.analysis.column_sums import ColumnSums, SmoothSums, StepSums
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.model.form import Choice
from rigctl.experiments.table.model.scanned import Periodic, Scanned, Step

# Products of two functions are interpolated too: 24 nodes for each of their periods, an error of 1e-6.
_NODES_OF_A_PERIOD, _NODES_OF_AN_E_FOLD = 48, 8
_NODES_LEAST = 256


def sums_of(form: Scanned, choices: Sequence[Choice]) -> ColumnSums:
    """A form with each of its choices."""
    column = form.column
    if isinstance(form, Step):
        return StepSums(column.values, np.array([choice[form.scanned] for choice in choices]))

    def at(values: FloatArray, some: slice) -> FloatArray:
        return replace(form, column=replace(column, values=values)).scan(choices[some])

    scanned = np.array([choice[form.scanned] for choice in choices])
    if isinstance(form, Periodic):
        nodes = _NODES_OF_A_PERIOD * column.span / scanned.min()
    else:
        nodes = _NODES_OF_AN_E_FOLD * column.span * np.abs(scanned).max()
    return SmoothSums(column.values, len(choices), at, max(int(np.ceil(nodes)), _NODES_LEAST))
