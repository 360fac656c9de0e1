"""Samples of any length to a few sums per modulation period, as a stream.

Both estimators of `estimators` need no more of a period than count, sum of t, of t^2, of the readings and of t times
the readings, for the samples of either sign. A sample that is missing, saturated or taken off the stop is left out of
these sums, so a period with faults needs no second look at its samples. Times are integers: twice the index of the
sample from mid-period.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.core.arrays import BoolArray, FloatArray, Int8Array, Int64Array
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.dwell_sums import dwell_sums, line_sums
from rigctl.experiments.rotating_platform.observe.patterns import SampledPattern

Segment = tuple[int, int, int]

FAULTS = ("gap", "saturated", "angle")
"""Why a sample of a dwell is left out: no value, at or past full scale, taken off the stop; the first that holds."""

_AT_ONCE = 2**20


@dataclass(frozen=True)
class PeriodSums:
    """Sums over the kept samples of successive periods.

    `values`, shape (periods, channels, 2, 5): of the samples with cos(theta) = +1, then -1, the count, sum u, sum
    u^2, sum m, sum u m with u = 2 k + 1 - q for sample k of q. `faults`, shape (periods, channels, 3): samples of
    dwells that were left out, by `FAULTS`.
    """

    values: FloatArray
    faults: Int64Array

    @classmethod
    def zeros(cls, periods: int, channels: int) -> PeriodSums:
        """Nothing summed yet."""
        return cls(np.zeros((periods, channels, 2, 5)), np.zeros((periods, channels, len(FAULTS)), np.int64))

    @classmethod
    def joined(cls, parts: Iterable[PeriodSums]) -> PeriodSums:
        """What successive calls gave, as one; of at least one part."""
        values, faults = zip(*((part.values, part.faults) for part in parts), strict=True)
        return cls(np.concatenate(values), np.concatenate(faults))

    def __len__(self) -> int:
        return len(self.values)


class Demodulator:
    """Takes a recording in chunks of any size and gives the sums of each period that they complete.

    The first sample is the first of a period. What comes out does not depend on how the recording was cut but for
    rounding, and what is kept between calls does not grow. Samples whose magnitude reaches `full_scale` are
    saturated.
    """

    def __init__(self, sampled: SampledPattern, channels: int, *, full_scale: float | None = None) -> None:
        self._sampled, self._channels = sampled, channels
        self._full_scale = np.inf if full_scale is None else full_scale
        self._at, self._open = 0, PeriodSums.zeros(1, channels)

    @property
    def open_samples(self) -> int:
        """Samples so far of the last, unfinished period."""
        return self._at

    def feed(
        self, samples: Sequence[FloatArray], *, sign: Int8Array | None = None, off_stop: BoolArray | None = None
    ) -> PeriodSums:
        """Take in one array of equal length per channel; give the sums of the periods that are now complete.

        NaN is a sample that was lost. `sign` is cos(theta) of each sample as it was recorded (0: moving), where that
        shall count instead of the pattern's table; `off_stop` marks samples at which the platform was not where it
        should be. Raises `DataError` when the arrays do not fit together.
        """
        rows = [np.asarray(channel) for channel in samples]
        self._check(rows, sign, off_stop)
        if off_stop is not None and not off_stop.any():
            off_stop = None
        length, q, at, done = rows[0].size, self._sampled.samples, 0, [PeriodSums.zeros(0, self._channels)]
        while at < length:
            whole = min((length - at) // q, _AT_ONCE // q + 1)
            if self._at or sign is not None or off_stop is not None:
                whole = 0
            part = slice(at, at + whole * q if whole else min(length, at + q - self._at))
            these = [np.ascontiguousarray(row[part], dtype=np.float64) for row in rows]
            if whole:
                done.append(self._whole_periods(these, whole))
            else:
                recorded = None if sign is None else sign[part]
                done += self._part_of_period(these, recorded, None if off_stop is None else off_stop[part])
            at = part.stop
        return PeriodSums.joined(done)

    def skip(self, samples: int) -> PeriodSums:
        """The same for `samples` that were lost, in all channels."""
        lost, done = np.full(min(samples, _AT_ONCE), np.nan), [PeriodSums.zeros(0, self._channels)]
        for at in range(0, samples, _AT_ONCE):
            done.append(self.feed([lost[: samples - at]] * self._channels))
        return PeriodSums.joined(done)

    def _check(self, rows: Sequence[NDArray[Any]], sign: Int8Array | None, off_stop: BoolArray | None) -> None:
        if len(rows) != self._channels:
            raise DataError(f"{len(rows)} arrays for {self._channels} channels: pass one of each")
        shapes = {each.shape for each in (*rows, sign, off_stop) if each is not None}
        if len(shapes) > 1 or rows[0].ndim != 1:
            raise DataError(f"samples and marks have the shapes {sorted(shapes)}: pass rows of one length")

    def _whole_periods(self, rows: Sequence[FloatArray], periods: int) -> PeriodSums:
        """Dwell by dwell, all periods at once; those with faults once more."""
        found = PeriodSums.zeros(periods, self._channels)
        segments = self._sampled.segments
        for channel, row in enumerate(rows):
            values = found.values[:, channel]
            faulty = np.zeros(periods, dtype=np.bool_)
            for sign, start, stop in segments:
                level, ramp, unusable = dwell_sums(row, start, stop, self._sampled.samples, self._full_scale)
                values[:, _row(sign)] += self._dwell_sums(start, stop - start, level, ramp)
                faulty |= unusable
            values[faulty] = 0.0
            table = row.reshape(periods, -1)
            for i in np.flatnonzero(faulty).tolist():
                self._add_usable(table[i], 0, segments, None, values[i], found.faults[i, channel])
        return found

    def _part_of_period(
        self, rows: Sequence[FloatArray], sign: Int8Array | None, off_stop: BoolArray | None
    ) -> list[PeriodSums]:
        """Add to the open period; it, once it is complete."""
        first, length = self._at, rows[0].size
        segments = _overlap(self._sampled.segments, first, length) if sign is None else _runs(sign, first)
        for channel, row in enumerate(rows):
            sums, faulty = np.zeros((2, 5)), off_stop is not None
            for value, start, stop in segments:
                level, ramp, unusable = line_sums(row[start - first : stop - first], self._full_scale)
                sums[_row(value)] += self._dwell_sums(start, stop - start, level, ramp)
                faulty |= unusable
            if faulty:
                sums[:] = 0.0
                self._add_usable(row, first, segments, off_stop, sums, self._open.faults[0, channel])
            self._open.values[0, channel] += sums
        self._at += length
        if self._at < self._sampled.samples:
            return []
        done, self._at, self._open = self._open, 0, PeriodSums.zeros(1, self._channels)
        return [done]

    def _dwell_sums(self, start: int, length: int, level: float | FloatArray, ramp: float | FloatArray) -> FloatArray:
        """The five sums of a dwell without faults from those about its own first sample, shape (..., 5)."""
        first = 2 * start + 1 - self._sampled.samples
        mean = first + length - 1
        sums = np.empty((*np.shape(level), 5))
        sums[..., 0] = length
        sums[..., 1] = length * mean
        sums[..., 2] = length * mean**2 + length * (length**2 - 1) // 3
        sums[..., 3] = level
        sums[..., 4] = first * level + 2.0 * ramp
        return sums

    def _add_usable(
        self,
        row: FloatArray,
        first: int,
        segments: Sequence[Segment],
        off_stop: BoolArray | None,
        sums: FloatArray,
        faults: Int64Array,
    ) -> None:
        """Add what can be used of the dwells of one row, whose first sample is number `first` of its period."""
        for sign, start, stop in segments:
            dwell = row[start - first : stop - first]
            gap = ~np.isfinite(dwell)
            saturated = ~gap & (np.abs(dwell) >= self._full_scale)
            usable = ~(gap | saturated)
            angle = np.zeros_like(gap) if off_stop is None else usable & off_stop[start - first : stop - first]
            kept = np.flatnonzero(usable & ~angle)
            value, time = dwell[kept], (2 * (start + kept) + 1 - self._sampled.samples).astype(np.float64)
            sums[_row(sign)] += (kept.size, time.sum(), time @ time, value.sum(), time @ value)
            faults += (gap.sum(), saturated.sum(), angle.sum())


def sums_of(
    sampled: SampledPattern,
    samples: Sequence[FloatArray],
    *,
    full_scale: float | None = None,
    sign: Int8Array | None = None,
    off_stop: BoolArray | None = None,
) -> PeriodSums:
    """The sums of a recording that is there as a whole, arguments as for `Demodulator`; a part period is left out.

    Raises `DataError` for one without a whole period.
    """
    stream = Demodulator(sampled, len(samples), full_scale=full_scale)
    found = stream.feed(samples, sign=sign, off_stop=off_stop)
    if not len(found):
        raise DataError(
            f"{stream.open_samples} samples at {sampled.sample_rate_hz:g} Hz are no whole period of "
            f"{sampled.pattern.label}, which has {sampled.samples}: record longer"
        )
    return found


def _row(sign: int) -> int:
    return 0 if sign > 0 else 1


def _overlap(segments: Iterable[Segment], first: int, length: int) -> list[Segment]:
    """What `length` samples from `first` on have of the segments."""
    cut = ((sign, max(start, first), min(stop, first + length)) for sign, start, stop in segments)
    return [(sign, start, stop) for sign, start, stop in cut if start < stop]


def _runs(sign: Int8Array, first: int) -> list[Segment]:
    """Stretches of one sign other than zero, their indices counted from `first`."""
    edges = [0, *(np.flatnonzero(np.diff(sign)) + 1).tolist(), sign.size]
    return [(int(sign[i]), first + i, first + j) for i, j in itertools.pairwise(edges) if sign[i]]
