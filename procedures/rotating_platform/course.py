"""What the platform did in a run, for every sample: where it stood, and whether it moved."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from procedures.rotating_platform.time_table import TimeTable
from rigctl.core.arrays import BoolArray, FloatArray

SAME_SAMPLE = 1e-3
"""Of a sample period: how exactly a sample at the edge of a dwell can be said to be before or after it."""


@dataclass(frozen=True)
class Leg:
    """A turn as it was carried out: from the command to the controller's word that it is over [s, deg]."""

    began_s: float
    ended_s: float
    from_deg: float
    to_deg: float


class Course:
    """The legs so far. A dwell's angle is what the encoder said in it, between dwells a cycloid is taken for granted.

    Samples count as moving where the table has the platform turn, and beyond that as long as it was late.
    """

    def __init__(self, table: TimeTable, begin_deg: float, sample_period_s: float) -> None:
        self._starts_s = np.array([motion.start_s for motion in table.motions])
        self._stops_s = np.array([motion.stop_s for motion in table.motions])
        self._edge_s = SAME_SAMPLE * sample_period_s
        # A leg that ended before all times: from the beginning the platform stands.
        self._legs = [Leg(-math.inf, -math.inf, begin_deg, begin_deg)]

    @property
    def last_theta_deg(self) -> float:
        """Where the last leg ended."""
        return self._legs[-1].to_deg

    def add(self, leg: Leg) -> None:
        """One more turn; legs come in order."""
        self._legs.append(leg)

    def forget(self, before_s: float) -> None:
        """Nobody asks for times before this any more."""
        while len(self._legs) > 1 and self._legs[1].ended_s < before_s:
            self._legs.pop(0)

    def theta_deg(self, times_s: FloatArray) -> FloatArray:
        """The angle at times of the run that are over, same shape."""
        began_s, ended_s, from_deg, to_deg = (
            np.array([getattr(leg, name) for leg in self._legs])
            for name in ("began_s", "ended_s", "from_deg", "to_deg")
        )
        # Times before the first leg belong to it.
        leg = np.maximum(np.searchsorted(began_s, times_s, side="right") - 1, 0)
        theta_deg = to_deg[leg]
        under_way = times_s < ended_s[leg]
        leg = leg[under_way]
        part = (times_s[under_way] - began_s[leg]) / (ended_s[leg] - began_s[leg])
        # What is left of a cycloid, counted back from where the leg ends, which the encoder has said.
        theta_deg[under_way] -= (to_deg[leg] - from_deg[leg]) * (
            1.0 - part + np.sin(2.0 * np.pi * part) / (2.0 * np.pi)
        )
        return theta_deg

    def moving(self, times_s: FloatArray) -> BoolArray:
        """Whether it moves at such times, same shape."""
        moving = _inside(times_s + self._edge_s, self._starts_s, self._stops_s)
        began_s = np.array([leg.began_s for leg in self._legs])
        ended_s = np.array([leg.ended_s for leg in self._legs])
        return np.asarray(moving | _inside(times_s, began_s, ended_s))


def _inside(times_s: FloatArray, starts_s: FloatArray, stops_s: FloatArray) -> BoolArray:
    """Whether times lie in one of successive intervals [start, stop)."""
    if not starts_s.size:
        return np.zeros(times_s.shape, dtype=np.bool_)
    index = np.searchsorted(starts_s, times_s, side="right") - 1
    return np.asarray((index >= 0) & (times_s < stops_s[np.maximum(index, 0)]))
