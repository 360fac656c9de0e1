"""The platform's motion about a turn, from its mean recorded angle: the law that motion controllers turn by where it
is one of them, else a spline.

Behind the anti-alias filter a motion is a sum over the filter's poles p of the integrals of exp(p (t - s)) times what
acts at s. Cycloids are waves and splines polynomials: both integrals are known in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from numpy.polynomial import Polynomial
from scipy import interpolate, optimize, signal

from rigctl.core.arrays import ComplexArray, FloatArray, Int64Array

# A hundredth of a degree: a platform that is farther off, rms over its turn, follows another law.
_OF_A_LAW_RAD = 2e-4
_STILL_RAD = 1e-6
_HARMONICS = 2
_PIECES = 48
"""Of a law's course: a cubic on each is good to a part in a million."""

_POLYNOMIAL = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
"""The 3-4-5 polynomial, of the least jerk between two stops."""

ORDER, RIPPLE_DB, STOP_DB = 8, 0.1, 80.0
"""The anti-alias filter: elliptic."""


class _Course(Protocol):
    """What acts during a turn, shape (kinds, times)."""

    def __call__(self, times_s: FloatArray) -> FloatArray:
        """While it lasts."""

    def relaxed(self, poles: ComplexArray, times_s: FloatArray) -> ComplexArray:
        """The integrals of exp(pole (t - s)) times each over all s up to t, shape (poles, kinds, times)."""


@dataclass(frozen=True)
class _Cycloid:
    """Square of the angular rate and angular acceleration of theta = D (u - sin(2 pi u) / (2 pi))."""

    start_s: float
    duration_s: float
    turn_rad: float

    def __call__(self, times_s: FloatArray) -> FloatArray:
        phase = 2.0 * np.pi * np.clip((times_s - self.start_s) / self.duration_s, 0.0, 1.0)
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


class _Pieces:
    """Polynomials between even nodes, `powers` (5, kinds, pieces) of the time since the node; `before` (kinds,) is
    what acted before the first, nothing does after the last."""

    def __init__(self, nodes_s: FloatArray, powers: FloatArray, before: FloatArray) -> None:
        self._nodes_s, self._powers, self._before = nodes_s, powers, before

    @classmethod
    def forces(cls, nodes_s: FloatArray, course_rad: FloatArray, first: int, last: int) -> _Pieces:
        """Square of the angular rate and angular acceleration of a cubic spline, between two of its nodes."""
        cubic, square, rate, _ = interpolate.CubicSpline(nodes_s, course_rad).c[:, first:last]
        zero = np.zeros_like(rate)
        powers = np.array(
            [
                [rate**2, 2.0 * square],
                [4.0 * rate * square, 6.0 * cubic],
                [4.0 * square**2 + 6.0 * rate * cubic, zero],
                [12.0 * square * cubic, zero],
                [9.0 * cubic**2, zero],
            ]
        )
        return cls(nodes_s[first : last + 1], powers, np.zeros(2))

    @classmethod
    def polynomial(cls, nodes_s: FloatArray, turn_rad: float) -> _Pieces:
        """The same of a turn by `_POLYNOMIAL` from the first node to the last, by its derivatives at each node."""
        pieces, duration_s = len(nodes_s) - 1, float(nodes_s[-1] - nodes_s[0])
        at = np.arange(pieces) / pieces
        shapes = (turn_rad / duration_s * _POLYNOMIAL.deriv()) ** 2, turn_rad / duration_s**2 * _POLYNOMIAL.deriv(2)
        powers = [
            [(shape.deriv(k) if k else shape)(at) / (math.factorial(k) * duration_s**k) for shape in shapes]
            for k in range(5)
        ]
        return cls(nodes_s, np.array(powers), np.zeros(2))

    @classmethod
    def tilts(cls, nodes_s: FloatArray, to_go_rad: FloatArray) -> _Pieces:
        """Cosine less 1 and sine of the angle `to_go_rad` from the stop at the end."""
        shapes = np.stack([np.cos(to_go_rad) - 1.0, np.sin(to_go_rad)], axis=1)
        cubics = interpolate.CubicSpline(nodes_s, shapes).c[::-1].transpose(0, 2, 1)
        return cls(nodes_s, np.concatenate([cubics, np.zeros((1, *cubics.shape[1:]))]), shapes[0])

    def __call__(self, times_s: FloatArray) -> FloatArray:
        piece, since_s = self._place(times_s)
        found = (self._powers[:, :, piece] * since_s ** np.arange(5)[:, None, None]).sum(axis=0)
        found[:, times_s >= self._nodes_s[-1]] = 0.0
        return np.where(times_s < self._nodes_s[0], self._before[:, None], found)

    def relaxed(self, poles: ComplexArray, times_s: FloatArray) -> ComplexArray:
        """Piece by piece: what was there at its node fades, and a polynomial comes in."""
        step_s = float(self._nodes_s[1] - self._nodes_s[0])
        came = np.einsum("kap,kn->nap", self._powers, _relaxed_powers(poles, np.array([step_s]))[:, :, 0])
        settled = -self._before / poles[:, None]
        at_nodes = np.zeros((*settled.shape, len(self._nodes_s)), dtype=np.complex128)
        at_nodes[:, :, 0] = settled
        for number, kept in enumerate(np.exp(poles * step_s).tolist()):
            faded = kept * settled[number][:, None]
            at_nodes[number, :, 1:] = signal.lfilter([1.0], [1.0, -kept], came[number], zi=faded)[0]
        piece, since_s = self._place(times_s)
        last = times_s >= self._nodes_s[-1]
        after_s = np.where(last, times_s - self._nodes_s[-1], since_s)
        found = (
            at_nodes[:, :, np.where(last, len(self._nodes_s) - 1, piece)] * np.exp(np.outer(poles, after_s))[:, None]
        )
        within = np.flatnonzero(~last)
        came_in = _relaxed_powers(poles, since_s[within])
        found[:, :, within] += np.einsum("kat,knt->nat", self._powers[:, :, piece[within]], came_in)
        return np.where(times_s <= self._nodes_s[0], settled[:, :, None], found)

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
    """A turn between `first_s` and `last_s`, times from the end of its mask: what acts on a sensor off the axis, and
    how the tilts turn away; `of_a_law` where its beginning and end are known to better than a sample."""

    course: _Course
    tilting: _Course
    first_s: float
    last_s: float
    of_a_law: bool

    def forces(self, times_s: FloatArray) -> FloatArray:
        """Square of the angular rate and angular acceleration, shape (2, times)."""
        # A spline goes on beyond its ends; the platform is at rest there.
        inside = (times_s >= self.first_s) & (times_s <= self.last_s)
        return np.where(inside, self.course(np.clip(times_s, self.first_s, self.last_s)), 0.0)

    def late(self, delay_s: float, times_s: FloatArray) -> FloatArray:
        """The forces of the same motion `delay_s` later, and by how much cosine and sine of the angle, from the stop
        at the end, are then off; shape (4, times)."""
        later_s = times_s - delay_s
        return np.concatenate([self.forces(later_s), self.tilting(later_s) - self.tilting(times_s)])

    def filtered(self, cutoff_hz: float, times_s: FloatArray) -> FloatArray:
        """The same behind the anti-alias filter."""
        poles, residues, direct = _anti_alias()
        # A filter of another cut-off is the same one in another unit of time.
        rate = 2.0 * np.pi * cutoff_hz
        each = [course.relaxed(rate * poles, times_s) for course in (self.course, self.tilting)]
        through = np.tensordot(rate * residues, np.concatenate(each, axis=1), axes=1)
        tilts = self.tilting(times_s)
        found = direct * np.concatenate([self.forces(times_s), tilts]) + 2.0 * through.real
        found[2:] -= tilts
        return np.asarray(found)


