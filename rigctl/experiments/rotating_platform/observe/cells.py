"""A modulated run as cells: stretches of a dwell over which nothing that matters changes much.

A cell has sums that let every period be fitted exactly, and means of what effects go by. Its edges lie at fixed times
after a turn and before the next, so that what dies away after a turn is resolved in time. A cell never crosses the
boundary of a period. Runs come in chunks of any length; what is kept of them is some tens of cells per period.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, COMMANDS, READINGS, Chains

Columns = Mapping[str, FloatArray]

AFTER_S = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Times after a turn at which bins begin; the last one ends with the dwell."""

NEAR_S = (0.1, 0.2, 0.3, 0.4, 0.7)
"""Further edges of cells: what a motion leaves after its mask is over within samples, and its place counts."""

BEFORE_S = 0.5
"""What lies so near before the next turn is a bin of its own."""

BEFORE, NO_BIN = len(AFTER_S), -1
"""Number of that bin; of samples before the first turn of a run."""

GEOMETRY = ("cos", "sin", "cz_cos", "cz_sin", "cy_cos", "cy_sin")
"""Of the angle as recorded, alone and times the commanded accelerations: what the baseline is made of."""

STATE = ("c_z", "c_y", "temperature_c", "speed_squared", "turning")
"""Commands [m/s2], temperature, square of the angular rate and angular acceleration near a turn [rad, s]."""

FAULTS = ("gap", "saturated", "angle", "shifted")
"""Why a period is refitted: samples lost, past full scale, of a dwell off its stops; turns at other times."""

LONGEST_CELL_S = 8.0
OFF_STOP_DEG = 0.02
"""A dwell that never comes so near to 0 or half a turn is one that stopped elsewhere."""

BESIDE_S = 1.5
"""So far from a turn the platform's motion is still looked at."""

_CELLS_PER_PERIOD = 32.0
_BLOCK = 1 << 18
_STILL_RAD = 2e-6
_FAR = 1 << 40


@dataclass(frozen=True)
class Cells:
    """The cells of a run's whole periods, in order of time; times `u` are twice the sample's index from mid-period.

    `period`, `sign` (of cos theta), `bin`, `since` (samples from the end of the last turn to the first of the cell;
    huge before the first turn), `to_go` (from that to the next turn, as far as is looked ahead) and
    `direction` (of the last turn, 0 before the first) have shape (cells,). `sums` (cells, channels, 5): count, sum u,
    sum u^2, sum m, sum u m of the usable samples of `CHANNELS`, m in m/s2.
    `count` and `centre` (cells,): samples and their mean u, usable or not. `geometry` and `ramps` (cells, 6): mean x
    of `GEOMETRY`, sum (u - mean u) x; `state` (cells, 5) means of `STATE`. `faults` (periods, channels, 4): samples
    by `FAULTS`. `off_stop`: samples that count while the platform moves. `drift_s`: by how much later the turns came
    in the last period than in the first. `turns` (kinds, samples): the mean angle [rad] about the turns of one
    direction that end with the same sample of the period (`turn_kinds` (kinds, 2): direction, sample), from
    `turn_before` samples before the mask ends: where within a sample a turn ends is the same for all of a kind.
    """

    sample_rate_hz: float
    samples: int
    period: Int64Array
    sign: Int64Array
    bin: Int64Array
    since: Int64Array
    to_go: Int64Array
    direction: FloatArray
    count: FloatArray
    centre: FloatArray
    sums: FloatArray
    geometry: FloatArray
    ramps: FloatArray
    state: FloatArray
    faults: Int64Array
    off_stop: int
    drift_s: float
    turns: FloatArray
    turn_kinds: Int64Array
    turn_before: int

    @property
    def periods(self) -> int:
        """Whole periods of the run."""
        return len(self.faults)

    @property
    def period_s(self) -> float:
        """One period [s] by the samples' clock."""
        return self.samples / self.sample_rate_hz

    @property
    def time_s(self) -> FloatArray:
        """Mean time of each cell from the start of the run, shape (cells,)."""
        return np.asarray((self.period + 0.5 + 0.5 * self.centre / self.samples) * self.period_s)

    @cached_property
    def kind(self) -> Int64Array:
        """Which of `followed` each cell's last turn was, shape (cells,)."""
        return self._kinds[1]

    @cached_property
    def followed(self) -> list[tuple[int, int]]:
        """Direction and last sample, as in `turn_kinds`, of all turns that cells follow; (0, 0) is before any."""
        return [(way, end) for way, end in self._kinds[0].tolist()]

    @cached_property
    def _kinds(self) -> tuple[Int64Array, Int64Array]:
        first = np.rint(0.5 * (self.centre + self.samples - self.count)).astype(np.int64)
        end = np.where(self.direction != 0.0, (first - self.since) % self.samples, 0)
        found, which = np.unique(self.direction.astype(np.int64) * self.samples + end, return_inverse=True)
        way = np.rint(np.floor_divide(found, self.samples)).astype(np.int64)
        return np.stack([way, found - way * self.samples], axis=1), which

    @property
    def since_s(self) -> FloatArray:
        """Mean time of each cell since the last turn, infinite before the first."""
        found = (self.since + 0.5 * self.count) / self.sample_rate_hz
        return np.where(self.since < _FAR, found, np.inf)

    def to_bytes(self) -> bytes:
        """For keeping, bit for bit."""
        text = io.BytesIO()
        kept: dict[str, Any] = {each.name: np.asarray(getattr(self, each.name)) for each in fields(self)}
        np.savez_compressed(text, **kept)
        return text.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> Cells:
        """What `to_bytes` was given."""
        with np.load(io.BytesIO(data), allow_pickle=False) as kept:
            values: dict[str, Any] = {each.name: kept[each.name] for each in fields(cls)}
        numbers = {"sample_rate_hz": float, "samples": int, "off_stop": int, "drift_s": float, "turn_before": int}
        for name, kind in numbers.items():
            values[name] = kind(values[name])
        return cls(**values)


