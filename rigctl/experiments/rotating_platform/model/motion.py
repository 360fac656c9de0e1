"""The platform's motion about a turn, from its mean recorded angle: a cycloid where it is one, else a spline.

Behind the anti-alias filter a motion is a sum over the filter's poles p of the integrals of exp(p (t - s)) times the
force at s. Cycloids are waves and splines polynomials: both integrals are known in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from scipy import interpolate, optimize, signal

from rigctl.core.arrays import ComplexArray, FloatArray, Int64Array

# A hundredth of a degree: a platform that is farther off, rms over its turn, follows another law.
_CYCLOID_RAD = 2e-4
_HARMONICS = 2
ORDER, RIPPLE_DB, STOP_DB = 8, 0.1, 80.0
"""The anti-alias filter: elliptic."""


class _Course(Protocol):
    """A law of turning: square of the angular rate and angular acceleration, shape (2, times)."""

    def __call__(self, times_s: FloatArray) -> FloatArray:
        """While it lasts."""

    def relaxed(self, poles: ComplexArray, times_s: FloatArray) -> ComplexArray:
        """The integrals of exp(pole (t - s)) times both over all s up to t, shape (poles, 2, times)."""


@dataclass(frozen=True)
class _Cycloid:
    """theta = D (u - sin(2 pi u) / (2 pi))."""

    start_s: float
    duration_s: float
    turn_rad: float

    def __call__(self, times_s: FloatArray) -> FloatArray:
        phase = self._phase(times_s)
        rate = self.turn_rad / self.duration_s
        turning = 2.0 * np.pi * rate / self.duration_s * np.sin(phase)
        return np.stack([(rate * (1.0 - np.cos(phase))) ** 2, turning])

    def relaxed(self, poles: ComplexArray, times_s: FloatArray) -> ComplexArray:
        """Wave by wave: rate^2 has the harmonics 0 to 2 of the turn, the acceleration the first."""
        rate = self.turn_rad / self.duration_s
        # (1 - cos)^2 = 3/2 - 2 cos + cos(2 .) / 2, written as waves.
        squared = rate**2 * np.array([0.25, -1.0, 1.5, -1.0, 0.25])
        turning = 2.0 * np.pi * rate / self.duration_s * np.array([0.0, 0.5j, 0.0, -0.5j, 0.0])
        rates = 2j * np.pi / self.duration_s * np.arange(-_HARMONICS, _HARMONICS + 1)
        inside_s = np.clip(times_s - self.start_s, 0.0, self.duration_s)
        after_s = np.maximum(times_s - self.start_s - self.duration_s, 0.0)
        sizes = np.stack([squared, turning]) / (rates - poles[:, None, None])
        waves = sizes @ np.exp(np.outer(rates, inside_s))
        own = sizes.sum(axis=2)[:, :, None] * np.exp(np.outer(poles, inside_s))[:, None]
        return np.asarray((waves - own) * np.exp(np.outer(poles, after_s))[:, None])

    def angle(self, times_s: FloatArray) -> FloatArray:
        phase = self._phase(times_s)
        return np.asarray(self.turn_rad * (phase - np.sin(phase)) / (2.0 * np.pi))

    def _phase(self, times_s: FloatArray) -> FloatArray:
        return np.asarray(2.0 * np.pi * np.clip((times_s - self.start_s) / self.duration_s, 0.0, 1.0))


class _Spline:
    """A cubic spline of angles at even times, what moves being between the nodes `first` and `last`."""

    def __init__(self, times_s: FloatArray, course_rad: FloatArray, first: int, last: int) -> None:
        cubic, square, rate, _ = interpolate.CubicSpline(times_s, course_rad).c[:, first:last]
        zero = np.zeros_like(rate)
        self._nodes_s = times_s[first : last + 1]
        # Powers of the time since the node, shape (5, 2, pieces).
        self._powers = np.array(
            [
                [rate**2, 2.0 * square],
                [4.0 * rate * square, 6.0 * cubic],
                [4.0 * square**2 + 6.0 * rate * cubic, zero],
                [12.0 * square * cubic, zero],
                [9.0 * cubic**2, zero],
            ]
        )

    def __call__(self, times_s: FloatArray) -> FloatArray:
        piece, since_s = self._place(times_s)
        return np.asarray((self._powers[:, :, piece] * since_s ** np.arange(5)[:, None, None]).sum(axis=0))

    def relaxed(self, poles: ComplexArray, times_s: FloatArray) -> ComplexArray:
        """Piece by piece: what was there at its node fades, and a polynomial comes in."""
        step_s = float(self._nodes_s[1] - self._nodes_s[0])
        came = np.einsum("kap,kn->nap", self._powers, _relaxed_powers(poles, np.array([step_s]))[:, :, 0])
        at_nodes = np.zeros((len(poles), 2, len(self._nodes_s)), dtype=np.complex128)
        for number, kept in enumerate(np.exp(poles * step_s).tolist()):
            at_nodes[number, :, 1:] = signal.lfilter([1.0], [1.0, -kept], came[number])
        piece, since_s = self._place(times_s)
        last = times_s >= self._nodes_s[-1]
        after_s = np.where(last, times_s - self._nodes_s[-1], since_s)
        found = (
            at_nodes[:, :, np.where(last, len(self._nodes_s) - 1, piece)] * np.exp(np.outer(poles, after_s))[:, None]
        )
        within = np.flatnonzero(~last)
        came_in = _relaxed_powers(poles, since_s[within])
        found[:, :, within] += np.einsum("kat,knt->nat", self._powers[:, :, piece[within]], came_in)
        found[:, :, times_s <= self._nodes_s[0]] = 0.0
        return np.asarray(found)

    def _place(self, times_s: FloatArray) -> tuple[Int64Array, FloatArray]:
        """In which piece a time is, and how long after its node."""
        inside_s = np.clip(times_s, self._nodes_s[0], self._nodes_s[-1])
        before = np.searchsorted(self._nodes_s, inside_s, side="right") - 1
        piece = np.clip(before, 0, self._powers.shape[2] - 1).astype(np.int64)
        return piece, inside_s - self._nodes_s[piece]


def _relaxed_powers(poles: ComplexArray, since_s: FloatArray) -> ComplexArray:
    """Integrals of exp(pole (t - s)) s^k over s from 0 to t, k = 0 to 4; shape (5, poles, times)."""
    each = poles[:, None]
    found = [(np.exp(each * since_s) - 1.0) / each]
    for k in range(1, 5):
        found.append((k * found[-1] - since_s**k) / each)
    return np.asarray(np.stack(found))


@dataclass(frozen=True)
class Motion:
    """A turn between `first_s` and `last_s`, times from the end of its mask."""

    course: _Course
    first_s: float
    last_s: float

    @property
    def is_cycloid(self) -> bool:
        """Whether its beginning and end are known to better than a sample."""
        return isinstance(self.course, _Cycloid)

    def forces(self, times_s: FloatArray) -> FloatArray:
        """Square of the angular rate and angular acceleration, shape (2, times)."""
        # A spline goes on beyond its ends; the platform is at rest there.
        inside = (times_s >= self.first_s) & (times_s <= self.last_s)
        return np.where(inside, self.course(np.clip(times_s, self.first_s, self.last_s)), 0.0)

    def filtered(self, cutoff_hz: float, times_s: FloatArray) -> FloatArray:
        """The same behind the anti-alias filter."""
        poles, residues, direct = _anti_alias()
        # A filter of another cut-off is the same one in another unit of time.
        rate = 2.0 * np.pi * cutoff_hz
        through = np.tensordot(rate * residues, self.course.relaxed(rate * poles, times_s), axes=1)
        return np.asarray(direct * self.forces(times_s) + 2.0 * through.real)


@cache
def _anti_alias() -> tuple[ComplexArray, ComplexArray, float]:
    """The filter for a cut-off of 1 rad/s as one-pole filters side by side: one pole of each pair, its residue, and
    what passes at once."""
    zeros, poles, gain = signal.ellip(ORDER, RIPPLE_DB, STOP_DB, 1.0, analog=True, output="zpk")
    # An elliptic filter of even order has its ripple at zero frequency too: brought to unit gain there.
    gain /= abs(gain * np.prod(-zeros) / np.prod(-poles))
    upper = np.flatnonzero(poles.imag > 0.0)
    residues = [gain * np.prod(poles[n] - zeros) / np.prod(poles[n] - np.delete(poles, n)) for n in upper]
    return poles[upper], np.array(residues), float(gain) if len(zeros) == len(poles) else 0.0


def motion_of(course_rad: FloatArray, before: int, rate_hz: float) -> Motion:
    """The motion behind a mean course, `before` samples of which lie before the end of the mask."""
    times_s: FloatArray = np.asarray((np.arange(course_rad.size) - before + 0.5) / rate_hz)
    turn_rad = float(course_rad[-1] - course_rad[0])
    moved = np.flatnonzero(np.abs(np.diff(course_rad)) > 1e-6)
    first, last = (int(moved[0]), int(moved[-1]) + 1) if moved.size else (0, 1)
    first_s, last_s = (float(times_s[each]) if moved.size else 0.0 for each in (first, last))

    def misfit(where: FloatArray) -> FloatArray:
        law = _Cycloid(where[0], max(where[1], 1.0 / rate_hz), turn_rad)
        return np.asarray(course_rad - course_rad[0] - law.angle(times_s))

    # Two times fitted to a hundred angles come out to a small part of a sample.
    fitted = optimize.least_squares(misfit, [first_s, max(last_s - first_s, 1.0 / rate_hz)], x_scale=1.0 / rate_hz)
    start_s, duration_s = (float(each) for each in fitted.x)
    if math.sqrt(float(np.mean(fitted.fun**2))) < _CYCLOID_RAD:
        return Motion(_Cycloid(start_s, duration_s, turn_rad), start_s, start_s + duration_s)
    return Motion(_Spline(times_s, course_rad, first, last), first_s, last_s)
