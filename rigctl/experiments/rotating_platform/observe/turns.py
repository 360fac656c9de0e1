"""The platform's dwells and turns in a run that comes in blocks: when they were, which way, what they look like."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array
from rigctl.experiments.rotating_platform.observe.cells import BESIDE_S, FAR
from rigctl.experiments.rotating_platform.observe.even_samples import held

OFF_STOP_DEG = 0.02
"""A dwell that never comes so near to 0 or half a turn is one that stopped elsewhere."""

# A ten-thousandth of a degree, the last digit of a recorded angle.
_STILL_RAD = 2e-6
# Of an encoder's noise: once in a billion samples it is farther off.
_OF_NOISE = 6.0
# Of a normal variable the median of |x| is that of sigma.
_MEDIAN = 0.6745


@dataclass(frozen=True)
class Dwells:
    """The stretches of a block in which the platform rests, in order; places are sample numbers in the block.

    Of the samples: whether the platform `rests`, its angle, whether it is `still`: at rest where it should rest, and
    whether flag or angle were `lost`, or the stop is not `known` from what is beside them.
    Of the dwells, shape (dwells,): first sample and the one after the last; `turned_at`, where the turn before it
    ended (`FAR` before the block where none was); `turn_at`, where the next begins (`FAR` where it is not in sight);
    `direction` of the turn before it; `astray`, away from both stops.
    """

    rests: BoolArray
    theta_rad: FloatArray
    still: BoolArray
    lost: BoolArray
    known: BoolArray
    start: Int64Array
    stop: Int64Array
    turned_at: Int64Array
    turn_at: Int64Array
    direction: FloatArray
    astray: BoolArray

    def number_at(self, places: Int64Array) -> Int64Array:
        """Which dwell samples that rest belong to."""
        return np.searchsorted(self.start, places, side="right") - 1


class Turns:
    """Looks at successive blocks of a run and remembers of each what the next one needs."""

    def __init__(self, rate_hz: float, samples: int) -> None:
        self.ahead = math.ceil(2.0 * BESIDE_S * rate_hz)
        self.before = 0
        self._rate_hz, self._samples = rate_hz, samples
        self._since, self._direction, self._stop_rad = FAR, 0.0, math.nan
        self._last_rad = np.zeros(0)
        self._courses: dict[tuple[int, int], tuple[FloatArray, int]] = {}

    def dwells(self, moving: FloatArray, theta_rad: FloatArray) -> Dwells:
        """Those of a block that begins with a period; its whole turns are added to the mean ones."""
        lost = ~(np.isfinite(moving) & np.isfinite(theta_rad))
        moving, theta_rad, known = held(moving, theta_rad)
        rests = moving == 0.0
        change = np.flatnonzero(rests[1:] != rests[:-1]) + 1
        bounds = np.concatenate([[0], change, [rests.size]])
        of_rest = np.flatnonzero(rests[bounds[:-1]])
        start, stop = bounds[of_rest], bounds[of_rest + 1]
        turned_at = np.where(start > 0, start, -self._since)
        # In the middle of a dwell the platform rests, even if the mask is too short.
        middle_rad = theta_rad[(bounds[:-1] + bounds[1:]) // 2]
        # The difference of two angles could not tell: an encoder's last digit changes at rest too.
        still = np.zeros(rests.size, dtype=np.bool_)
        for begin, end in zip(start.tolist(), stop.tolist(), strict=True):
            still[begin:end] = _still(theta_rad[begin:end])
        turn_at = np.where(stop < rests.size, stop, FAR)
        direction = self._directions(start, stop, theta_rad)
        self._add_turns(start, stop, theta_rad, lost)
        astray = _off_stops(middle_rad[of_rest])
        for number in np.flatnonzero(astray).tolist():
            astray[number] = _off_stops(theta_rad[start[number] : stop[number]]).all()
        return Dwells(rests, theta_rad, still, lost, known, start, stop, turned_at, turn_at, direction, astray)

    def motion(self, dwells: Dwells) -> tuple[FloatArray, FloatArray]:
        """Angular rate and acceleration of the samples that rest beside a turn and are not still; elsewhere none."""
        theta_rad = dwells.theta_rad
        speed, turning = np.zeros((2, theta_rad.size))
        at = np.flatnonzero(dwells.rests & ~dwells.still)
        number, reach = dwells.number_at(at), round(BESIDE_S * self._rate_hz)
        at = at[(at - dwells.turned_at[number] < reach) | (dwells.turn_at[number] - at <= reach)]
        if at.size:
            earlier = self._last_rad if self._last_rad.size == 2 else np.full(2, theta_rad[0])
            padded = np.concatenate([earlier, theta_rad, np.full(2, theta_rad[-1])])
            far_back, back, here, on, far_on = (padded[at + k] for k in range(5))
            # Five points: a turn of seconds at ten samples a second is too bent for three.
            speed[at] = (8.0 * (on - back) - (far_on - far_back)) * (self._rate_hz / 12.0)
            turning[at] = (16.0 * (on + back) - 30.0 * here - (far_on + far_back)) * (self._rate_hz**2 / 12.0)
        return speed, turning

    def remember(self, dwells: Dwells, length: int) -> None:
        """The next block begins after the first `length` samples of this one."""
        last, number = length - 1, int(dwells.number_at(np.array([length - 1]))[0])
        self._since = 0
        if number >= 0:
            if dwells.rests[last]:
                self._since = int(min(length - dwells.turned_at[number], 2 * FAR))
            self._direction = float(dwells.direction[number])
            self._stop_rad = float(dwells.theta_rad[min(dwells.stop[number] - 1, last)])
        self._last_rad = dwells.theta_rad[max(last - 1, 0) : length].copy()

    def mean(self) -> tuple[FloatArray, Int64Array]:
        """`turns` and `turn_kinds` of `Cells`."""
        turns = np.zeros((len(self._courses), self.before + self.ahead // 2))
        for number, (total, count) in enumerate(self._courses.values()):
            turns[number] = total / count
        return turns, np.array(list(self._courses), dtype=np.int64).reshape(-1, 2)

    def _directions(self, start: Int64Array, stop: Int64Array, theta_rad: FloatArray) -> FloatArray:
        """Of the turn before each dwell; that of the one before where the platform did not turn."""
        # A run may begin in a turn: which way it goes its own angles tell.
        last_rad = self._stop_rad if math.isfinite(self._stop_rad) else theta_rad[0]
        direction = self._direction
        directions = np.empty(start.size)
        for number, (begin, end) in enumerate(zip(start.tolist(), stop.tolist(), strict=True)):
            # A dwell that goes on from the block before had its turn there.
            if begin > 0 or self._since == 0:
                turned = theta_rad[min(begin + self.ahead // 2, theta_rad.size - 1)] - last_rad
                direction = float(np.sign(turned)) if abs(turned) > _STILL_RAD else direction
            directions[number], last_rad = direction, theta_rad[end - 1]
        return directions

    def _add_turns(self, start: Int64Array, stop: Int64Array, theta_rad: FloatArray, lost: BoolArray) -> None:
        """Add whole turns, of which no angle was lost, to the mean ones of their kinds."""
        beside = self.ahead // 2
        for begin, end in zip(stop[:-1].tolist(), start[1:].tolist(), strict=True):
            if lost[begin:end].any():
                continue
            before_end = end - begin + beside
            # The first turn sets the length; one that is longer by more than a sample is no turn of the table.
            self.before = self.before or before_end
            first, last = end - self.before, end + beside
            if first < 0 or last > theta_rad.size or abs(before_end - self.before) > 1:
                continue
            course = theta_rad[first:last] - theta_rad[first]
            kind = (1 if course[-1] >= 0.0 else -1, end % self._samples)
            total, count = self._courses.get(kind, (np.zeros(course.size), 0))
            self._courses[kind] = total + course, count + 1


def _still(theta_rad: FloatArray) -> BoolArray:
    """Which samples of a dwell lie where its middle does, as nearly as the encoder tells."""
    quarter = theta_rad.size // 4
    middle_rad = theta_rad[quarter : theta_rad.size - quarter]
    level_rad = float(np.median(middle_rad))
    noise_rad = float(np.median(np.abs(middle_rad - level_rad))) / _MEDIAN
    return np.asarray(np.abs(theta_rad - level_rad) < max(_STILL_RAD, _OF_NOISE * noise_rad))


def _off_stops(theta_rad: FloatArray) -> BoolArray:
    """Whether angles are away from both stops."""
    return np.asarray(np.abs(theta_rad - np.pi * np.rint(theta_rad / np.pi)) > math.radians(OFF_STOP_DEG))
