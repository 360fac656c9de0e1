"""The platform's motion about a turn, from its mean recorded angle: a cycloid where it is one, else a spline."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import interpolate, optimize, signal

from rigctl.core.arrays import FloatArray

_CYCLOID_RAD = 2e-4
_NODES_PER_CYCLE = 64.0
ORDER, RIPPLE_DB, STOP_DB = 8, 0.1, 80.0
"""The anti-alias filter: elliptic."""


@dataclass(frozen=True)
class _Cycloid:
    """theta = D (u - sin(2 pi u) / (2 pi)): rate and acceleration."""

    start_s: float
    duration_s: float
    turn_rad: float

    def __call__(self, times_s: FloatArray) -> FloatArray:
        phase = 2.0 * np.pi * np.clip((times_s - self.start_s) / self.duration_s, 0.0, 1.0)
        rate = self.turn_rad / self.duration_s
        return np.stack([rate * (1.0 - np.cos(phase)), 2.0 * np.pi * rate / self.duration_s * np.sin(phase)])

    def angle(self, times_s: FloatArray) -> FloatArray:
        phase = 2.0 * np.pi * np.clip((times_s - self.start_s) / self.duration_s, 0.0, 1.0)
        return np.asarray(self.turn_rad * (phase - np.sin(phase)) / (2.0 * np.pi))


@dataclass(frozen=True)
class Motion:
    """A turn between `first_s` and `last_s`, times from the end of its mask."""

    course: Callable[[FloatArray], FloatArray]
    first_s: float
    last_s: float

    @property
    def is_cycloid(self) -> bool:
        """Whether its beginning and end are known to better than a sample."""
        return isinstance(self.course, _Cycloid)

    def forces(self, times_s: FloatArray) -> FloatArray:
        """Square of the angular rate and angular acceleration, shape (2, times)."""
        inside = (times_s >= self.first_s) & (times_s <= self.last_s)
        rate, turning = self.course(np.clip(times_s, self.first_s, self.last_s))
        return np.where(inside, np.stack([rate**2, turning]), 0.0)

    def filtered(self, cutoff_hz: float, times_s: FloatArray) -> FloatArray:
        """The same behind the anti-alias filter."""
        end_s = max(self.last_s, float(times_s[-1]))
        if not isinstance(self.course, _Cycloid):
            grid_s, whole = _filtered(self, cutoff_hz, end_s)
            return np.stack([np.interp(times_s, grid_s, row) for row in whole])
        # Turns of a table differ in when they begin: their answers are one.
        # Rounded and without its start: the key of a cache that all turns of a recording share.
        law, lasts_s = self.course, math.ceil(end_s - self.first_s)
        grid_s, whole = _of_cycloid(round(law.duration_s, 6), round(abs(law.turn_rad), 6), cutoff_hz, lasts_s)
        squared, turning = (np.interp(times_s - law.start_s, grid_s, row) for row in whole)
        return np.stack([squared, math.copysign(1.0, law.turn_rad) * turning])


@lru_cache(maxsize=64)
def _of_cycloid(duration_s: float, turn_rad: float, cutoff_hz: float, lasts_s: int) -> tuple[FloatArray, FloatArray]:
    motion = Motion(_Cycloid(0.0, duration_s, turn_rad), 0.0, duration_s)
    return _filtered(motion, cutoff_hz, float(lasts_s))


def _filtered(motion: Motion, cutoff_hz: float, end_s: float) -> tuple[FloatArray, FloatArray]:
    """Times up to `end_s`, and what the filter makes of the forces then, shape (2, times)."""
    zeros, poles, gain = signal.ellip(ORDER, RIPPLE_DB, STOP_DB, 2.0 * np.pi * cutoff_hz, analog=True, output="zpk")
    # An elliptic filter of even order has its ripple at zero frequency too: brought to unit gain there.
    gain /= abs(gain * np.prod(-zeros) / np.prod(-poles))
    step_s = 1.0 / (_NODES_PER_CYCLE * cutoff_hz)
    grid = np.arange(motion.first_s, end_s + step_s, step_s)
    force = motion.forces(grid)
    whole = gain * force if len(zeros) == len(poles) else np.zeros(force.shape)
    # Parallel one-pole filters, each exact for a force that is straight between the nodes; poles come in pairs.
    for number in np.flatnonzero(poles.imag > 0.0):
        pole = poles[number]
        residue = gain * np.prod(pole - zeros) / np.prod(pole - np.delete(poles, number))
        kept = np.exp(pole * step_s)
        new = (kept - 1.0 - pole * step_s) / (pole**2 * step_s)
        old = (kept - 1.0) / pole - new
        answer = signal.lfilter([new, old], [1.0, -kept], force.astype(np.complex128))
        whole = whole + 2.0 * np.real(residue * answer)
    return grid, whole


def motion_of(course_rad: FloatArray, before: int, rate_hz: float) -> Motion:
    """The motion behind a mean course, `before` samples of which lie before the end of the mask."""
    times_s: FloatArray = np.asarray((np.arange(course_rad.size) - before + 0.5) / rate_hz)
    turn_rad = float(course_rad[-1] - course_rad[0])
    moved = np.flatnonzero(np.abs(np.diff(course_rad)) > 1e-6)
    first_s = float(times_s[moved[0]]) if moved.size else 0.0
    last_s = float(times_s[moved[-1] + 1]) if moved.size else 0.0

    def misfit(where: FloatArray) -> FloatArray:
        law = _Cycloid(where[0], max(where[1], 1.0 / rate_hz), turn_rad)
        return np.asarray(course_rad - course_rad[0] - law.angle(times_s))

    # Two times fitted to a hundred angles come out to a small part of a sample.
    fitted = optimize.least_squares(misfit, [first_s, max(last_s - first_s, 1.0 / rate_hz)], x_scale=1.0 / rate_hz)
    start_s, duration_s = (float(each) for each in fitted.x)
    if math.sqrt(float(np.mean(fitted.fun**2))) < _CYCLOID_RAD:
        return Motion(_Cycloid(start_s, duration_s, turn_rad), start_s, start_s + duration_s)
    spline = interpolate.CubicSpline(times_s, course_rad)

    def by_spline(at_s: FloatArray) -> FloatArray:
        return np.stack([spline(at_s, 1), spline(at_s, 2)])

    return Motion(by_spline, first_s, last_s)
