"""What runs cost: their own time, and once what several of them share."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.study import Proposal


class RigTime:
    """Of some proposals; `run_price_s` is the rig time that a run is worth where runs are limited too."""

    def __init__(self, proposals: Sequence[Proposal], run_price_s: float = 0.0) -> None:
        known = [each.takes_s if each.takes_s > 0.0 else 1.0 for each in proposals]  # else one is like another
        self._takes_s = np.array(known) + run_price_s
        self._sitting_s = np.array([each.sitting_s for each in proposals])
        self._sitting = np.array([each.sitting for each in proposals], dtype=np.str_)

    @property
    def runs(self) -> int:
        """How many there are to choose from."""
        return len(self._takes_s)

    def of_each(self, chosen: Collection[int]) -> FloatArray:
        """Of one run more [s], with some chosen already: what these have set up is there."""
        there = np.isin(self._sitting, self._sitting[list(chosen)])
        return np.asarray(self._takes_s + np.where(there, 0.0, self._sitting_s))

    def sittings(self, chosen: Collection[int]) -> list[IntArray]:
        """All runs of each sitting that has some of the chosen."""
        names = sorted({str(name) for name in self._sitting[list(chosen)]} - {""})
        return [np.flatnonzero(self._sitting == name) for name in names]


def total_s(runs: Sequence[Proposal]) -> float:
    """Rig time of these runs together; NaN where it is not known."""
    # Each is set up once; runs of no sitting share the name "", which costs nothing.
    sittings = {run.sitting: run.sitting_s for run in runs}
    return float(sum(run.takes_s for run in runs) + sum(sittings.values()))