def cells_of(
    chunks: Iterable[Columns],
    chains: Chains,
    period_s: float,
    sample_rate_hz: float = math.nan,
    *,
    guard_s: float = 0.0,
    lead_s: float = 0.0,
) -> Cells:
    """The cells of a run whose samples come in `chunks`; none lies across a guard after or a lead before a turn.

    Raises `DataError` for a run without one whole period, or without a dwell.
    """
    stream = Stream(chains, period_s, sample_rate_hz)
    cutter: _Cutter | None = None
    for chunk in chunks:
        stream.take(chunk)
        if stream.samples and cutter is None:
            cutter = _Cutter(chains, stream.rate_hz, stream.samples, guard_s, lead_s)
        if cutter is not None and stream.length >= max(_BLOCK, stream.samples) + cutter.ahead:
            stream.drop(cutter.cut(stream.block(), cutter.ahead))
    if cutter is not None and stream.length >= stream.samples:
        cutter.cut(stream.block(), 0)
    if cutter is None or not cutter.parts:
        raise DataError(
            f"{stream.length} samples hold no whole period of {period_s:g} s with the platform at rest; record longer"
        )
    return cutter.joined()


class Stream:
    """Chunks as rows on an even time base: readings [m/s2], moving, angle [rad], commands [m/s2], temperature."""

    def __init__(self, chains: Chains, period_s: float, sample_rate_hz: float) -> None:
        self._chains, self._period_s, self._said_hz = chains, period_s, sample_rate_hz
        self.rate_hz, self.samples, self.length = math.nan, 0, 0
        self._step_s = self._last_s = math.nan
        self._waiting: list[FloatArray] = []

    def take(self, chunk: Columns) -> None:
        """Add a chunk."""
        t_s = chunk["t_s"]
        if not t_s.size:
            return
        if not self.samples:
            self._set_rate(t_s)
        steps = np.maximum(np.rint(np.diff(t_s, prepend=self._last_s) / self._step_s), 1.0)
        self._last_s = float(t_s[-1])
        place = (np.cumsum(steps) - 1.0).astype(np.int64)
        rows = self._rows(chunk)
        if place[-1] + 1 > len(t_s):
            spread = np.full((len(rows), int(place[-1]) + 1), np.nan)
            spread[:, place] = rows
            rows = spread
        self._waiting.append(rows)
        self.length += rows.shape[1]

    def block(self) -> FloatArray:
        """All that is there."""
        if len(self._waiting) > 1:
            self._waiting = [np.concatenate(self._waiting, axis=1)]
        return self._waiting[0]

    def drop(self, samples: int) -> None:
        """The first `samples` are no longer needed."""
        self._waiting = [self.block()[:, samples:]]
        self.length -= samples

    def _set_rate(self, t_s: FloatArray) -> None:
        step_s = float(np.median(np.diff(t_s))) if t_s.size > 1 else 1.0 / self._said_hz
        near = abs(self._said_hz * step_s - 1.0) < 2e-3
        self.rate_hz = self._said_hz if near else 1.0 / step_s
        self._step_s = step_s
        self.samples = max(round(self._period_s * self.rate_hz), 1)
        self._last_s = float(t_s[0]) - step_s

    def _rows(self, chunk: Columns) -> FloatArray:
        size = chunk["t_s"].size
        rows = [chunk[READINGS[name]] / self._chains.gain_v_per_m_s2[name] for name in CHANNELS]
        rows += [chunk["moving"], np.deg2rad(chunk["theta_deg"])]
        for name in CHANNELS:
            command = chunk.get(COMMANDS[name])
            rows.append(np.zeros(size) if command is None else command / self._chains.command_v_per_m_s2[name])
        rows.append(chunk.get("temperature_c", np.full(size, np.nan)))
        return np.stack(rows)


