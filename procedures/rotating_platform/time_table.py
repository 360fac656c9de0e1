"""When the platform turns, and to where: the table a run is carried out by, from its first sample to its last."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.core.errors import LimitError
from rigctl.core.limits import RotationLimits
from rigctl.experiments.rotating_platform.observe.patterns import Pattern

HALF_TURN_DEG = 180.0
EARLY_S = 0.1
"""How much before its time a turn is to be over: the controller takes a while to say that it is."""


@dataclass(frozen=True)
class Motion:
    """The platform turns between two times of the run, to an angle."""

    start_s: float
    stop_s: float
    to_deg: float


@dataclass(frozen=True)
class TimeTable:
    """A run of `duration_s` that begins with the platform at `begin_deg`; times are from its beginning.

    The first motion may begin before the run, the last may end after it.
    """

    begin_deg: float
    motions: tuple[Motion, ...]
    duration_s: float

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """Where the platform rests, in turn."""
        return (self.begin_deg, *(motion.to_deg for motion in self.motions))

    def check(self, name: str, limits: RotationLimits) -> None:
        """`LimitError` when the stage called `name` cannot follow: angle, speed or acceleration."""
        theta_deg = self.begin_deg
        for to_deg in (theta_deg, *(motion.to_deg for motion in self.motions)):
            if not limits.angle_min_deg <= to_deg <= limits.angle_max_deg:
                raise LimitError(
                    f"{name}: the table turns to {to_deg:g} deg, outside {limits.angle_min_deg:g} .. "
                    f"{limits.angle_max_deg:g} deg; turn back and forth, or widen the limits if no cable minds"
                )
        for motion in self.motions:
            # Turns are over a little before their time, so they have less of it.
            _check_speed(name, limits, abs(motion.to_deg - theta_deg), motion.stop_s - motion.start_s - EARLY_S)
            theta_deg = motion.to_deg


def modulation(pattern: Pattern, periods: int, *, forward: bool = False) -> TimeTable:
    """Half turns after a pattern, back and forth between 0 and 180 deg or always `forward`."""
    duration_s = periods * pattern.period_s
    turns = [
        (k * pattern.period_s + turn.start_s, k * pattern.period_s + turn.stop_s, turn.to_sign)
        # From one period before: a turn of it may reach into the run.
        for k in range(-1, periods)
        for turn in pattern.turns
    ]
    within = [turn for turn in turns if turn[1] > 0.0 and turn[0] < duration_s]
    # Before a turn the platform stands where that turn does not go.
    first_sign = -within[0][2] if within else pattern.dwells[0].sign
    begin_deg = theta_deg = _stop_theta_deg(first_sign)
    motions = []
    for start_s, stop_s, sign in within:
        # Always the same direction: the angle goes on beyond 180 deg, as far as cables allow.
        theta_deg = theta_deg + HALF_TURN_DEG if forward else _stop_theta_deg(sign)
        motions.append(Motion(start_s, stop_s, theta_deg))
    return TimeTable(begin_deg, tuple(motions), duration_s)


def scan(angles_deg: Sequence[float], dwell_s: float, turn_s: float) -> TimeTable:
    """One dwell at each angle in turn."""
    starts = (i * (dwell_s + turn_s) + dwell_s for i in itertools.count())
    motions = tuple(Motion(at, at + turn_s, to_deg) for at, to_deg in zip(starts, angles_deg[1:], strict=False))
    return TimeTable(angles_deg[0], motions, len(angles_deg) * (dwell_s + turn_s) - turn_s)


def rest(duration_s: float) -> TimeTable:
    """The platform stays at 0."""
    return TimeTable(0.0, (), duration_s)


def _stop_theta_deg(sign: int) -> float:
    return 0.0 if sign > 0 else HALF_TURN_DEG


def shortest_turn_s(limits: RotationLimits, distance_deg: float) -> float:
    """What a cycloid takes at least: its peaks are twice the mean speed, and 2 pi distances by the square of time."""
    return max(
        2.0 * distance_deg / limits.speed_deg_s, math.sqrt(2.0 * math.pi * distance_deg / limits.acceleration_deg_s2)
    )


def _check_speed(name: str, limits: RotationLimits, distance_deg: float, duration_s: float) -> None:
    shortest_s = shortest_turn_s(limits, distance_deg)
    if duration_s < shortest_s:
        raise LimitError(
            f"{name}: {distance_deg:g} deg within {duration_s:.3g} s; {limits.speed_deg_s:g} deg/s and "
            f"{limits.acceleration_deg_s2:g} deg/s2 allow {shortest_s:.3g} s: longer rotation_s, or wider limits"
        )
