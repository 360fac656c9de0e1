"""Whether samples are in the unit that their column's name says: what was asked for against what is seen.

A factor of a thousand between the two is a slip of the unit, not a property of the bench.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray

Columns = Mapping[str, FloatArray]

SLIPS = (1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9)
SLIP_WITHIN = 1.4
"""How far an amplitude may be from a thousand times another to be taken for the same one."""

_TIME_IN = {1e3: "ms", 1e6: "us", 1e9: "ns", 1e-3: "ks", 1e-6: "Ms", 1e-9: "Gs"}


@dataclass(frozen=True)
class UnitFindings:
    """`slip`: a column that is not in its unit, and the mend; `remarks`: what differs otherwise."""

    slip: str | None = None
    remarks: tuple[str, ...] = ()


def slip_between(seen: float, asked: float) -> float | None:
    """The power of a thousand that lies between two quantities, None when there is none."""
    if not (seen > 0 and asked > 0):
        return None
    return next((slip for slip in SLIPS if 1 / SLIP_WITHIN < seen / asked / slip < SLIP_WITHIN), None)


def sample_step_s(t_s: FloatArray) -> float:
    """The median step of time; NaN for a single sample."""
    return float(np.median(np.diff(t_s))) if t_s.size > 1 else math.nan


def time_slip(seen: str, asked: str, slip: float) -> str:
    """What to say when the two differ by this power of a thousand."""
    return f"{seen}, {asked}: t_s looks like {_TIME_IN[slip]}; write it in seconds"
