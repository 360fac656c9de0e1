"""From the laboratory's acceleration to a reading: the chain on which the baseline and every effect act.

All cells of all runs of a recording are predicted at once, channel by channel: arrays have the shape (cells,).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from rigctl.core.arrays import FloatArray, Int64Array, IntArray
from rigctl.core.errors import ConfigError
from rigctl.experiments.rotating_platform.model.motion import Motions, filter_delay_s, motion_of
from rigctl.experiments.rotating_platform.observe.cells import BESIDE_S, Cells

REFERENCE_C = 22.0
"""Where the thermal bias is zero."""

# The longest look at a filter's ringing, however low its cut-off: cells beyond are long.
_RINGS_S = 12.0
_MOST_KEPT = 64


class Afterwards:
    """What turns leave behind in all cells, made once for each time or frequency: all models ask alike."""

    def __init__(self, cells: Sequence[Cells]) -> None:
        def kept(make: Callable[[float], FloatArray]) -> Callable[[float], FloatArray]:
            return lru_cache(_MOST_KEPT)(make)

        followed = _followed(cells)
        self.decay = kept(lambda time_s: np.concatenate([_decay(each, time_s) for each in cells]))
        self.late = kept(lambda delay_s: _about_turns(followed, cells, delay_s=delay_s))
        self.ringing = kept(lambda cutoff_hz: _about_turns(followed, cells, cutoff_hz=cutoff_hz))


class AfterMotion(NamedTuple):
    """What a motion leaves after its mask, shape (cells,) each: square of the angular rate [rad2/s2], angular
    acceleration [rad/s2], and what the tilts read more than at rest [m/s2]."""

    speed_squared: FloatArray
    turning: FloatArray
    tilts: FloatArray


@dataclass
class PlatformRuns:
    """What an effect may ask of the runs it acts on, in SI; `signal` is the value at its point of the chain so far.

    Arrays have the shape (cells,), NaN where unknown. `channel` is "z" (sensor A) or "y" (sensor B); `t` the time of
    the recording, `within` that from the middle of the run; `cos` and `sin` of the angle, `direction` that of the
    last turn (+1, -1; 0 before the first), `since` the time since it (infinite before), `turns` how many there were
    in the recorded runs so far and `turns_in_run` in the run, `speed_squared` and `turning` the square of the angular
    rate and the angular acceleration while it counts although the platform moves. `a_y` and `a_z` are the
    laboratory's accelerations, `c_y` and `c_z` what was commanded, `along` and `across` the acceleration along the
    sensing axis and at a right angle to it, `period` that of the modulation.
    """

    channel: str
    t: FloatArray
    within: FloatArray
    cos: FloatArray
    sin: FloatArray
    since: FloatArray
    turns: FloatArray
    turns_in_run: FloatArray
    direction: FloatArray
    speed_squared: FloatArray
    turning: FloatArray
    c_y: FloatArray
    c_z: FloatArray
    temperature: FloatArray
    period: FloatArray
    g: float
    cells: Sequence[Cells] = ()
    columns: Mapping[str, FloatArray] = field(default_factory=dict)
    a_y: FloatArray = field(default_factory=lambda: np.zeros(0))
    a_z: FloatArray = field(default_factory=lambda: np.zeros(0))
    along: FloatArray = field(default_factory=lambda: np.zeros(0))
    across: FloatArray = field(default_factory=lambda: np.zeros(0))
    signal: FloatArray = field(default_factory=lambda: np.zeros(0))
    afterwards: Afterwards | None = None
    kept: dict[str, tuple[float, AfterMotion]] = field(default_factory=dict, init=False)

    @property
    def warmer(self) -> FloatArray:
        """Temperature above `REFERENCE_C` [K]."""
        return self.temperature - REFERENCE_C

    def column(self, name: str) -> FloatArray:
        """A laboratory's own column of runs.csv or of the samples; `ConfigError` when the recording has none."""
        if name not in self.columns:
            known = ", ".join(sorted(self.columns)) or "none"
            raise ConfigError(f"no column '{name}' of numbers in runs.csv; columns beyond the format's own: {known}")
        return self.columns[name]

    def decay(self, time_s: float) -> FloatArray:
        """exp(-since / `time_s`), averaged over the samples of each cell."""
        if self.afterwards is None:
            return np.asarray(np.exp(-self.since / time_s))
        return self.afterwards.decay(time_s)

    def late(self, delay_s: float) -> AfterMotion:
        """What a motion that is `delay_s` later than the samples say leaves after its mask."""
        return self._once("late", delay_s, self._late)

    def ringing(self, cutoff_hz: float) -> AfterMotion:
        """What an elliptic filter with its pass band up to `cutoff_hz` leaves of a motion."""
        return self._once("ringing", cutoff_hz, self._ringing)

    def _once(self, what: str, value: float, make: Callable[[float], AfterMotion]) -> AfterMotion:
        """The last of a kind that was asked for: amplitudes are asked for one after the other."""
        # Without a recording a size may be an array, as a drawn signature's is.
        if self.afterwards is None:
            return make(value)
        # Of each kind by itself: a model of two kinds asks for both in turn.
        if what not in self.kept or self.kept[what][0] != value:
            self.kept[what] = value, make(value)
        return self.kept[what][1]

    def _late(self, delay_s: float) -> AfterMotion:
        return self._after_motion(None if self.afterwards is None else self.afterwards.late(delay_s))

    def _ringing(self, cutoff_hz: float) -> AfterMotion:
        left = self._after_motion(None if self.afterwards is None else self.afterwards.ringing(cutoff_hz))
        # A tilt that varies comes late at rest too.
        before_z, before_y = (-filter_delay_s(cutoff_hz) * self._rate(tilt) for tilt in (self.a_z, self.a_y))
        return left._replace(tilts=left.tilts + self._seen(before_z, before_y, self.cos, self.sin))

    def _after_motion(self, rows: FloatArray | None) -> AfterMotion:
        if rows is None:
            return AfterMotion(self.speed_squared, self.turning, 0.0 * self.turning)
        # Rows are told from the stop at the end of the turn, where the sine is nil.
        off_cos, off_sin = np.sign(self.cos) * rows[2:]
        return AfterMotion(rows[0], rows[1], self._seen(self.a_z, self.a_y, off_cos, off_sin))

    def _seen(self, z: FloatArray, y: FloatArray, cos: FloatArray, sin: FloatArray) -> FloatArray:
        """What this sensor reads of accelerations of the laboratory."""
        return np.asarray(z * cos - y * sin if self.channel == "z" else y * cos + z * sin)

    def _rate(self, values: FloatArray) -> FloatArray:
        """Derivatives by time within each run [1/s]."""
        ends = np.cumsum([each.period.size for each in self.cells])[:-1]
        pairs = zip(np.split(values, ends), np.split(self.within, ends), strict=True)
        return np.concatenate([np.gradient(v, t) if np.ptp(v) > 0.0 else np.zeros_like(v) for v, t in pairs])

    def at(self, **changes: Any) -> PlatformRuns:
        """The same runs at another point of the chain."""
        other = object.__new__(PlatformRuns)
        # Whatever the signal is, motions leave the same.
        kept = self.kept if changes.keys() == {"signal"} else {}
        other.__dict__.update(self.__dict__, kept=kept, **changes)
        return other


