"""Modulation patterns: when the platform rests at 0 and at half a turn, in time and in samples.

External acceleration goes as cos(theta) = +1 or -1 in the frame of the sensor, its bias does not (Lenoir,
Christophe, Reynaud, Measurement 46 (2013) 1411). Samples taken while the platform moves are never used. Where a
guard time is asked for, the tables are laid out with it: masking more of a table designed without breaks what it
cancels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from rigctl.core.arrays import FloatArray, Int8Array
from rigctl.core.errors import ConfigError

ROTATIONS = {"a": 2, "b": 2, "c": 4, "c_tm": 6}
"""Half turns per period of the patterns with a name."""

MODULATED = (*ROTATIONS, "custom")
"""What `pattern` says of runs that are modulated; the others are flips, scans and noise records."""

ROTATION_TIME_S = 20.0
"""Time that all half turns of a period take together, in the paper."""

# Rounding of times written with six decimals, in seconds; of edges, in samples.
_SAME_TIME_S, _SAME_SAMPLE = 2e-6, 1e-3


@dataclass(frozen=True)
class Dwell:
    """The platform rests with cos(theta) = `sign` from `start_s` until just before `stop_s` of the period."""

    sign: int
    start_s: float
    stop_s: float


@dataclass(frozen=True)
class Turn:
    """The platform moves by half a turn, to cos(theta) = `to_sign`; the last of a period may end in the next."""

    start_s: float
    stop_s: float
    to_sign: int


@dataclass(frozen=True)
class Pattern:
    """One modulation period: dwells in order of time, the other samples being masked.

    Between dwells of opposite sign a motion of `rotation_s` starts `lead_s` after the mask does; `guard_s` are left
    after it. Raises `ConfigError` for a table that no platform can follow.
    """

    name: str
    period_s: float
    dwells: tuple[Dwell, ...]
    rotation_s: float = 0.0
    guard_s: float = 0.0
    lead_s: float = 0.0

    def __post_init__(self) -> None:
        _check_times(self.label, rotation_s=self.rotation_s, guard_s=self.guard_s, lead_s=self.lead_s)
        if not (math.isfinite(self.period_s) and self.period_s > 0.0) or not self.dwells:
            raise ConfigError(f"{self.label}: a pattern needs a positive period and at least one dwell")
        self._check_dwells()
        self._check_turns()

    @property
    def label(self) -> str:
        """How messages call it."""
        return f"pattern {self.name} of {self.period_s:g} s"

    @property
    def masked_s(self) -> float:
        """Time masked for each half turn: lead, motion, guard [s]."""
        return self.lead_s + self.rotation_s + self.guard_s

    @property
    def kept_s(self) -> float:
        """Time of a period in which the platform rests and samples count [s]."""
        return math.fsum(dwell.stop_s - dwell.start_s for dwell in self.dwells)

    @property
    def turns(self) -> tuple[Turn, ...]:
        """The motions of one period, in order of time."""
        return tuple(
            Turn(dwell.stop_s + self.lead_s, dwell.stop_s + self.lead_s + self.rotation_s, after.sign)
            for dwell, after in self._neighbours()
            if dwell.sign != after.sign
        )

    def sampled(self, sample_rate_hz: float) -> SampledPattern:
        """The pattern on a recording's samples; raises `ConfigError` when its period is no whole number of them."""
        return SampledPattern(self, sample_rate_hz)

    def _neighbours(self) -> list[tuple[Dwell, Dwell]]:
        first = self.dwells[0]
        again = Dwell(first.sign, first.start_s + self.period_s, first.stop_s + self.period_s)
        return list(pairwise([*self.dwells, again]))

    def _check_dwells(self) -> None:
        at = 0.0
        for number, dwell in enumerate(self.dwells):
            what = f"{self.label}: dwell {number}, {dwell.start_s:g} to {dwell.stop_s:g} s,"
            if dwell.sign not in (-1, 1):
                raise ConfigError(f"{what} has the sign {dwell.sign}: it is +1 at 0 and -1 at half a turn")
            if not at <= dwell.start_s < dwell.stop_s <= self.period_s + _SAME_TIME_S:
                raise ConfigError(f"{what} overlaps its neighbour or leaves the period: leave time for the rotations")
            at = dwell.stop_s

    def _check_turns(self) -> None:
        for dwell, after in self._neighbours():
            between = after.start_s - dwell.stop_s
            if dwell.sign != after.sign and between < self.masked_s - _SAME_TIME_S:
                raise ConfigError(
                    f"{self.label}: {between:g} s after the dwell that ends at {dwell.stop_s:g} s are too short for "
                    f"a rotation with its guard, {self.masked_s:g} s"
                )


