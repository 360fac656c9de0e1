"""How a simulated axis moves: piecewise constant acceleration, sinusoids, and cycloids.

An axis knows its motion for all times of the recent past and, until it is told otherwise, of the future, so
a world can be sampled at any instant. Units are the stage's own (deg or mm, per second).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from simulators.stretches import stretches

HISTORY_S = 120.0
"""How far back an axis remembers; longer than any sensor rings."""


class Segment(Protocol):
    """A stretch of motion that begins at `start_s`."""

    @property
    def start_s(self) -> float:
        """When it begins; -inf only for an axis at rest from the beginning of time."""
        ...

    def sample(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at the given times."""
        ...


@dataclass(frozen=True)
class Ballistic:
    """Constant acceleration."""

    start_s: float
    position: float
    velocity: float = 0.0
    acceleration: float = 0.0

    def sample(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at the given times."""
        # At rest since ever: infinite time by zero velocity would be NaN.
        if math.isinf(self.start_s):
            return np.full_like(times_s, self.position), np.zeros_like(times_s), np.zeros_like(times_s)
        dt = times_s - self.start_s
        return (
            self.position + dt * (self.velocity + 0.5 * self.acceleration * dt),
            self.velocity + self.acceleration * dt,
            np.full_like(dt, self.acceleration),
        )

    def at(self, at_s: float) -> tuple[float, float, float]:
        """Position, velocity and acceleration at one instant, as `sample` gives them."""
        if math.isinf(self.start_s):
            return self.position, 0.0, 0.0
        dt = at_s - self.start_s
        return (
            self.position + dt * (self.velocity + 0.5 * self.acceleration * dt),
            self.velocity + self.acceleration * dt,
            self.acceleration,
        )


@dataclass(frozen=True)
class Sinusoid:
    """A raised cosine from rest: position + sum_h amplitude_h (1 - cos(h w t)).

    `amplitudes[0]` belongs to the fundamental and is signed: the axis sets out towards its sign.
    """

    start_s: float
    position: float
    frequency_hz: float
    amplitudes: tuple[float, ...]

    def sample(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at the given times."""
        dt = times_s - self.start_s
        position = np.full_like(dt, self.position)
        velocity = np.zeros_like(dt)
        acceleration = np.zeros_like(dt)
        for order, amplitude in enumerate(self.amplitudes, start=1):
            w = 2.0 * math.pi * self.frequency_hz * order
            cos, sin = np.cos(w * dt), np.sin(w * dt)
            position += amplitude * (1.0 - cos)
            velocity += amplitude * w * sin
            acceleration += amplitude * w * w * cos
        return position, velocity, acceleration


@dataclass(frozen=True)
class Cycloid:
    """From rest to rest: position + displacement (u - sin(2 pi u) / 2 pi), u from 0 to 1 in `duration_s`."""

    start_s: float
    position: float
    displacement: float
    duration_s: float

    def sample(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at the given times."""
        turn = 2.0 * math.pi * np.clip((times_s - self.start_s) / self.duration_s, 0.0, 1.0)
        speed = self.displacement / self.duration_s
        return (
            self.position + self.displacement * (turn - np.sin(turn)) / (2.0 * math.pi),
            speed * (1.0 - np.cos(turn)),
            2.0 * math.pi * speed / self.duration_s * np.sin(turn),
        )


@dataclass(frozen=True)
class Stop:
    """The end of a motion: when that began, which in the axis's life, and from which side (+1, -1; 0: none yet)."""

    began_s: float
    start_s: float
    number: int
    direction: float
    position: float


class MotionAxis:
    """One axis of motion; commands take effect at the time given, which never runs backwards."""

    def __init__(self, position: float = 0.0, history_s: float = HISTORY_S) -> None:
        self._history_s = history_s
        self._segments: list[Segment] = [Ballistic(-math.inf, position)]
        self._stops = [Stop(-math.inf, -math.inf, 0, 0.0, position)]
        self._end_s = -math.inf
        self._forgotten_direction = 0.0

    def sample(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration, each of the shape of `times_s`."""
        times_s = np.asarray(times_s, dtype=np.float64)
        index = self._segment_index(times_s)
        # Mostly all times lie in one segment.
        if times_s.size and index.min() == index.max():
            return self._segments[int(index.flat[0])].sample(times_s)
        out = np.empty((3, *times_s.shape))
        for i, chosen in stretches(index):
            out[:, chosen] = self._segments[i].sample(times_s[chosen])
        return out[0], out[1], out[2]

    def position(self, at_s: float) -> float:
        """Position at one instant."""
        return self._state(at_s)[0]

    def velocity(self, at_s: float) -> float:
        """Velocity at one instant."""
        return self._state(at_s)[1]

    def acceleration(self, at_s: float) -> float:
        """Acceleration at one instant."""
        return self._state(at_s)[2]

    def directions(self, times_s: FloatArray) -> FloatArray:
        """Sign of the last non-zero velocity up to each time: +1, -1, or 0 for an axis that never moved."""
        times_s = np.asarray(times_s, dtype=np.float64)
        before = [self._forgotten_direction]
        for segment, following in itertools.pairwise(self._segments):
            # A segment at rest keeps the direction it was reached in.
            before.append(_last_direction(segment, following.start_s) or before[-1])
        velocity = self.sample(times_s)[1]
        return np.where(velocity == 0.0, np.array(before)[self._segment_index(times_s)], np.sign(velocity))

    def stops(self, times_s: FloatArray) -> tuple[list[Stop], IntArray]:
        """The stops remembered, in order, and which of them was the last one before each time."""
        return self._stops, np.searchsorted([stop.start_s for stop in self._stops[1:]], times_s, side="right")

    def moving(self, at_s: float) -> bool:
        """True while the commanded motion has not ended."""
        return at_s < self._end_s

    @property
    def end_s(self) -> float:
        """When the commanded motion ends; inf for an endless one, in the past at rest."""
        return self._end_s

    def move_to(self, at_s: float, target: float, speed: float, acceleration: float) -> float:
        """A trapezoidal move from where the axis stands; returns its end."""
        start = self.position(at_s)
        distance = target - start
        if distance == 0.0:
            self._command(at_s, [Ballistic(at_s, start)], at_s)
            return at_s
        sign = math.copysign(1.0, distance)
        # A short move never reaches its speed: it is a triangle.
        peak = min(speed, math.sqrt(abs(distance) * acceleration))
        ramp_s = peak / acceleration
        cruise_s = abs(distance) / peak - ramp_s
        ramp = sign * 0.5 * acceleration * ramp_s**2
        t1, t2, t3 = at_s + ramp_s, at_s + ramp_s + cruise_s, at_s + 2 * ramp_s + cruise_s
        self._command(
            at_s,
            [
                Ballistic(at_s, start, 0.0, sign * acceleration),
                Ballistic(t1, start + ramp, sign * peak, 0.0),
                Ballistic(t2, target - ramp, sign * peak, -sign * acceleration),
                Ballistic(t3, target),
            ],
            t3,
        )
        return t3

    def turn_to(self, at_s: float, target: float, duration_s: float) -> float:
        """A cycloid from where the axis stands; returns its end."""
        start = self.position(at_s)
        if target == start:
            self._command(at_s, [Ballistic(at_s, start)], at_s)
            return at_s
        end_s = at_s + duration_s
        self._command(at_s, [Cycloid(at_s, start, target - start, duration_s), Ballistic(end_s, target)], end_s)
        return end_s

    def jog(self, at_s: float, velocity: float, acceleration: float) -> None:
        """Go to a constant velocity and stay there."""
        position, now, _ = self._state(at_s)
        if velocity == now:
            self._command(at_s, [Ballistic(at_s, position, velocity)], math.inf)
            return
        sign = math.copysign(1.0, velocity - now)
        ramp_s = abs(velocity - now) / acceleration
        reached = position + now * ramp_s + 0.5 * sign * acceleration * ramp_s**2
        self._command(
            at_s,
            [
                Ballistic(at_s, position, now, sign * acceleration),
                Ballistic(at_s + ramp_s, reached, velocity),
            ],
            math.inf,
        )

    def oscillate(self, at_s: float, frequency_hz: float, amplitudes: Sequence[float], cycles: float) -> float:
        """A sinusoid from rest for a whole number of cycles (inf: until told otherwise); returns its end."""
        position = self.position(at_s)
        end_s = at_s + cycles / frequency_hz
        segments: list[Segment] = [Sinusoid(at_s, position, frequency_hz, tuple(amplitudes))]
        if math.isfinite(end_s):
            segments.append(Ballistic(end_s, position))
        self._command(at_s, segments, end_s)
        return end_s

    def halt(self, at_s: float, deceleration: float) -> float:
        """Brake to rest; returns when it stands."""
        position, velocity, _ = self._state(at_s)
        brake_s = abs(velocity) / deceleration
        rest = position + 0.5 * velocity * brake_s
        braking = Ballistic(at_s, position, velocity, -math.copysign(deceleration, velocity))
        end_s = at_s + brake_s
        self._command(at_s, [braking, Ballistic(end_s, rest)], end_s)
        return end_s

    def place(self, at_s: float, position: float) -> None:
        """Be somewhere at once: the start of a simulation, or a reference found."""
        self._command(at_s, [Ballistic(at_s, position)], at_s)

    def _state(self, at_s: float) -> tuple[float, float, float]:
        segment = next((s for s in reversed(self._segments) if s.start_s <= at_s), self._segments[0])
        if isinstance(segment, Ballistic):
            return segment.at(at_s)
        position, velocity, acceleration = segment.sample(np.array([at_s]))
        return float(position[0]), float(velocity[0]), float(acceleration[0])

    def _segment_index(self, times_s: FloatArray) -> IntArray:
        later_starts = [s.start_s for s in self._segments[1:]]
        return np.searchsorted(later_starts, times_s, side="right")

    def _command(self, at_s: float, segments: Sequence[Segment], end_s: float) -> None:
        kept = [s for s in self._segments if s.start_s < at_s]
        # The segment that was under way then is kept: a look that far back still finds it.
        while len(kept) > 1 and kept[1].start_s < at_s - self._history_s:
            forgotten = kept.pop(0)
            self._forgotten_direction = _last_direction(forgotten, kept[0].start_s) or self._forgotten_direction
        self._segments = [*kept, *segments]
        self._end_s = end_s
        self._note_stops(at_s, segments)

    def _note_stops(self, at_s: float, segments: Sequence[Segment]) -> None:
        kept = [stop for stop in self._stops if stop.start_s < at_s] or self._stops[:1]
        overtaken = self._stops[len(kept)] if len(kept) < len(self._stops) else None
        # A motion commanded before the last one has ended is counted from that one's beginning.
        began_s = overtaken.began_s if overtaken is not None else at_s
        while len(kept) > 1 and kept[1].start_s < at_s - self._history_s:
            kept.pop(0)
        for segment in segments:
            if isinstance(segment, Ballistic) and segment.velocity == segment.acceleration == 0.0:
                # A command that moves nothing makes no new stop: what stops draw must not depend on it.
                moved = segment.position - kept[-1].position
                if moved:
                    number, direction = kept[-1].number + 1, math.copysign(1.0, moved)
                    kept.append(Stop(began_s, segment.start_s, number, direction, segment.position))
        self._stops = kept


def _last_direction(segment: Segment, end_s: float) -> float:
    duration_s = end_s - segment.start_s
    if not math.isfinite(duration_s) or duration_s <= 0.0:
        return 0.0
    # A braking axis stands still at the very end of its segment: look just before.
    _, velocity, _ = segment.sample(np.array([end_s - 1e-3 * duration_s]))
    return float(np.sign(velocity[0]))
