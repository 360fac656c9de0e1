"""A made-up table, to try effects out on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.effects.trial import AnyColumns

_READINGS = 24


@dataclass
class MadeUpReadings:
    """What an effect on `response` may ask of a table: columns of numbers and the response so far, shape (n,)."""

    signal: FloatArray = field(default_factory=lambda: np.linspace(0.5, 2.0, _READINGS))
    columns: AnyColumns = field(default_factory=lambda: AnyColumns((_READINGS,)))

    def column(self, name: str) -> FloatArray:
        """A column of readings.csv, shape (n,)."""
        return self.columns[name]


def trial_run(point: str) -> MadeUpReadings:
    """Readings; a table has one point."""
    del point
    return MadeUpReadings()