class _Cutter:
    """Cuts blocks of whole periods into cells; remembers of the last block what the next one needs."""

    def __init__(self, chains: Chains, rate_hz: float, samples: int, guard_s: float, lead_s: float) -> None:
        self.ahead = math.ceil(2.0 * BESIDE_S * rate_hz)
        self.parts: list[dict[str, Any]] = []
        self._rate_hz, self._samples = rate_hz, samples
        self._full = [chains.full_scale_v[name] / chains.gain_v_per_m_s2[name] for name in CHANNELS]
        edges = np.array(sorted({*AFTER_S, *NEAR_S, guard_s}))
        self._leads = sorted({round(BEFORE_S * rate_hz), round(lead_s * rate_hz)} - {0})
        self._edges = np.ceil(edges * rate_hz - 1e-6).astype(np.int64)
        self._bin_edges = np.ceil(np.array(AFTER_S) * rate_hz - 1e-6).astype(np.int64)
        self._longest = max(round(max(LONGEST_CELL_S, samples / rate_hz / _CELLS_PER_PERIOD) * rate_hz), 1)
        self._faults: list[Int64Array] = []
        self._periods, self._off_stop = 0, 0
        self._since, self._direction, self._stop_rad, self._beside = _FAR, 0.0, math.nan, _FAR
        self._angles_rad = np.zeros(0)
        self._turns: dict[tuple[int, int], tuple[FloatArray, int]] = {}
        self._turn_before = 0

    def cut(self, block: FloatArray, ahead: int) -> int:
        """Add the cells of the periods that are whole; returns the samples they have. `ahead` are only looked at."""
        q = self._samples
        periods = (block.shape[1] - ahead) // q
        if periods <= 0:
            return 0
        length = periods * q
        moving, theta = _held(block[2], block[3])
        rests = moving == 0.0
        index = np.arange(rests.size)
        since, to_go = self._since_turn(rests, index)
        direction = self._directions(rests, theta)
        self._note_turns(rests, theta)
        sign = np.where(rests, np.where(np.cos(theta) >= 0.0, 1, -1), 0)
        cell = self._edges_of(sign, since, to_go, index)[:length]
        starts = np.flatnonzero(cell)
        kept = rests[starts]
        if kept.any():
            self._add(block[:, :length], theta, rests, sign, since, to_go, direction, starts, kept, periods)
        else:
            self._faults.append(np.zeros((periods, len(CHANNELS), len(FAULTS)), dtype=np.int64))
        self._periods += periods
        self._remember(rests, theta, since, direction, length)
        return int(length)

    def _since_turn(self, rests: BoolArray, index: Int64Array) -> tuple[Int64Array, Int64Array]:
        """Of each sample that rests, its number since the last turn and how many follow before the next."""
        last = np.maximum.accumulate(np.where(rests, -1 - self._since, index))
        following = np.minimum.accumulate(np.where(rests, _FAR, index)[::-1])[::-1]
        return index - last - 1, following - index

    def _directions(self, rests: BoolArray, theta: FloatArray) -> FloatArray:
        """Of the last turn of each sample."""
        begins = np.flatnonzero(rests & ~np.concatenate([[self._since > 0], rests[:-1]]))
        ends = np.flatnonzero(~rests & np.concatenate([[self._since > 0], rests[:-1]]))
        found = np.full(rests.size, self._direction)
        for begin in begins.tolist():
            before = ends[ends < begin]
            stop = theta[before[-1] - 1] if before.size and before[-1] > 0 else self._stop_rad
            after = theta[min(begin + self.ahead // 2, rests.size - 1)]
            turned = after - stop
            found[begin:] = np.sign(turned) if abs(turned) > _STILL_RAD else found[begin]
        return found

    def _note_turns(self, rests: BoolArray, theta: FloatArray) -> None:
        """Add whole turns to the mean ones of their kinds."""
        begins = np.flatnonzero(rests[1:] & ~rests[:-1]) + 1
        ends = np.flatnonzero(~rests[1:] & rests[:-1]) + 1
        beside = self.ahead // 2
        for end in begins.tolist():
            before = ends[ends < end]
            if not before.size:
                continue
            begin = int(before[-1])
            self._turn_before = self._turn_before or end - begin + beside
            first, last = end - self._turn_before, end + beside
            if first < 0 or last > theta.size or abs(end - begin + beside - self._turn_before) > 1:
                continue
            course = theta[first:last] - theta[first]
            kind = (1 if course[-1] >= 0.0 else -1, end % self._samples)
            total, count = self._turns.get(kind, (np.zeros(course.size), 0))
            self._turns[kind] = total + course, count + 1

    def _edges_of(self, sign: Int64Array, since: Int64Array, to_go: Int64Array, index: Int64Array) -> BoolArray:
        """Where a cell begins."""
        bounded = np.minimum(since, 1 << 30)
        parts = (
            sign,
            (index // self._samples),
            np.searchsorted(self._edges, bounded, side="right"),
            np.where(since < _FAR, bounded, index) // self._longest,
            np.searchsorted(self._leads, to_go),
        )
        change = np.ones(sign.size, dtype=np.bool_)
        change[1:] = False
        for part in parts:
            change[1:] |= part[1:] != part[:-1]
        return change

    def _add(
        self,
        block: FloatArray,
        theta_ahead: FloatArray,
        rests: BoolArray,
        sign: Int64Array,
        since: Int64Array,
        to_go: Int64Array,
        direction: FloatArray,
        starts: Int64Array,
        kept: BoolArray,
        periods: int,
    ) -> None:
        q, length = self._samples, block.shape[1]
        u = (2.0 * (np.arange(length) % q) + 1.0 - q).astype(np.float64)
        stops = np.append(starts[1:], length)

        def total(values: FloatArray) -> FloatArray:
            return np.asarray(np.add.reduceat(values, starts)[kept])

        count = (stops - starts)[kept].astype(np.float64)
        centre = total(u) / count
        whole = np.zeros(starts.size)
        whole[kept] = centre
        offset = u - np.repeat(whole, stops - starts)
        speed, turning = self._motion(theta_ahead, rests)
        off = _stopped_elsewhere(theta_ahead, rests)[:length]
        resting = rests[:length]
        sums = np.empty((count.size, len(CHANNELS), 5))
        faults = np.zeros((periods, len(CHANNELS), len(FAULTS)), dtype=np.int64)
        for number, full in enumerate(self._full):
            m = block[number]
            gap = resting & ~np.isfinite(m)
            saturated = resting & ~gap & (np.abs(np.nan_to_num(m)) >= full * (1.0 - 1e-12))
            astray = resting & ~gap & ~saturated & off
            usable = (resting & ~gap & ~saturated & ~astray).astype(np.float64)
            level = np.where(usable > 0.0, m, 0.0)
            for column, values in enumerate((usable, u * usable, u * u * usable, level, u * level)):
                sums[:, number, column] = total(values)
            # What saturates within a cell is what changes in it: its means would be of other samples.
            sums[total(saturated.astype(np.float64)) > 0.0, number] = 0.0
            for kind, where in enumerate((gap, saturated, astray)):
                faults[:, number, kind] = where.reshape(periods, q).sum(axis=1)
        cos, sin = np.cos(theta_ahead[:length]), np.sin(theta_ahead[:length])
        c_z, c_y = (filled(row) for row in block[4:6])
        geometry = np.empty((count.size, len(GEOMETRY)))
        ramps = np.empty_like(geometry)
        for column, values in enumerate((cos, sin, c_z * cos, c_z * sin, c_y * cos, c_y * sin)):
            geometry[:, column], ramps[:, column] = total(values) / count, total(offset * values)
        state = [total(c_z) / count, total(c_y) / count, _mean_of_known(total, block[6])]
        state += [total(speed[:length] ** 2) / count, total(turning[:length]) / count]
        self._off_stop += int(np.count_nonzero(resting & ~_still(theta_ahead, rests)[:length]))
        self._faults.append(faults)
        first = starts[kept]
        self.parts.append(
            {
                "period": self._periods + first // q,
                "sign": sign[first],
                "bin": self._bins(since[first], to_go[first]),
                "since": np.where(since[first] < _FAR, since[first], _FAR),
                "to_go": np.minimum(to_go[first], self.ahead),
                "direction": direction[first],
                "count": count,
                "centre": centre,
                "sums": sums,
                "geometry": geometry,
                "ramps": ramps,
                "state": np.stack(state, axis=1),
            }
        )

    def _bins(self, since: Int64Array, to_go: Int64Array) -> Int64Array:
        found = np.searchsorted(self._bin_edges, since, side="right") - 1
        found = np.where(to_go <= round(BEFORE_S * self._rate_hz), BEFORE, found)
        return np.asarray(np.where(since < _FAR, found, NO_BIN))

    def _motion(self, theta: FloatArray, rests: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Angular rate and acceleration beside the turns; elsewhere none, whatever the encoder's last digit does."""
        earlier = self._angles_rad if self._angles_rad.size == 2 else np.full(2, theta[0])
        course = np.concatenate([earlier, theta, np.full(2, theta[-1])])
        far_back, back, here, on, far_on = (course[k : k + theta.size] for k in range(5))
        # Five points: a turn of seconds at ten samples a second is too bent for three.
        speed = (8.0 * (on - back) - (far_on - far_back)) * (self._rate_hz / 12.0)
        turning = (16.0 * (on + back) - 30.0 * here - (far_on + far_back)) * (self._rate_hz**2 / 12.0)
        reach = round(BESIDE_S * self._rate_hz)
        index = np.arange(rests.size)
        last = np.maximum.accumulate(np.where(rests, -1 - min(self._beside, _FAR), index))
        following = np.minimum.accumulate(np.where(rests, _FAR, index)[::-1])[::-1]
        near = ((index - last <= reach) | (following - index <= reach)) & ~_still(theta, rests)
        return np.where(near, speed, 0.0), np.where(near, turning, 0.0)

    def _remember(
        self, rests: BoolArray, theta: FloatArray, since: Int64Array, direction: FloatArray, length: int
    ) -> None:
        last = length - 1
        self._since = int(min(since[last] + 1, 2 * _FAR)) if rests[last] else 0
        self._beside = self._since
        self._direction = float(direction[last])
        self._angles_rad = theta[max(last - 1, 0) : last + 1].copy()
        resting = np.flatnonzero(rests[:length])
        if resting.size:
            self._stop_rad = float(theta[resting[-1]])

    def joined(self) -> Cells:
        """All cells."""
        joined = {name: np.concatenate([part[name] for part in self.parts]) for name in self.parts[0]}
        faults = np.concatenate(self._faults)
        shifted, drift = _shifts(joined, self._periods)
        faults[:, :, FAULTS.index("shifted")] = shifted[:, None]
        turns = np.zeros((len(self._turns), self._turn_before + self.ahead // 2))
        for number, (course, count) in enumerate(self._turns.values()):
            turns[number] = course / count
        integers = {name: joined[name].astype(np.int64) for name in ("period", "sign", "bin", "since", "to_go")}
        return Cells(
            sample_rate_hz=self._rate_hz,
            samples=self._samples,
            **{**joined, **integers},
            faults=faults,
            off_stop=self._off_stop,
            drift_s=drift / self._rate_hz,
            turns=turns,
            turn_kinds=np.array(list(self._turns), dtype=np.int64).reshape(-1, 2),
            turn_before=self._turn_before,
        )


def _held(moving: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Moving and angle with what was lost as it was before; a stop that changed meanwhile was a turn."""
    known = np.isfinite(moving) & np.isfinite(theta)
    if known.all():
        return moving, theta
    index = np.arange(known.size)
    before = np.maximum.accumulate(np.where(known, index, -1))
    after = np.minimum.accumulate(np.where(known, index, known.size)[::-1])[::-1]
    before = np.where(before < 0, np.minimum(after, known.size - 1), before)
    after = np.where(after >= known.size, before, after)
    turned = (np.cos(theta[before]) > 0.0) != (np.cos(theta[after]) > 0.0)
    held = np.where(known, moving, np.where(turned, 1.0, moving[before]))
    return np.nan_to_num(held, nan=1.0), np.nan_to_num(theta[before])


def filled(values: FloatArray) -> FloatArray:
    """What was commanded while samples were lost: straight lines between what is known; 0 where nothing is."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    index = np.arange(values.size)
    return np.asarray(np.interp(index, index[known], values[known]))


def _stopped_elsewhere(theta: FloatArray, rests: BoolArray) -> BoolArray:
    """Samples of dwells that never come near 0 or half a turn."""
    edges = np.flatnonzero(np.concatenate([[True], rests[1:] != rests[:-1]]))
    away = np.abs(theta - np.pi * np.rint(theta / np.pi))
    nearest = np.minimum.reduceat(away, edges)
    lengths = np.diff(np.append(edges, theta.size))
    return np.asarray(np.repeat(nearest > math.radians(OFF_STOP_DEG), lengths) & rests)


def _still(theta: FloatArray, rests: BoolArray) -> BoolArray:
    """Samples of dwells at which the platform is where it rests: the difference of two angles could not tell."""
    edges = np.flatnonzero(np.concatenate([[True], rests[1:] != rests[:-1]]))
    stops = np.append(edges[1:], theta.size)
    at = np.repeat(theta[(edges + stops) // 2], stops - edges)
    return np.asarray(rests & (np.abs(theta - at) < _STILL_RAD))


def _mean_of_known(total: Any, values: FloatArray) -> FloatArray:
    known = np.isfinite(values)
    if not known.any():
        return np.full(total(values).size, np.nan)
    count = total(known.astype(np.float64))
    with np.errstate(invalid="ignore"):
        return np.asarray(total(np.where(known, values, 0.0)) / np.where(count > 0.0, count, np.nan))


def _shifts(joined: Mapping[str, Any], periods: int) -> tuple[Int64Array, float]:
    """Of each period, the samples by which its dwells are elsewhere than in most; and how far they went in all."""
    period, negative = joined["period"].astype(np.int64), joined["sign"] < 0
    keys = 2 * period + negative
    count = np.bincount(keys, joined["count"], 2 * periods).reshape(periods, 2)
    moment = np.bincount(keys, joined["count"] * joined["centre"], 2 * periods).reshape(periods, 2)
    shape = np.rint(np.concatenate([count, moment], axis=1)).astype(np.int64)
    kinds, which, often = np.unique(shape, axis=0, return_inverse=True, return_counts=True)
    usual = int(np.argmax(often))
    shifted = np.abs(shape[:, :2] - kinds[usual, :2]).sum(axis=1)
    shifted = np.where((which.ravel() != usual) & (shifted == 0), 1, shifted)
    whole = count[:, 1] > 0.0
    at = 0.5 * moment[whole, 1] / count[whole, 1]
    drift = 0.0
    if len(kinds) > 1 and at.size > 2:
        slope = float(np.polyfit(np.flatnonzero(whole).astype(np.float64), at, 1)[0])
        total = slope * (periods - 1)
        drift = total if abs(total) >= 1.0 else 0.0
    return shifted, drift
