"""The platform's motion about a turn, from its mean recorded angle: the law that motion controllers turn by where it
is one of them, else a spline.

Behind the anti-alias filter a motion is a sum over the filter's poles p of the integrals of exp(p (t - s)) times what
acts at s. Cycloids are waves and splines polynomials: both integrals are known in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial
from scipy import interpolate, optimize

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

# Its zeros and poles above the real axis for a pass band up to 1 rad/s. `scipy.signal.ellip` gives them, whose import
# takes as long as all else that a comparison imports; the tests of motions have it.
_ZEROS = 1j * np.array([6.114739582663424, 2.2542450507067158, 1.6068871134245313, 1.422294322969245])
_POLES = np.array(
    [
        -0.3790654392365567 + 0.2554466308634472j,
        -0.2697216407994763 + 0.6749486270479467j,
        -0.1425268647692632 + 0.92014053914743j,
        -0.04268647955478023 + 1.0233323621050203j,
    ]
)


@dataclass(frozen=True)
class _Cycloid:
    """Square of the angular rate and angular acceleration of theta = D (u - sin(2 pi u) / (2 pi)); all (turns,).

    What acts has the shape (kinds, turns, times), its integrals of exp(pole (t - s)) over all s up to t one more,
    (poles, kinds, turns, times); times are given for each turn. The same of `_Pieces`.
    """

    start_s: FloatArray
    duration_s: FloatArray
    turn_rad: FloatArray

    @property
    def form(self) -> tuple[str, int]:
        """What can be stacked has the same."""
        return "cycloid", 0

    @classmethod
    def stacked(cls, several: Sequence[_Cycloid]) -> _Cycloid:
        """One behind the other."""
        names = "start_s", "duration_s", "turn_rad"
        return cls(*(np.concatenate([getattr(each, name) for each in several]) for name in names))

    def __call__(self, times_s: FloatArray) -> FloatArray:
        since_s = times_s - self.start_s[:, None]
        phase = 2.0 * np.pi * np.clip(since_s / self.duration_s[:, None], 0.0, 1.0)
        rate = self.turn_rad / self.duration_s
        turning = (2.0 * np.pi * rate / self.duration_s)[:, None] * np.sin(phase)
        return np.stack([(rate[:, None] * (1.0 - np.cos(phase))) ** 2, turning])

    def relaxed(self, poles: ComplexArray, times_s: FloatArray) -> ComplexArray:
        """Wave by wave: rate^2 has the harmonics 0 to 2 of the turn, the acceleration the first."""
        rate = (self.turn_rad / self.duration_s)[:, None]
        # (1 - cos)^2 = 3/2 - 2 cos + cos(2 .) / 2, written as waves.
        squared = rate**2 * np.array([0.25, -1.0, 1.5, -1.0, 0.25])
        turning = 2.0 * np.pi * rate / self.duration_s[:, None] * np.array([0.0, 0.5j, 0.0, -0.5j, 0.0])
        rates = 2j * np.pi / self.duration_s[:, None] * np.arange(-_HARMONICS, _HARMONICS + 1)
        inside_s = np.clip(times_s - self.start_s[:, None], 0.0, self.duration_s[:, None])
        after_s = np.maximum(times_s - (self.start_s + self.duration_s)[:, None], 0.0)
        each = poles[:, None, None, None]
        sizes = np.stack([squared, turning]) / (rates - each)
        waves = (sizes[:, :, :, None] @ np.exp(rates[:, :, None] * inside_s[:, None]))[:, :, :, 0]
        own = sizes.sum(axis=3, keepdims=True) * np.exp(each * inside_s)
        return np.asarray((waves - own) * np.exp(each * after_s))


class _Pieces:
    """Polynomials between even nodes: `nodes_s` (turns, pieces + 1), `powers` (5, kinds, turns, pieces) of the time
    since the node; `before` (kinds, turns) is what acted before the first, nothing does after the last."""

    def __init__(self, nodes_s: FloatArray, powers: FloatArray, before: FloatArray) -> None:
        self._nodes_s, self._powers, self._before = nodes_s, powers, before
        self._step_s = (nodes_s[:, -1] - nodes_s[:, 0]) / powers.shape[3]

    @property
    def form(self) -> tuple[str, int]:
        """What can be stacked has the same."""
        return "pieces", self._powers.shape[3]

    @classmethod
    def stacked(cls, several: Sequence[_Pieces]) -> _Pieces:
        """One behind the other."""
        return cls(
            np.concatenate([each._nodes_s for each in several]),
            np.concatenate([each._powers for each in several], axis=2),
            np.concatenate([each._before for each in several], axis=1),
        )

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
        return cls(nodes_s[None, first : last + 1], powers[:, :, None], np.zeros((2, 1)))

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
        return cls(nodes_s[None], np.array(powers)[:, :, None], np.zeros((2, 1)))

    @classmethod
    def tilts(cls, nodes_s: FloatArray, to_go_rad: FloatArray) -> _Pieces:
        """Cosine less 1 and sine of the angle `to_go_rad` from the stop at the end."""
        shapes = np.stack([np.cos(to_go_rad) - 1.0, np.sin(to_go_rad)], axis=1)
        cubics = interpolate.CubicSpline(nodes_s, shapes).c[::-1].transpose(0, 2, 1)
        powers = np.concatenate([cubics, np.zeros((1, *cubics.shape[1:]))])
        return cls(nodes_s[None], powers[:, :, None], shapes[0][:, None])

    def __call__(self, times_s: FloatArray) -> FloatArray:
        piece, since_s = self._place(times_s)
        powers = np.take_along_axis(self._powers, piece[None, None], axis=3)
        found = powers[4]
        for power in powers[3::-1]:
            found = found * since_s + power
        found = np.where(times_s < self._nodes_s[:, -1:], found, 0.0)
        return np.where(times_s < self._nodes_s[:, :1], self._before[:, :, None], found)

    def relaxed(self, poles: ComplexArray, times_s: FloatArray) -> ComplexArray:
        """Piece by piece: what was there at its node fades, and a polynomial comes in."""
        came = np.einsum("katn,kpt->patn", self._powers, _relaxed_powers(poles, self._step_s))
        kept = np.exp(poles[:, None] * self._step_s)[:, None]
        settled = -self._before / poles[:, None, None]
        at_nodes = np.zeros((*settled.shape, self._nodes_s.shape[1]), dtype=np.complex128)
        at_nodes[..., 0] = settled
        for number in range(came.shape[3]):
            at_nodes[..., number + 1] = kept * at_nodes[..., number] + came[..., number]
        piece, since_s = self._place(times_s)
        last = times_s >= self._nodes_s[:, -1:]
        after_s = np.where(last, times_s - self._nodes_s[:, -1:], since_s)
        node = np.where(last, came.shape[3], piece)[None, None]
        found = np.take_along_axis(at_nodes, node, axis=3) * np.exp(poles[:, None, None] * after_s)[:, None]
        # Most times are after the turn, when nothing more comes in.
        within = np.flatnonzero(~last.all(axis=0))
        powers = np.take_along_axis(self._powers, piece[None, None, :, within], axis=3) * ~last[:, within]
        found[..., within] += np.einsum("katn,kptn->patn", powers, _relaxed_powers(poles, since_s[:, within]))
        return np.where(times_s <= self._nodes_s[:, :1], settled[..., None], found)

    def _place(self, times_s: FloatArray) -> tuple[Int64Array, FloatArray]:
        """In which piece a time is, and how long after its node."""
        first_s = self._nodes_s[:, :1]
        inside_s = np.clip(times_s, first_s, self._nodes_s[:, -1:])
        steps = np.floor((inside_s - first_s) / self._step_s[:, None]).astype(np.int64)
        piece = np.clip(steps, 0, self._powers.shape[3] - 1)
        return piece, inside_s - np.take_along_axis(self._nodes_s, piece, axis=1)


def _relaxed_powers(poles: ComplexArray, since_s: FloatArray) -> ComplexArray:
    """Integrals of exp(pole (t - s)) s^k over s from 0 to t, k = 0 to 4; shape (5, poles, ...) for times (...)."""
    each = poles.reshape(-1, *(1,) * since_s.ndim)
    found = [(np.exp(each * since_s) - 1.0) / each]
    for k in range(1, 5):
        found.append((k * found[-1] - since_s**k) / each)
    return np.asarray(np.stack(found))


@dataclass(frozen=True)
class Motions:
    """Turns of one law between `first_s` and `last_s` (turns,), times from the end of their masks: what acts on a
    sensor off the axis, and how the tilts turn away; `of_a_law` where beginning and end are known to better than a
    sample. All are asked for the same times (times,)."""

    course: _Cycloid | _Pieces
    tilting: _Pieces
    first_s: FloatArray
    last_s: FloatArray
    of_a_law: bool

    @property
    def form(self) -> tuple[bool, tuple[str, int], tuple[str, int]]:
        """What can be stacked has the same."""
        return self.of_a_law, self.course.form, self.tilting.form

    @classmethod
    def stacked(cls, several: Sequence[Motions]) -> Motions:
        """Motions of one form, one behind the other."""
        cycloids = [each.course for each in several if isinstance(each.course, _Cycloid)]
        pieces = [each.course for each in several if isinstance(each.course, _Pieces)]
        return cls(
            _Cycloid.stacked(cycloids) if cycloids else _Pieces.stacked(pieces),
            _Pieces.stacked([each.tilting for each in several]),
            np.concatenate([each.first_s for each in several]),
            np.concatenate([each.last_s for each in several]),
            several[0].of_a_law,
        )

    def forces(self, times_s: FloatArray) -> FloatArray:
        """Square of the angular rate and angular acceleration, shape (2, turns, times)."""
        first_s, last_s = self.first_s[:, None], self.last_s[:, None]
        # A spline goes on beyond its ends; the platform is at rest there.
        inside = (times_s >= first_s) & (times_s <= last_s)
        return np.where(inside, self.course(np.clip(times_s, first_s, last_s)), 0.0)

    def tilts(self, times_s: FloatArray) -> FloatArray:
        """By how much cosine and sine of the angle differ from those at the stop at the end, (2, turns, times)."""
        return self.tilting(self._of_each(times_s))

    def _of_each(self, times_s: FloatArray) -> FloatArray:
        return np.broadcast_to(times_s, (self.first_s.size, times_s.size))

    def late(self, delay_s: float, times_s: FloatArray) -> FloatArray:
        """The forces of the same motion `delay_s` later, and by how much cosine and sine of the angle, from the stop
        at the end, are then off; shape (4, turns, times)."""
        later_s = times_s - delay_s
        return np.concatenate([self.forces(later_s), self.tilts(later_s) - self.tilts(times_s)])

    def filtered(self, cutoff_hz: float, times_s: FloatArray) -> FloatArray:
        """The same behind the anti-alias filter."""
        poles, residues, direct = _anti_alias()
        # A filter of another cut-off is the same one in another unit of time.
        rate = 2.0 * np.pi * cutoff_hz
        each = [course.relaxed(rate * poles, self._of_each(times_s)) for course in (self.course, self.tilting)]
        through = np.tensordot(rate * residues, np.concatenate(each, axis=1), axes=1)
        tilts = self.tilts(times_s)
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
    zeros, poles = (np.concatenate([each, each.conj()]) for each in (_ZEROS, _POLES))
    # An elliptic filter of even order has its ripple at zero frequency too: brought to unit gain there.
    gain = float(abs(np.prod(poles) / np.prod(zeros)))
    residues = [gain * np.prod(pole - zeros) / np.prod(pole - poles[poles != pole]) for pole in _POLES]
    return _POLES, np.array(residues), gain


def _cycloid(u: FloatArray) -> FloatArray:
    return np.asarray(u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))


def motion_of(course_rad: FloatArray, before: int, rate_hz: float) -> Motions:
    """The one motion behind a mean course, `before` samples of which lie before the end of the mask."""
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
            of_forces = (
                _Pieces.polynomial(nodes_s, turn_rad)
                if law is _POLYNOMIAL
                else _Cycloid(np.array([start_s]), np.array([duration_s]), np.array([turn_rad]))
            )
            ends_s = np.array([start_s]), np.array([start_s + duration_s])
            return Motions(of_forces, _Pieces.tilts(nodes_s, course - turn_rad), *ends_s, True)
    inside = slice(first, last + 1)
    return Motions(
        _Pieces.forces(times_s, course_rad, first, last),
        _Pieces.tilts(times_s[inside], course_rad[inside] - course_rad[-1]),
        times_s[first : first + 1] if moved.size else np.zeros(1),
        times_s[last : last + 1] if moved.size else np.zeros(1),
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