def turned(run: PlatformRuns, turned_by_rad: FloatArray | float) -> PlatformRuns:
    """With what acts along and across the sensing axis, the platform turned on by an angle."""
    # First order in the angle: stops are off by some 1e-5 rad.
    cos = run.cos - turned_by_rad * run.sin
    sin = run.sin + turned_by_rad * run.cos
    own_y, own_z = run.a_y * cos + run.a_z * sin, run.a_z * cos - run.a_y * sin
    along, across = (own_z, own_y) if run.channel == "z" else (own_y, own_z)
    return run.at(cos=cos, sin=sin, along=along, across=across)


def off_stop(cells: Cells) -> FloatArray:
    """Square of the angular rate and angular acceleration where samples count though the platform moves, (2, cells).

    After a turn they are those of the law behind the recorded angle; differences of angles are good to a per cent.
    """
    seen = cells.state[:, 3:5].T
    known = np.isin(cells.kind, list(_courses(cells))) & (cells.since_s < BESIDE_S)
    return np.where(seen.any(axis=0) & known, _about_turns(_followed([cells]), [cells])[:2], seen)


def _decay(cells: Cells, time_s: float) -> FloatArray:
    rate_hz, ends_s = cells.sample_rate_hz, _ends_s(cells)
    # Where a mask is too short the first samples are of the turn itself.
    first = np.maximum(cells.since, np.ceil(ends_s * rate_hz - 0.5).astype(np.int64))
    samples = np.maximum(cells.since + cells.count - first, 0.0)
    step = 1.0 / (rate_hz * time_s)
    # A geometric series over the samples, each taken half a step after its beginning.
    series = np.expm1(-step * samples) / np.expm1(-step) / cells.count
    with np.errstate(under="ignore"):
        return np.asarray(np.exp((ends_s - first / rate_hz) / time_s - 0.5 * step) * series)


