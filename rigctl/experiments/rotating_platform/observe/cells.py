"""A modulated run as cells: stretches of a dwell over which nothing that matters changes much.

A cell has sums that let every period be fitted exactly, and means of what effects go by. Its edges lie at fixed times
after a turn and before the next, so that what dies away after a turn is resolved in time. A cell never crosses the
boundary of a period. There are some tens of cells per period, whatever the sampling rate. `cutter` makes them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from rigctl.analysis.kept import Packed
from rigctl.core.arrays import FloatArray, Int64Array

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

BESIDE_S = 1.5
"""So far from a turn the platform's motion is still looked at."""

_OWN = "own"
FAR = 1 << 40
"""Samples since a turn where there was none."""


@dataclass(frozen=True)
class Cells:
    """The cells of a run's whole periods, in order of time; times `u` are twice the sample's index from mid-period.

    `period`, `sign` (of cos theta), `bin`, `since` (samples from the end of the last turn to the first of the cell;
    huge before the first turn), `to_go` (from that to the next turn, as far as is looked ahead) and
    `direction` (of the last turn, 0 before the first) have shape (cells,). `sums` (cells, channels, 5): count, sum u,
    sum u^2, sum m, sum u m of the usable samples of `CHANNELS`, m in m/s2.
    `count` and `centre` (cells,): samples and their mean u, usable or not. `geometry` and `ramps` (cells, 6): mean x
    of `GEOMETRY`, sum (u - mean u) x; `state` (cells, 5 + own) means of `STATE` and of the columns `own`.
    `faults` (periods, channels, 4): samples by `FAULTS`. `off_stop`: samples that count while the platform moves.
    `drift_s`: by how much later the turns came in the last period than in the first. `turns` (kinds, samples): the
    mean angle [rad] about the turns of one direction that end with the same sample of the period (`turn_kinds`
    (kinds, 2): direction, sample), from `turn_before` samples before the mask ends: where within a sample a turn ends
    is the same for all of a kind.
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
    own: tuple[str, ...] = ()

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
    def rates(self) -> sparse.csr_matrix:
        """From means over the cells to derivatives by time [1/s] in each, (cells, cells).

        By a parabola through a cell and its neighbours in the dwell, at either end of one by a line; 0 where it has
        none.
        """
        begin = self.period * self.samples + self.first
        beside = np.flatnonzero((begin[1:] == begin[:-1] + self.count[:-1]) & (self.sign[1:] == self.sign[:-1]))
        step, after = np.zeros((2, self.count.size))
        step[beside] = self.time_s[beside + 1] - self.time_s[beside]
        after[beside + 1] = step[beside]
        # The slope to the next cell counts by the distance to the one before, and the other way round.
        whole = np.where(step + after > 0.0, step + after, 1.0)
        on, back = (np.where(other > 0.0, other, own) / whole for own, other in ((step, after), (after, step)))
        on = np.divide(on, step, out=np.zeros_like(step), where=step > 0.0)
        back = np.divide(back, after, out=np.zeros_like(after), where=after > 0.0)
        return sparse.diags([back - on, on[:-1], -back[1:]], [0, 1, -1], format="csr")

    @cached_property
    def kind(self) -> Int64Array:
        """Which of `followed` each cell's last turn was, shape (cells,)."""
        return self._kinds[1]

    @cached_property
    def followed(self) -> list[tuple[int, int]]:
        """Direction and last sample, as in `turn_kinds`, of all turns that cells follow; (0, 0) is before any."""
        return [(way, end) for way, end in self._kinds[0].tolist()]

    @cached_property
    def first(self) -> Int64Array:
        """Number in its period of the first sample of each cell."""
        # u = 2 k + 1 - q counts half samples from mid-period: from the mean u back to the first k.
        return np.rint(0.5 * (self.centre + self.samples - self.count)).astype(np.int64)

    @cached_property
    def turn_number(self) -> Int64Array:
        """How many turns the run has made before each cell, shape (cells,)."""
        # All cells after one turn agree in when it ended: so many different ends, so many turns.
        ended = np.where(self.since < FAR, self.period * self.samples + self.first - self.since, -1)
        ends, number = np.unique(ended, return_inverse=True)
        return np.asarray(number + (ends[0] >= 0))

    @cached_property
    def _kinds(self) -> tuple[Int64Array, Int64Array]:
        end = np.where(self.direction != 0.0, (self.first - self.since) % self.samples, 0)
        codes, which = np.unique(self.direction.astype(np.int64) * self.samples + end, return_inverse=True)
        way = np.rint(np.floor_divide(codes, self.samples)).astype(np.int64)
        return np.stack([way, codes - way * self.samples], axis=1), which

    @property
    def since_s(self) -> FloatArray:
        """Mean time of each cell since the last turn, infinite before the first."""
        since_s = (self.since + 0.5 * self.count) / self.sample_rate_hz
        return np.where(self.since < FAR, since_s, np.inf)

    def packed(self) -> Packed:
        """For keeping, bit for bit."""
        arrays = {each.name: np.asarray(getattr(self, each.name)) for each in fields(self) if each.name != _OWN}
        return Packed({_OWN: list(self.own)}, arrays)

    @classmethod
    def unpacked(cls, kept: Packed) -> Cells:
        """What `packed` was called on."""
        values: dict[str, Any] = {name: array if array.ndim else array.item() for name, array in kept.arrays.items()}
        return cls(**values, own=tuple(kept.head[_OWN]))