def filter_delay_s(cutoff_hz: float) -> float:
    """By how much the anti-alias filter delays what varies slowly: the slope of its phase at zero frequency."""
    poles, _, _ = _anti_alias()
    # Its zeros come in pairs on the imaginary axis, whose slopes cancel; of each pair of poles here is one.
    return float(2.0 * np.sum(np.real(-1.0 / poles))) / (2.0 * math.pi * cutoff_hz)


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


def _cycloid(u: FloatArray) -> FloatArray:
    return np.asarray(u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))


def motion_of(course_rad: FloatArray, before: int, rate_hz: float) -> Motion:
    """The motion behind a mean course, `before` samples of which lie before the end of the mask."""
    times_s: FloatArray = np.asarray((np.arange(course_rad.size) - before + 0.5) / rate_hz)
    steps = np.abs(np.diff(course_rad))
    # The platform rests at the end of what is looked at: what changes there is the encoder's noise.
    resting = steps[before + (steps.size - before) // 2 :]
    moved = np.flatnonzero(steps > max(_STILL_RAD, 5.0 * float(np.median(resting)) if resting.size else 0.0))
    first, last = (int(moved[0]), int(moved[-1]) + 1) if moved.size else (0, 1)
    turn_rad = float(course_rad[-1] - course_rad[0])
    for law in (_cycloid, _POLYNOMIAL):
        start_s, duration_s, off_rad = _placed(
            law, course_rad, times_s, (float(times_s[first]), float(times_s[last]))
        )
        if off_rad < _OF_A_LAW_RAD:
            nodes_s: FloatArray = start_s + duration_s * np.arange(_PIECES + 1) / _PIECES
            course = turn_rad * law((nodes_s - start_s) / duration_s)
            of_forces: _Course = _Cycloid(start_s, duration_s, turn_rad)
            if law is _POLYNOMIAL:
                of_forces = _Pieces.polynomial(nodes_s, turn_rad)
            return Motion(of_forces, _Pieces.tilts(nodes_s, course - turn_rad), start_s, start_s + duration_s, True)
    inside = slice(first, last + 1)
    return Motion(
        _Pieces.forces(times_s, course_rad, first, last),
        _Pieces.tilts(times_s[inside], course_rad[inside] - course_rad[-1]),
        float(times_s[first]) if moved.size else 0.0,
        float(times_s[last]) if moved.size else 0.0,
        False,
    )


def _placed(
    law: Callable[[FloatArray], FloatArray], course_rad: FloatArray, times_s: FloatArray, ends_s: tuple[float, float]
) -> tuple[float, float, float]:
    """Start and duration of a law that fits a course, and how far off it is, rms [rad]."""
    step_s = float(times_s[1] - times_s[0])
    turn_rad = float(course_rad[-1] - course_rad[0])

    def misfit(where: FloatArray) -> FloatArray:
        done = np.clip((times_s - where[0]) / max(where[1], step_s), 0.0, 1.0)
        return np.asarray(course_rad - course_rad[0] - turn_rad * law(done))

    # Two times fitted to a hundred angles come out to a small part of a sample.
    fitted = optimize.least_squares(misfit, [ends_s[0], max(ends_s[1] - ends_s[0], step_s)], x_scale=step_s)
    start_s, duration_s = (float(each) for each in fitted.x)
    return start_s, max(duration_s, step_s), math.sqrt(float(np.mean(fitted.fun**2)))