@dataclass(frozen=True)
class SampledPattern:
    """A pattern on integer sample indices: sample k of a period is taken at (k + 1/2) / `sample_rate_hz`.

    So patterns that are even about mid-period stay even on the samples. Raises `ConfigError` when the period is no
    whole number of samples or a dwell holds none.
    """

    pattern: Pattern
    sample_rate_hz: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sample_rate_hz) and self.sample_rate_hz > 0.0):
            raise ConfigError(f"{self.pattern.label}: sample_rate_hz is {self.sample_rate_hz:g}: it must be positive")
        samples = self.pattern.period_s * self.sample_rate_hz
        # Else the pattern would drift against the samples from period to period.
        if abs(samples - round(samples)) > _SAME_SAMPLE or round(samples) < 1:
            raise ConfigError(
                f"{self.pattern.label} is {samples:g} samples at {self.sample_rate_hz:g} Hz: "
                f"make it a multiple of {1.0 / self.sample_rate_hz:g} s"
            )
        for dwell, (_, start, stop) in zip(self.pattern.dwells, self.segments, strict=True):
            if stop <= start:
                raise ConfigError(
                    f"{self.pattern.label}: the dwell at {dwell.start_s:g} s holds no sample at "
                    f"{self.sample_rate_hz:g} Hz: sample faster or dwell longer"
                )

    @cached_property
    def samples(self) -> int:
        """Samples of a period, q."""
        return round(self.pattern.period_s * self.sample_rate_hz)

    @cached_property
    def segments(self) -> tuple[tuple[int, int, int], ...]:
        """Sign, first sample and the one after the last, of every dwell."""
        return tuple((d.sign, self._first_at(d.start_s), self._first_at(d.stop_s)) for d in self.pattern.dwells)

    @cached_property
    def kept(self) -> int:
        """Samples of a period that count, n."""
        return sum(stop - start for _, start, stop in self.segments)

    @cached_property
    def sign(self) -> Int8Array:
        """c_k, shape (samples,): cos(theta) where the platform rests, 0 where it moves."""
        sign = np.zeros(self.samples, dtype=np.int8)
        for value, start, stop in self.segments:
            sign[start:stop] = value
        return sign

    @cached_property
    def centre_s(self) -> float:
        """Mean time of the samples that count, from mid-period [s]: where the estimates are stamped."""
        sums = self.power_sums(1).sum(axis=0)
        return float(sums[1] / sums[0])

    @cached_property
    def time_s(self) -> FloatArray:
        """Times of the samples from `centre_s`, shape (samples,)."""
        # Whole numbers before the one division: times of a long record are never accumulated.
        twice = 2.0 * np.arange(self.samples) + (1.0 - self.samples)
        return np.asarray(twice / (2.0 * self.sample_rate_hz) - self.centre_s)

    def power_sums(self, order: int) -> FloatArray:
        """Sums of t^j over the samples of either sign, t from mid-period [s]; shape (2, order + 1), `+` first.

        The sums are made in integers: what cancels, cancels exactly.
        """
        sums = [[0] * (order + 1), [0] * (order + 1)]
        for sign, start, stop in self.segments:
            for j in range(order + 1):
                sums[0 if sign > 0 else 1][j] += _odd_power_sum(2 * start + 1 - self.samples, stop - start, j)
        scale = (2.0 * self.sample_rate_hz) ** np.arange(order + 1)
        return np.array(sums, dtype=np.float64) / scale

    def _first_at(self, time_s: float) -> int:
        # Sample k stands for its middle: it belongs to a dwell that begins no later than that.
        return min(self.samples, math.ceil(time_s * self.sample_rate_hz - 0.5 - _SAME_SAMPLE))


