"""The platform's turns in a run that comes in blocks: when they were, which way they went, what they look like."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array
from rigctl.experiments.rotating_platform.observe.cells import BESIDE_S, FAR
from rigctl.experiments.rotating_platform.observe.even_samples import held

OFF_STOP_DEG = 0.02
"""A dwell that never comes so near to 0 or half a turn is one that stopped elsewhere."""

_STILL_RAD = 2e-6


@dataclass(frozen=True)
class Course:
    """Of each sample of a block: whether the platform rests, and its angle.

    `since` samples have passed since the last turn ended, `to_go` follow before the next begins, `direction` is that
    of the last turn. `still`: at rest where it should rest; `astray`: of a dwell away from both stops.
    """

    rests: BoolArray
    theta_rad: FloatArray
    since: Int64Array
    to_go: Int64Array
    direction: FloatArray
    still: BoolArray
    astray: BoolArray


class Turns:
    """Looks at successive blocks of a run and remembers of each what the next one needs."""

    def __init__(self, rate_hz: float, samples: int) -> None:
        self.ahead = math.ceil(2.0 * BESIDE_S * rate_hz)
        self.before = 0
        self._rate_hz, self._samples = rate_hz, samples
        self._since, self._direction, self._stop_rad = FAR, 0.0, math.nan
        self._last_rad = np.zeros(0)
        self._courses: dict[tuple[int, int], tuple[FloatArray, int]] = {}

    def course(self, moving: FloatArray, theta_rad: FloatArray) -> Course:
        """What the platform did in a block that begins with a period; its whole turns are added to the mean ones."""
        moving, theta_rad = held(moving, theta_rad)
        rests = moving == 0.0
        index = np.arange(rests.size)
        last = np.maximum.accumulate(np.where(rests, -1 - self._since, index))
        following = np.minimum.accumulate(np.where(rests, FAR, index)[::-1])[::-1]
        still, astray = _at_stops(theta_rad, rests)
        direction = self._directions(rests, theta_rad)
        self._add_turns(rests, theta_rad)
        return Course(rests, theta_rad, index - last - 1, following - index, direction, still, astray)

    def motion(self, course: Course) -> tuple[FloatArray, FloatArray]:
        """Angular rate and acceleration beside the turns; elsewhere none, whatever the encoder's last digit does."""
        theta_rad = course.theta_rad
        earlier = self._last_rad if self._last_rad.size == 2 else np.full(2, theta_rad[0])
        padded = np.concatenate([earlier, theta_rad, np.full(2, theta_rad[-1])])
        far_back, back, here, on, far_on = (padded[k : k + theta_rad.size] for k in range(5))
        # Five points: a turn of seconds at ten samples a second is too bent for three.
        speed = (8.0 * (on - back) - (far_on - far_back)) * (self._rate_hz / 12.0)
        turning = (16.0 * (on + back) - 30.0 * here - (far_on + far_back)) * (self._rate_hz**2 / 12.0)
        reach = round(BESIDE_S * self._rate_hz)
        near = ((course.since < reach) | (course.to_go <= reach)) & ~course.still
        return np.where(near, speed, 0.0), np.where(near, turning, 0.0)

    def remember(self, course: Course, length: int) -> None:
        """The next block begins after the first `length` samples of this one."""
        last = length - 1
        self._since = int(min(course.since[last] + 1, 2 * FAR)) if course.rests[last] else 0
        self._direction = float(course.direction[last])
        self._last_rad = course.theta_rad[max(last - 1, 0) : last + 1].copy()
        resting = np.flatnonzero(course.rests[:length])
        if resting.size:
            self._stop_rad = float(course.theta_rad[resting[-1]])

    def mean(self) -> tuple[FloatArray, Int64Array]:
        """`turns` and `turn_kinds` of `Cells`."""
        turns = np.zeros((len(self._courses), self.before + self.ahead // 2))
        for number, (total, count) in enumerate(self._courses.values()):
            turns[number] = total / count
        return turns, np.array(list(self._courses), dtype=np.int64).reshape(-1, 2)

    def _directions(self, rests: BoolArray, theta_rad: FloatArray) -> FloatArray:
        """Of the last turn of each sample."""
        rested = np.concatenate([[self._since > 0], rests[:-1]])
        begins, ends = np.flatnonzero(rests & ~rested), np.flatnonzero(~rests & rested)
        direction = np.full(rests.size, self._direction)
        for begin in begins.tolist():
            before = ends[ends < begin]
            stop_rad = theta_rad[before[-1] - 1] if before.size and before[-1] > 0 else self._stop_rad
            turned = theta_rad[min(begin + self.ahead // 2, rests.size - 1)] - stop_rad
            direction[begin:] = np.sign(turned) if abs(turned) > _STILL_RAD else direction[begin]
        return direction

    def _add_turns(self, rests: BoolArray, theta_rad: FloatArray) -> None:
        """Add whole turns to the mean ones of their kinds."""
        begins = np.flatnonzero(rests[1:] & ~rests[:-1]) + 1
        ends = np.flatnonzero(~rests[1:] & rests[:-1]) + 1
        beside = self.ahead // 2
        for end in begins.tolist():
            before = ends[ends < end]
            if not before.size:
                continue
            before_end = end - int(before[-1]) + beside
            self.before = self.before or before_end
            first, last = end - self.before, end + beside
            if first < 0 or last > theta_rad.size or abs(before_end - self.before) > 1:
                continue
            course = theta_rad[first:last] - theta_rad[first]
            kind = (1 if course[-1] >= 0.0 else -1, end % self._samples)
            total, count = self._courses.get(kind, (np.zeros(course.size), 0))
            self._courses[kind] = total + course, count + 1


def _at_stops(theta_rad: FloatArray, rests: BoolArray) -> tuple[BoolArray, BoolArray]:
    """`still` and `astray` of each sample, from the angle in the middle of its dwell and the nearest to a stop.

    The difference of two angles could not tell: an encoder's last digit changes at rest too.
    """
    starts = np.flatnonzero(np.concatenate([[True], rests[1:] != rests[:-1]]))
    stops = np.append(starts[1:], theta_rad.size)
    middle_rad = np.repeat(theta_rad[(starts + stops) // 2], stops - starts)
    still = rests & (np.abs(theta_rad - middle_rad) < _STILL_RAD)
    away = np.abs(theta_rad - np.pi * np.rint(theta_rad / np.pi))
    nearest = np.minimum.reduceat(away, starts)
    astray = np.repeat(nearest > math.radians(OFF_STOP_DEG), stops - starts) & rests
    return np.asarray(still), np.asarray(astray)
