"""From a run's cells to its observables, for one channel: what is linear in the readings, applied to anything.

Every period gives mean and slope of acceleration and bias by the joint fit (`estimates`); what it leaves is resolved
in time after each turn and before the next, dwells at 0 and at half a turn apart, and averaged over the run.
Readings, the baseline's columns and an effect's are all reduced alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array, IntArray
from rigctl.core.errors import DataError
from rigctl.experiments.rotating_platform.observe.cells import BEFORE, FAULTS, NO_BIN, Cells
from rigctl.experiments.rotating_platform.observe.estimates import FEWEST_SAMPLES, usual_mask
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, READINGS
from rigctl.experiments.rotating_platform.observe.turns import OFF_STOP_DEG

MOST_GROUPS = 120
"""A longer run's periods are averaged in so many groups of successive ones."""

_WHY_LOST = {
    "gap": "{column}, theta_deg or moving are missing",
    "saturated": "{column} is at full_scale",
    "angle": f"theta_deg rests more than {OFF_STOP_DEG:g} degrees from 0 and 180; correct its zero and its scale",
}

# Periods with a bin, of which its scatter is known.
_FEWEST_TIMES = 4
# The line that is fitted to each stop takes two of its bins' freedoms.
_REDUNDANT = 2


@dataclass(frozen=True)
class Bin:
    """Stretch of time after a turn (or before the next) at one of the stops."""

    number: int
    sign: int


