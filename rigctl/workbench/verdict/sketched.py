"""What a long table tries, as a sketch of its rows: the number of independent trials is known to 16 % anyway."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.sketch import sketch_of
from rigctl.analysis.summed_columns import SummedColumns
from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.scan import ScanScores
from rigctl.workbench.verdict.score import Projector
from rigctl.workbench.verdict.trials import Family


class SketchedTrials:
    """Families of candidates beside a fit whose `projector` has so many rows, as their sketches."""

    def __init__(self, projector: Projector) -> None:
        self._sketch = sketch_of(len(projector.left))
        fitted = self._sketch.of(projector.basis)
        none = np.zeros(self.rows)
        self._projector = Projector(fitted, none, np.full(self.rows, np.inf), self.rows)

    @property
    def rows(self) -> int:
        """Of all sketches."""
        return self._sketch.buckets

    def basis(self, sketch: FloatArray) -> FloatArray:
        """Of what the fit leaves of a candidate, from the `sketch` (rows, d) of its whitened columns."""
        return self._projector.score(sketch).basis

    def add_scan(self, family: Family, unit: SummedColumns) -> None:
        """A scan."""
        family.scans.append(ScanScores(self._projector, unit.sketched(self._sketch), 1.0, None))
