"""Runs that make the result better where there is nothing to tell apart."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.next.imagined import Imagined
from rigctl.workbench.next.information import Precision
from rigctl.workbench.next.plan import greedy
from rigctl.workbench.next.recommendation import Tightened
from rigctl.workbench.next.rig_time import RigTime
from rigctl.workbench.next.triangle import triangle_of

_MOST_RUNS = 6
_TIGHTER = 0.01
"""By how much a run should lower a standard uncertainty, on average over the parameters."""


def tightening(
    imagined: Imagined, result: dict[str, dict[str, Any]], most_runs: int
) -> tuple[list[int], list[Tightened]]:
    """Which proposals to make, and what they do to the parameters that a `result` names (as of `Study.result`).

    Uncertainties are in units of the model's parameters, which a result may give in others. What counts is the sum of
    the logarithms of the standard uncertainties.
    """
    wanted = [name for name in imagined.names if name in result]
    if not wanted:
        return [], []
    precision = Precision(triangle_of(imagined, wanted=wanted), wanted)
    before = precision.sigmas()

    def gains() -> FloatArray:
        return np.asarray(np.sum(np.log(precision.sigmas()[:, None] / precision.sigmas_with_each()), axis=0))

    def worth(gain: float, _: int) -> bool:
        return gain >= _TIGHTER * len(wanted)

    chosen = greedy(gains, precision.add, worth, RigTime(imagined.proposals), min(most_runs, _MOST_RUNS))
    pairs = zip(wanted, before, precision.sigmas(), strict=True)
    return chosen, [Tightened(name, float(was), float(will), imagined.units[name]) for name, was, will in pairs]
