"""Samples, as they come, to the cells of a run: one pass, and what is kept between chunks does not grow."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.cells import (
    AFTER_S,
    BEFORE,
    BEFORE_S,
    FAR,
    FAULTS,
    NEAR_S,
    NO_BIN,
    Cells,
    Columns,
)
from rigctl.experiments.rotating_platform.observe.estimates import dwell_shapes, shifts, usual_shape
from rigctl.experiments.rotating_platform.observe.even_samples import (
    COMMANDED,
    MOVING,
    OWN,
    TEMPERATURE,
    THETA,
    EvenSamples,
    filled,
)
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains
from rigctl.experiments.rotating_platform.observe.turns import Dwells, Turns

Total = Callable[[FloatArray], FloatArray]
"""From values of the samples to their sums over the cells."""

LONGEST_CELL_S = 8.0

_CELLS_PER_PERIOD = 32.0
_BLOCK = 1 << 18


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
    stream = CellStream(chains, period_s, sample_rate_hz, guard_s=guard_s, lead_s=lead_s)
    for chunk in chunks:
        stream.take(chunk, _BLOCK)
    stream.end()
    cells = stream.cells()
    if cells is None:
        raise DataError(
            f"{stream.samples} samples hold no whole period of {period_s:g} s with the platform at rest; "
            "record longer"
        )
    return cells


class CellStream:
    """Takes a run in chunks of any length, and gives the cells of the periods that are whole."""

    def __init__(
        self, chains: Chains, period_s: float, sample_rate_hz: float, *, guard_s: float = 0.0, lead_s: float = 0.0
    ) -> None:
        self._even = EvenSamples(chains, period_s, sample_rate_hz)
        self._chains, self._guard_s, self._lead_s = chains, guard_s, lead_s
        self._cutter: _Cutter | None = None

    @property
    def samples(self) -> int:
        """Samples that are not cut yet."""
        return self._even.length

    def take(self, chunk: Columns, at_least: int = 0) -> None:
        """Add a chunk; once there are `at_least` so many samples and a whole period, they are cut."""
        even = self._even
        even.take(chunk)
        if not even.samples:
            return
        if self._cutter is None:
            self._cutter = _Cutter(self._chains, even, self._guard_s, self._lead_s)
        if even.length >= max(at_least, even.samples) + self._cutter.ahead:
            even.drop(self._cutter.cut(even.block(), self._cutter.ahead))

    def end(self) -> None:
        """Nothing comes any more: whole periods are cut without a look at what follows them."""
        if self._cutter is not None and self._even.length >= self._even.samples:
            self._cutter.cut(self._even.block(), 0)

    def cells(self) -> Cells | None:
        """The cells since the last call, as of a run by themselves; None where there are none."""
        return None if self._cutter is None else self._cutter.cells()


class _Cutter:
    """Cuts blocks of whole periods into cells."""

    def __init__(self, chains: Chains, even: EvenSamples, guard_s: float, lead_s: float) -> None:
        rate_hz, samples, self._own = even.rate_hz, even.samples, even.own
        self._turns = Turns(rate_hz, samples)
        self.ahead = self._turns.ahead
        self._rate_hz, self._samples = rate_hz, samples
        # In the units of the readings, which come divided by the scale factor.
        self._full_scale = [chains.full_scale_v[name] / chains.gain_v_per_m_s2[name] for name in CHANNELS]
        edges = np.array(sorted({*AFTER_S, *NEAR_S, guard_s}))
        self._leads = np.array([round(BEFORE_S * rate_hz), round(lead_s * rate_hz)])
        # A time that is a whole number of samples must not be rounded up to the next.
        self._edges = np.ceil(edges * rate_hz - 1e-6).astype(np.int64)
        self._bin_edges = np.ceil(np.array(AFTER_S) * rate_hz - 1e-6).astype(np.int64)
        self._longest = max(round(max(LONGEST_CELL_S, samples / rate_hz / _CELLS_PER_PERIOD) * rate_hz), 1)
        self._begin()

    def _begin(self) -> None:
        self._parts: list[dict[str, Any]] = []
        self._faults: list[Int64Array] = []
        self._holed: list[BoolArray] = []
        self._periods, self._off_stop = 0, 0

    def cut(self, block: FloatArray, ahead: int) -> int:
        """Add the cells of the periods that are whole; returns the samples they have. `ahead` are only looked at."""
        periods = (block.shape[1] - ahead) // self._samples
        if periods <= 0:
            return 0
        length = int(periods * self._samples)
        dwells = self._turns.dwells(block[MOVING], block[THETA])
        cos = np.cos(dwells.theta_rad[:length])
        starts = self._starts(dwells, cos)
        if dwells.rests[starts].any():
            self._add(block[:, :length], dwells, cos, starts)
        else:
            self._faults.append(np.zeros((periods, len(CHANNELS), len(FAULTS)), dtype=np.int64))
        self._holed.append(np.asarray(dwells.lost[:length].reshape(-1, self._samples).any(axis=1)))
        self._periods += periods
        self._turns.remember(dwells, length)
        return length

    def cells(self) -> Cells | None:
        """All cells since the last call."""
        if not self._parts:
            return None
        joined = {name: np.concatenate([part[name] for part in self._parts]) for name in self._parts[0]}
        faults = np.concatenate(self._faults)
        negative, moment = joined["sign"] < 0, joined["count"] * joined["centre"]
        shapes = dwell_shapes(joined["period"], negative, joined["count"], moment, self._periods)
        gap, holed = faults[:, :, FAULTS.index("gap")], np.concatenate(self._holed)
        gapless = ~(holed | gap.any(axis=1))
        shifted = shifts(shapes, usual_shape(shapes, gapless))[:, None]
        faults[:, :, FAULTS.index("shifted")] = shifted
        # Where the flag was lost nothing tells a dwell from a turn: what the period's dwells miss was lost with it.
        gap[holed] = np.maximum(gap, shifted)[holed]
        turns, turn_kinds = self._turns.mean()
        integers = {name: joined[name].astype(np.int64) for name in ("period", "sign", "bin", "since", "to_go")}
        cells = Cells(
            sample_rate_hz=self._rate_hz,
            samples=self._samples,
            **{**joined, **integers},
            faults=faults,
            off_stop=self._off_stop,
            drift_s=_drift(shapes, gapless) / self._rate_hz,
            turns=turns,
            turn_kinds=turn_kinds,
            turn_before=self._turns.before,
            own=self._own,
        )
        self._begin()
        return cells

    def _starts(self, dwells: Dwells, cos: FloatArray) -> Int64Array:
        """Where cells begin, and where the platform begins to move, as sample numbers below those of `cos`."""
        length = cos.size
        longest = self._longest * np.arange(length // self._longest + 1)
        # Before the first turn of a run cells are as long as can be from its beginning on.
        after = np.where(dwells.turned_at > -FAR, dwells.turned_at, 0)
        within = [
            dwells.turned_at[:, None] + self._edges,
            dwells.turn_at[:, None] - self._leads,
            after[:, None] + longest[longest < (dwells.stop - after).max(initial=0)],
        ]
        inside = [edge[(edge > dwells.start[:, None]) & (edge < dwells.stop[:, None])] for edge in within]
        # Where the angle changes sides without a flag: a cell has one sign.
        flips = np.flatnonzero((cos[1:] >= 0.0) != (cos[:-1] >= 0.0)) + 1
        periods = np.arange(0, length, self._samples)
        starts = np.unique(np.concatenate([dwells.start, dwells.stop, *inside, flips, periods]))
        return np.asarray(starts[starts < length])

    def _add(self, block: FloatArray, dwells: Dwells, cos: FloatArray, starts: Int64Array) -> None:
        """The cells that begin at `starts`, but for those in which the platform moves."""
        q, length = self._samples, block.shape[1]
        # Odd whole numbers from mid-period: their sums are exact, and no time is ever accumulated.
        u = (2.0 * (np.arange(length) % q) + 1.0 - q).astype(np.float64)
        kept, sizes = dwells.rests[starts], np.diff(np.append(starts, length))

        def total(values: FloatArray) -> FloatArray:
            return np.asarray(np.add.reduceat(values, starts)[kept])

        count = sizes[kept].astype(np.float64)
        centre = total(u) / count
        centre_of_all = np.zeros(starts.size)
        centre_of_all[kept] = centre
        offset = u - np.repeat(centre_of_all, sizes)
        sin = np.sin(dwells.theta_rad[:length])
        c_z, c_y = (filled(row) for row in block[COMMANDED])
        geometry = [(total(x) / count, total(offset * x)) for x in _geometry(cos, sin, c_z, c_y)]
        speed, turning = (row[:length] for row in self._turns.motion(dwells))
        state = [total(c_z) / count, total(c_y) / count, _mean_of_known(total, block[TEMPERATURE])]
        state += [total(speed**2) / count, total(turning) / count]
        state += [_mean_of_known(total, row) for row in block[OWN]]
        self._off_stop += int(np.count_nonzero(dwells.rests[:length] & ~dwells.still[:length]))
        first = starts[kept]
        dwell = dwells.number_at(first)
        since, to_go = first - dwells.turned_at[dwell], dwells.turn_at[dwell] - first
        self._parts.append(
            {
                "period": self._periods + first // q,
                "sign": np.where(cos[first] >= 0.0, 1, -1),
                "bin": self._bins(since, to_go),
                "since": np.minimum(since, FAR),
                "to_go": np.minimum(to_go, self.ahead),
                "direction": dwells.direction[dwell],
                "count": count,
                "centre": centre,
                "sums": self._sums(block, dwells, u, total),
                "geometry": np.stack([means for means, _ in geometry], axis=1),
                "ramps": np.stack([ramps for _, ramps in geometry], axis=1),
                "state": np.stack(state, axis=1),
            }
        )

    def _sums(self, block: FloatArray, dwells: Dwells, u: FloatArray, total: Total) -> FloatArray:
        """`Cells.sums`; what was left out is added to the faults."""
        q, length = self._samples, block.shape[1]
        rests, astray = dwells.rests[:length], np.zeros(length, dtype=np.bool_)
        for number in np.flatnonzero(dwells.astray).tolist():
            astray[dwells.start[number] : dwells.stop[number]] = True
        faults = np.zeros((length // q, len(CHANNELS), len(FAULTS)), dtype=np.int64)
        channels = []
        for number, full_scale in enumerate(self._full_scale):
            m = block[number]
            gap = rests & ~(np.isfinite(m) & dwells.known[:length])
            saturated = rests & ~gap & (np.abs(m) >= full_scale * (1.0 - 1e-12))
            elsewhere = rests & astray & ~gap & ~saturated
            used = rests & ~gap & ~saturated & ~elsewhere
            # What is not used has no count and adds nothing: missing samples need no case of their own.
            usable = used.astype(np.float64)
            level = np.where(used, m, 0.0)
            sums = np.stack([total(x) for x in (usable, u * usable, u * u * usable, level, u * level)], axis=1)
            # What saturates within a cell is what changes in it: its means would be of other samples.
            sums[total(saturated.astype(np.float64)) > 0.0] = 0.0
            channels.append(sums)
            for kind, where in enumerate((gap, saturated, elsewhere)):
                faults[:, number, kind] = where.reshape(-1, q).sum(axis=1)
        self._faults.append(faults)
        return np.stack(channels, axis=1)

    def _bins(self, since: Int64Array, to_go: Int64Array) -> Int64Array:
        bins = np.searchsorted(self._bin_edges, since, side="right") - 1
        bins = np.where(to_go <= round(BEFORE_S * self._rate_hz), BEFORE, bins)
        return np.asarray(np.where(since < FAR, bins, NO_BIN))


def _geometry(cos: FloatArray, sin: FloatArray, c_z: FloatArray, c_y: FloatArray) -> tuple[FloatArray, ...]:
    """The samples of `GEOMETRY`."""
    return cos, sin, c_z * cos, c_z * sin, c_y * cos, c_y * sin


def _mean_of_known(total: Total, values: FloatArray) -> FloatArray:
    known = np.isfinite(values)
    if not known.any():
        return np.full(total(values).size, np.nan)
    count = total(known.astype(np.float64))
    with np.errstate(invalid="ignore"):
        return np.asarray(total(np.where(known, values, 0.0)) / np.where(count > 0.0, count, np.nan))


def _drift(shapes: Int64Array, gapless: BoolArray) -> float:
    """By how many samples the dwells at half a turn are later in the last period than in the first; 0 below one.

    A gap moves the mean time of what is left: periods with one cannot tell.
    """
    whole = np.flatnonzero(gapless & (shapes[:, 1] > 0))
    if whole.size <= 2 or not (shapes[whole] != shapes[whole[0]]).any():
        return 0.0
    at = 0.5 * shapes[whole, 3] / shapes[whole, 1]
    drift = float(np.polyfit(whole.astype(np.float64), at, 1)[0]) * (len(shapes) - 1)
    # Below a sample it is the rounding of edges.
    return drift if abs(drift) >= 1.0 else 0.0