class Reducer:
    """One channel of a run; rows are the four outputs of `groups` groups of periods, then the bins.

    Raises `DataError` when no period is left.
    """

    def __init__(self, cells: Cells, channel: str) -> None:
        self.cells, self.channel = cells, channel
        self._sums = cells.sums[:, CHANNELS.index(channel)]
        self.sampled = usual_mask(cells)
        # u counts half samples: u / 2 f_s is a time.
        time = 2.0 * cells.sample_rate_hz
        centre = self.sampled.centre_s
        count, u, square, level, ramp = self._sums.T
        self._time = u / time - centre * count
        square = self._square = square / time**2 - 2.0 * centre * u / time + centre**2 * count
        key = 2 * cells.period + (cells.sign < 0)
        totals = [np.bincount(key, each, 2 * cells.periods) for each in (count, self._time, square)]
        lines = self._lines = np.stack(totals, axis=1).reshape(cells.periods, 2, 3)
        enough = lines[:, :, 0].sum(axis=1) >= FEWEST_SAMPLES * self.sampled.kept
        with np.errstate(invalid="ignore", divide="ignore"):
            spread = lines[:, :, 2] - lines[:, :, 1] ** 2 / lines[:, :, 0]
        self.valid: BoolArray = enough & (lines[:, :, 0] >= 2.0).all(axis=1) & (spread > 0.0).all(axis=1)
        if not self.valid.any():
            raise DataError(f"none of its {cells.periods} periods has half of its samples{self._why_lost()}")
        self.per_group = math.ceil(cells.periods / MOST_GROUPS)
        self._readings = level, ramp / time - centre * level

    def _why_lost(self) -> str:
        """By the fault that took most samples."""
        lost = self.cells.faults[:, CHANNELS.index(self.channel), : len(_WHY_LOST)].sum(axis=0)
        if not lost.any():
            return ""
        return ": " + _WHY_LOST[FAULTS[int(lost.argmax())]].format(column=READINGS[self.channel])

    @cached_property
    def groups(self) -> Int64Array:
        """Numbers of the groups that have a valid period."""
        return np.unique(np.flatnonzero(self.valid) // self.per_group)

    @cached_property
    def members(self) -> FloatArray:
        """Valid periods of each of `groups`."""
        return np.bincount(np.flatnonzero(self.valid) // self.per_group)[self.groups].astype(np.float64)

    @cached_property
    def bins(self) -> tuple[Bin, ...]:
        """Those of a usual period with enough turns behind them.

        The last two of each stop follow from the others and are left out.
        """
        bins: list[Bin] = []
        for sign in (1, -1):
            of_stop = (self.cells.sign == sign) & (self.cells.bin != NO_BIN) & self._counts
            numbers = [
                n
                for n in np.unique(self._usual_bins[self.sampled.sign == sign]).tolist()
                if np.unique(self.cells.period[of_stop & (self.cells.bin == n)]).size >= _FEWEST_TIMES
            ]
            after = [n for n in numbers if n != BEFORE]
            bins += [Bin(n, sign) for n in after[: max(len(after) - _REDUNDANT, 0)]]
            bins += [Bin(BEFORE, sign)] if BEFORE in numbers and len(after) > _REDUNDANT else []
        return tuple(bins)

    @property
    def rows(self) -> int:
        """How many observables there are."""
        return 4 * self.groups.size + len(self.bins)

    def readings(self) -> FloatArray:
        """The observables of what was read, shape (rows,)."""
        level, ramp = self._readings
        return np.asarray(self._of_levels @ level + self._of_ramps @ ramp)

    @cached_property
    def operator(self) -> sparse.csr_matrix:
        """From means over the cells to observables, (rows, cells), of what changes evenly within a cell.

        How fast it changes its neighbours in the dwell tell: in cells of 8 s the slope of a dwell has a tenth of it.
        """
        count, time = self._sums[:, 0], self._time
        middle = 0.5 * self.cells.centre / self.cells.sample_rate_hz - self.sampled.centre_s
        changing = self._of_sums(time - middle * count, self._square - middle * time)
        return sparse.csr_matrix(self._of_means + changing @ self.cells.rates)

    def of(self, means: FloatArray, ramps: FloatArray | None = None) -> FloatArray:
        """The observables of what has these `means` in the cells, shape (cells, k); shape (rows, k).

        `ramps` are sums of (u - mean u) x within the cells, where they are known.
        """
        if ramps is None:
            return np.asarray(self.operator @ means)
        share = self._sums[:, 0] / self.cells.count / (2.0 * self.cells.sample_rate_hz)
        return np.asarray(self._of_means @ means + self._of_ramps @ (share[:, None] * ramps))

    def series(self, rows: FloatArray) -> FloatArray:
        """The four outputs of rows, shape (rows, k), by group in time: (4, all groups, k), NaN for those left out."""
        table = np.full((4, math.ceil(self.cells.periods / self.per_group), rows.shape[1]), np.nan)
        table[:, self.groups] = rows[: 4 * self.groups.size].reshape(4, self.groups.size, -1)
        return table

    def inflation(self) -> FloatArray:
        """By how much the noise of each group grows because samples are missing, as a factor of sigma."""
        with np.errstate(invalid="ignore", divide="ignore"):
            n, t, tt = (self._lines[:, :, i] for i in range(3))
            variance = (tt / (n * tt - t**2)).sum(axis=1)
        usual = float(np.min(variance[self.valid]))
        ratio = np.where(self.valid, variance / usual, 0.0)
        group = np.flatnonzero(self.valid) // self.per_group
        total = np.bincount(group, ratio[self.valid])[self.groups]
        return np.asarray(np.sqrt(total / self.members))

    def bin_scatter(self, means: FloatArray, ramps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standard uncertainties of the bins' means from their scatter over the periods, and degrees of freedom.

        What is known, with these `means` and `ramps` over the cells as in `of`, is taken off: an external signal is
        bent in every period in another way.
        """
        level, ramp = self._readings
        share = self._sums[:, 0] / self.cells.count / (2.0 * self.cells.sample_rate_hz)
        left = self._left(level - self._sums[:, 0] * means, ramp - self._time * means - share * ramps)
        sigma, dof = np.zeros(len(self.bins)), np.zeros(len(self.bins))
        for number, each in enumerate(self.bins):
            in_bin = self._of_bin(each)
            periods, where = np.unique(self.cells.period[in_bin], return_inverse=True)
            count = np.bincount(where, self._sums[in_bin, 0])
            mean = np.bincount(where, left[in_bin]) / count
            sigma[number] = float(np.std(mean, ddof=1)) / math.sqrt(periods.size)
            dof[number] = periods.size - 1.0
        return sigma, dof

    def bin_weights(self) -> FloatArray:
        """Weights of the samples of a usual period in the bins, shape (bins, samples)."""
        sampled = self.sampled
        weights = np.zeros((len(self.bins), sampled.samples))
        for row, own in enumerate(self.bins):
            where = (self._usual_bins == own.number) & (sampled.sign == own.sign)
            weights[row, where] = 1.0 / where.sum()
            same = sampled.sign == own.sign
            line = np.stack([same.astype(np.float64), same * sampled.time_s])
            weights[row] -= np.linalg.solve(line @ line.T, line @ weights[row]) @ line
        return weights

    def bin_periods(self) -> FloatArray:
        """How many periods stand behind each bin."""
        return np.array(
            [np.unique(self.cells.period[self._of_bin(each)]).size for each in self.bins], dtype=np.float64
        )

    @cached_property
    def _usual_bins(self) -> Int64Array:
        """In which bin each sample of a usual period is, shape (samples,)."""
        cells = self.cells
        usual = np.flatnonzero(cells.faults[:, 0, -1] == 0)
        # The second of them: before the first turn of a run there is no bin.
        cells_of_period = np.flatnonzero(cells.period == usual[min(1, usual.size - 1)])
        bin_of = np.full(cells.samples, NO_BIN)
        for each in cells_of_period:
            bin_of[cells.first[each] : cells.first[each] + int(cells.count[each])] = cells.bin[each]
        return bin_of

    @cached_property
    def _counts(self) -> BoolArray:
        """Cells of valid periods with a sample of this channel."""
        return np.asarray(self.valid[self.cells.period] & (self._sums[:, 0] > 0.0))

    def _of_bin(self, each: Bin) -> Int64Array:
        in_bin = (self.cells.bin == each.number) & (self.cells.sign == each.sign) & self._counts
        return np.flatnonzero(in_bin)

    @cached_property
    def _of_means(self) -> sparse.csr_matrix:
        """From what does not change within the cells to observables, (rows, cells)."""
        return self._of_sums(self._sums[:, 0], self._time)

    def _of_sums(self, level: FloatArray, ramp: FloatArray) -> sparse.csr_matrix:
        """From what has such sums in the cells for one of it, and such sums of time times it, to observables."""
        levels, ramps = self._of_levels, self._of_ramps
        values = levels.data * level[levels.indices] + ramps.data * ramp[ramps.indices]
        return sparse.csr_matrix((values, levels.indices, levels.indptr), levels.shape)

    @cached_property
    def _of_levels(self) -> sparse.csr_matrix:
        """From the sums of a quantity in the cells to observables, (rows, cells)."""
        n, mean, spread = self._own_line
        # A line's slope is (S_t - mean S) / spread, its level S / n - mean slope: here by S, below by S_t.
        return self._operator(1.0 / n + mean**2 / spread, -mean / spread, 1.0)

    @cached_property
    def _of_ramps(self) -> sparse.csr_matrix:
        """From the sums of time times a quantity in the cells to observables, (rows, cells)."""
        _, mean, spread = self._own_line
        return self._operator(-mean / spread, 1.0 / spread, 0.0)

    @cached_property
    def _own_line(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of the line each cell belongs to: samples, mean time, sum of squares about it; ones where it is invalid."""
        n, t, tt = self._lines[self.cells.period, (self.cells.sign < 0).astype(np.int64)].T
        valid = self.valid[self.cells.period]
        n, t, tt = np.where(valid, n, 1.0), np.where(valid, t, 0.0), np.where(valid, tt, 1.0)
        return n, t / n, tt - t**2 / n

    def _operator(self, level: FloatArray, slope: FloatArray, direct: float) -> sparse.csr_matrix:
        """From something in the cells, whose lines have these levels and slopes for one of it, to observables.

        Entries are the same for whatever it is, in the same order; of a place that has several the sum counts.
        """
        use, in_bins, order, indices, indptr = self._entries
        cells = self.cells
        # Half the sum and half the difference of the lines of either sign, averaged over the group.
        share = 0.5 / self.members[np.searchsorted(self.groups, cells.period[use] // self.per_group)]
        signed = share * cells.sign[use]
        values = [signed * level[use], signed * slope[use], share * level[use], share * slope[use]]
        for same, inside in in_bins:
            total = self._sums[inside, 0].sum()
            count = np.bincount(cells.period[inside], self._sums[inside, 0], cells.periods)
            moment = np.bincount(cells.period[inside], self._time[inside], cells.periods)
            period = cells.period[same]
            # A bin sees the readings less the line of its stop, which every cell of that stop has a part in.
            fitted = -(count[period] * level[same] + moment[period] * slope[same]) / total
            values += [fitted, np.full(inside.size, direct / total)]
        return sparse.csr_matrix((np.concatenate(values)[order], indices, indptr), (self.rows, cells.period.size))

    @cached_property
    def _entries(self) -> tuple[Int64Array, list[tuple[Int64Array, Int64Array]], IntArray, IntArray, IntArray]:
        """Cells in use; of each bin those of its stop and those inside; in which order entries stand, their columns,
        and where each row begins."""
        cells = self.cells
        use = np.flatnonzero(self.valid[cells.period])
        group = np.searchsorted(self.groups, cells.period[use] // self.per_group)
        size = self.groups.size
        rows, columns = [output * size + group for output in range(4)], [use] * 4
        in_bins = []
        for number, each in enumerate(self.bins):
            same, inside = use[cells.sign[use] == each.sign], self._of_bin(each)
            in_bins.append((same, inside))
            rows.append(np.full(same.size + inside.size, 4 * size + number))
            columns += [same, inside]
        row = np.concatenate(rows)
        order = np.argsort(row, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=self.rows))])
        return use, in_bins, order, np.concatenate(columns)[order], starts

    def _left(self, level: FloatArray, ramp: FloatArray) -> FloatArray:
        """Sums over the cells of what the fit of every period leaves of such sums, shape (cells,)."""
        cells = self.cells
        key = 2 * cells.period + (cells.sign < 0)
        n, mean, spread = self._own_line
        total, moment = (np.bincount(key, values, 2 * cells.periods)[key] for values in (level, ramp))
        slope = (moment - mean * total) / spread
        at_centre = total / n - mean * slope
        return np.asarray(level - at_centre * self._sums[:, 0] - slope * self._time)