def named_pattern(
    name: str, period_s: float, rotation_s: float | None = None, *, guard_s: float = 0.0, lead_s: float = 0.0
) -> Pattern:
    """Pattern a, b, c or c_tm, with half turns of `rotation_s`, by default 20 s a period in all.

    Raises `ConfigError` for another name and for a period too short for the rotations.
    """
    if name not in ROTATIONS:
        raise ConfigError(f"there is no pattern {name!r}: a, b, c and c_tm have a name, any other is custom")
    motion_s = ROTATION_TIME_S / ROTATIONS[name] if rotation_s is None else rotation_s
    _check_times(f"pattern {name}", rotation_s=motion_s, guard_s=guard_s, lead_s=lead_s)
    masked_s = lead_s + motion_s + guard_s
    dwells = _TABLES[name](period_s, masked_s)
    if not all(dwell.stop_s > dwell.start_s >= 0.0 for dwell in dwells):
        raise ConfigError(
            f"pattern {name} of {period_s:g} s leaves no time to dwell beside {ROTATIONS[name]} rotations of "
            f"{masked_s:g} s with guard: take a longer period"
        )
    return Pattern(name, period_s, tuple(dwells), motion_s, guard_s, lead_s)


def custom_pattern(
    period_s: float,
    dwells: Sequence[tuple[int, float, float]],
    rotation_s: float = 0.0,
    *,
    guard_s: float = 0.0,
    lead_s: float = 0.0,
) -> Pattern:
    """A pattern by its `dwells`: sign, start and stop [s]; raises `ConfigError` for one that cannot be followed."""
    return Pattern("custom", period_s, tuple(Dwell(*dwell) for dwell in dwells), rotation_s, guard_s, lead_s)


def _table_a(period_s: float, r: float) -> list[Dwell]:
    half = 0.5 * period_s
    return [Dwell(1, 0.5 * r, half - 0.5 * r), Dwell(-1, half + 0.5 * r, period_s - 0.5 * r)]


def _table_b(period_s: float, r: float) -> list[Dwell]:
    first, last = 0.25 * period_s, 0.75 * period_s
    return [
        Dwell(1, 0.0, first - 0.5 * r),
        Dwell(-1, first + 0.5 * r, last - 0.5 * r),
        Dwell(1, last + 0.5 * r, period_s),
    ]


def _table_c(period_s: float, r: float) -> list[Dwell]:
    """The inner transition A is where the second moment of c vanishes on what the rotations leave."""
    h = 0.5 * period_s
    # With a sign change h / 2 apart on either side, sum c and sum c t^2 vanish on the masked samples.
    inner = 0.5 * (math.sqrt(max(0.0, 1.25 * h * h - r * r)) - (0.5 * h + r))
    outer = inner + 0.5 * h
    return [
        Dwell(1, 0.0, h - outer - r),
        Dwell(-1, h - outer, h - inner - r),
        Dwell(1, h - inner, h + inner),
        Dwell(-1, h + inner + r, h + outer),
        Dwell(1, h + outer + r, period_s),
    ]


def _table_c_tm(period_s: float, r: float) -> list[Dwell]:
    """The first eight signs of Thue and Morse, whose moments up to the second vanish."""
    d, at, dwells = (period_s - 6.0 * r) / 8.0, 0.5 * r, []
    for number, length in enumerate((1, 2, 1, 1, 2, 1)):
        dwells.append(Dwell(-1 if number % 2 else 1, at, at + length * d))
        at += length * d + r
    return dwells


_TABLES: dict[str, Callable[[float, float], list[Dwell]]] = {
    "a": _table_a,
    "b": _table_b,
    "c": _table_c,
    "c_tm": _table_c_tm,
}


def _check_times(label: str, **times_s: float) -> None:
    for key, time_s in times_s.items():
        if not (math.isfinite(time_s) and time_s >= 0.0):
            raise ConfigError(f"{label}: {key} is {time_s:g}: it cannot be negative")


def _odd_power_sum(first: int, count: int, order: int) -> int:
    """Sum of (first + 2 i)^order for i < count, by central moments of an arithmetic progression up to the fourth."""
    mean = first + count - 1
    # About its mean, numbers 2 apart: odd moments vanish; the second and fourth are exact integers.
    square = count * (count * count - 1) // 3
    central = (count, 0, square, 0, square * (3 * count * count - 7) // 5)
    return sum(math.comb(order, j) * central[j] * mean ** (order - j) for j in range(order + 1))