def _ends_s(cells: Cells) -> FloatArray:
    """When each cell's last turn was over, from the end of its mask [s]; 0 where the angle does not tell."""
    ends_s = np.zeros(len(cells.followed))
    for number, course in _courses(cells).items():
        motion = _motion(course.tobytes(), cells.turn_before, cells.sample_rate_hz)
        ends_s[number] = motion.last_s[0] if motion.of_a_law else 0.0
    return np.asarray(ends_s[cells.kind])


@dataclass(frozen=True)
class _Followed:
    """Cells behind turns of one form that were sampled at one rate: their `rows` among all cells, which of the
    `motions` each follows (`turn`), samples `since` its end and of the cell (`count`)."""

    motions: Motions
    rate_hz: float
    rows: IntArray
    turn: IntArray
    since: Int64Array
    count: FloatArray


def _followed(cells: Sequence[Cells]) -> list[_Followed]:
    """All cells behind a turn, so that turns alike are worked out at once."""
    groups: dict[tuple[float, object], list[tuple[Motions, IntArray]]] = {}
    since = np.concatenate([each.since for each in cells])
    count = np.concatenate([each.count for each in cells])
    first = 0
    for each in cells:
        for number, course in _courses(each).items():
            motion = _motion(course.tobytes(), each.turn_before, each.sample_rate_hz)
            rows = first + np.flatnonzero(each.kind == number)
            groups.setdefault((each.sample_rate_hz, motion.form), []).append((motion, rows))
        first += each.since.size
    return [
        _Followed(
            Motions.stacked([motion for motion, _ in group]),
            rate_hz,
            rows := np.concatenate([each for _, each in group]),
            np.repeat(np.arange(len(group)), [each.size for _, each in group]),
            since[rows],
            count[rows],
        )
        for (rate_hz, _), group in groups.items()
    ]


def _about_turns(
    followed: Sequence[_Followed], cells: Sequence[Cells], delay_s: float = 0.0, cutoff_hz: float | None = None
) -> FloatArray:
    """Means over the cells of what the motion leaves after each turn, late or behind a filter; shape (4, cells)."""
    means = np.zeros((4, sum(each.since.size for each in cells)))
    lasts_s = BESIDE_S + delay_s if cutoff_hz is None else min(_RINGS_S, 60.0 / cutoff_hz)
    for each in followed:
        last = math.ceil(lasts_s * each.rate_hz)
        times_s: FloatArray = np.asarray((np.arange(last) + 0.5) / each.rate_hz)
        motions = each.motions
        values = motions.late(delay_s, times_s) if cutoff_hz is None else motions.filtered(cutoff_hz, times_s)
        # Running sums: the mean over any cell is one difference.
        sums = np.zeros((*values.shape[:2], last + 1))
        np.cumsum(values, axis=2, out=sums[:, :, 1:])
        near = np.flatnonzero(each.since < last)
        turn, since, count = each.turn[near], each.since[near], each.count[near]
        stop = np.minimum(since + count.astype(np.int64), last)
        means[:, each.rows[near]] = (sums[:, turn, stop] - sums[:, turn, since]) / count
    return means


def _courses(cells: Cells) -> dict[int, FloatArray]:
    """The course of every kind of turn that a cell follows; one that was not seen whole is as another of its run."""
    seen = {(way, end): course for (way, end), course in zip(cells.turn_kinds.tolist(), cells.turns, strict=True)}
    courses: dict[int, FloatArray] = {}
    for number, (way, end) in enumerate(cells.followed):
        if way and seen:
            like = next((kind for kind in seen if kind[0] == way), next(iter(seen)))
            # A turn the other way is the mirror image of one that was seen.
            courses[number] = seen.get((way, end), way * like[0] * seen[like])
    return courses


@lru_cache(maxsize=1024)
def _motion(turn: bytes, before: int, rate_hz: float) -> Motions:
    return motion_of(np.frombuffer(turn), before, rate_hz)
