"""All runs of a recording at once, as the model sees them: baseline columns, chain, reduction of what is added."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from rigctl.core.arrays import BoolArray, FloatArray, IntArray
from rigctl.experiments.rotating_platform.model.chain import Afterwards, PlatformRuns, off_stop
from rigctl.experiments.rotating_platform.model.templates import templates
from rigctl.experiments.rotating_platform.observe.cells import STATE
from rigctl.experiments.rotating_platform.observe.channel_runs import ChannelRun, baseline_columns, bias_columns
from rigctl.experiments.rotating_platform.observe.observables import (
    READ,
    known_start_s,
    own_columns,
    stacked,
    turns_before,
)
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.workbench.study import Observations

SHARED = ("tilt_gain", "accel_z0", "accel_y0")
MISMATCH = "gain_mismatch"
"""(1 + k_y) / (1 + k_z) - 1 of the chains: at the stops each reads its own axis only, between them both (eq. 3)."""

OF_A_RUN = tuple(f"{kind}_{channel}" for kind in ("bias", "bias_rate") for channel in CHANNELS)
# Share of the tilt's column that constant accelerations do not imitate.
_SEPARABLE = 1e-3
# Chains agree in their gains to better than this; what that does not move by a sigma tells nothing of it.
_MISMATCHED = 0.1


@dataclass(frozen=True)
class Recorded:
    """The runs of a recording in both channels, as the chain and the vector of observables see them."""

    channels: tuple[ChannelRun, ...]
    g_m_s2: float
    imagined: frozenset[str] = frozenset()
    peaks: Mapping[str, float] | None = None

    @cached_property
    def observations(self) -> Observations:
        """The vector; nobody asks about shapes in runs that are imagined."""
        if self.imagined:
            return self._stacked
        return replace(self._stacked, templates=templates(self.chain, self.start[: len(SHARED)], self.reduced))

    @cached_property
    def kept_at_rest(self) -> dict[tuple[str, bytes], PlatformRuns]:
        """The chains with the last baselines that were asked for, by channel and the baseline's values."""
        return {}

    @cached_property
    def _stacked(self) -> Observations:
        return stacked(self.channels, self.imagined, self.peaks)

    @cached_property
    def run_ids(self) -> tuple[str, ...]:
        """Of the runs, in order."""
        return tuple(dict.fromkeys(each.run.run_id for each in self.channels))

    @cached_property
    def rows(self) -> list[slice]:
        """Where in the vector each channel of a run stands."""
        starts = np.cumsum([0, *(each.value.size for each in self.channels)])[:-1]
        # Data of spectra stand between measured and imagined runs.
        starts[self._measured :] += self._spectra
        return [slice(int(a), int(a) + each.value.size) for a, each in zip(starts, self.channels, strict=True)]

    def of_channel(self, channel: str, column: FloatArray) -> FloatArray:
        """A column (n,) at the observables of one channel, 0 at the other's; of "" all of it."""
        return column if not channel else np.where(self._is_of[channel], column, 0.0)

    @cached_property
    def _is_of(self) -> dict[str, BoolArray]:
        series = np.array([each.channel for each in self._stacked.series])[self._stacked.series_of]
        return {channel: np.asarray(series == READ[channel]) for channel in CHANNELS}

    @cached_property
    def _measured(self) -> int:
        """How many channels were measured: those of imagined runs come after them."""
        return sum(each.run.run_id not in self.imagined for each in self.channels)

    @cached_property
    def _spectra(self) -> int:
        """How many data are of spectra: they stand after what was measured."""
        return len(self._stacked.value) - sum(each.value.size for each in self.channels)

    @cached_property
    def baseline(self) -> FloatArray:
        """Derivatives by the baseline's parameters, shape (n, 3 + 4 runs)."""
        runs = len(self.run_ids)
        derivatives = np.zeros((len(self._stacked.value), len(SHARED) + len(OF_A_RUN) * runs))
        for each, rows in zip(self.channels, self.rows, strict=True):
            means, ramps = baseline_columns(each.run.cells, each.channel)
            derivatives[rows, : len(SHARED)] = each.reducer.of(means[:, :3], ramps[:, :3])
            bias = each.reducer.of(*bias_columns(each.run.cells))
            for column, kind in enumerate(("bias", "bias_rate")):
                derivatives[rows, self._place(kind, each)] = bias[:, column]
        return derivatives

    @cached_property
    def tilted(self) -> bool:
        """Whether the commands tell the gain of the tilt from an acceleration that is always there."""
        shared = self.baseline[:, : len(SHARED)] / self._stacked.sigma[:, None]
        size = np.linalg.norm(shared, axis=0)
        if not size[0] > 0.0:
            return False
        rest = shared[:, 1:] / np.where(size[1:] > 0.0, size[1:], 1.0)
        coefficients, *_ = np.linalg.lstsq(rest, shared[:, 0], rcond=1e-12)
        return bool(np.linalg.norm(shared[:, 0] - rest @ coefficients) > _SEPARABLE * size[0])

    @cached_property
    def commanded_y(self) -> FloatArray:
        """What the commanded c_Y adds to the observables, shape (n,)."""
        added = np.zeros(len(self._stacked.value))
        for each, rows in zip(self.channels, self.rows, strict=True):
            means, ramps = baseline_columns(each.run.cells, each.channel)
            added[rows] = each.reducer.of(means[:, 3:], ramps[:, 3:])[:, 0]
        return added

    @cached_property
    def off_stops(self) -> FloatArray | None:
        """What each chain reads of the other's axis: columns by `SHARED` and what c_Y adds, shape (n, 4).

        It goes with 1 + `MISMATCH` in Y, with one over that in Z. None where too few samples count off the stops.
        """
        columns = np.zeros((len(self._stacked.value), len(SHARED) + 1))
        for each, rows in zip(self.channels, self.rows, strict=True):
            means, ramps = baseline_columns(each.run.cells, each.channel)
            other = [0, 1] if each.channel == "y" else [2, 3]
            columns[rows, other] = each.reducer.of(means[:, other], ramps[:, other])
        moved = columns @ np.append(self.start[: len(SHARED)], 1.0)
        told = np.linalg.norm(moved / self._stacked.sigma)
        return columns if _MISMATCHED * told > 1.0 else None

    @property
    def of_z(self) -> BoolArray:
        """Which data are of the chain Z, shape (n,)."""
        return self._is_of["z"]

    @cached_property
    def start(self) -> FloatArray:
        """The baseline's parameters as the recorded runs have them, each datum for itself, shape (3 + 4 runs,).

        There a fit begins: what an effect does, and whether the baseline imitates it, depends on them.
        """
        given, start = self._stacked, np.zeros(self.baseline.shape[1])
        start[0] = 1.0
        made = np.array([run_id not in self.imagined for run_id in given.run_ids])[given.run_of]
        # Imagined runs have no values.
        weight = made / given.sigma
        # Without tilts nothing tells their gain: it stays 1.
        free = slice(0 if self.tilted else 1, None)
        left = given.value - self.commanded_y - (0.0 if self.tilted else self.baseline[:, 0])
        start[free] = np.linalg.lstsq(self.baseline[:, free] * weight[:, None], left * weight, rcond=1e-12)[0]
        return start

    def _place(self, kind: str, each: ChannelRun) -> int:
        of_run = OF_A_RUN.index(f"{kind}_{each.channel}")
        return len(SHARED) + of_run * len(self.run_ids) + self.run_ids.index(each.run.run_id)

    def of_run(self, values: FloatArray, kind: str, channel: str) -> FloatArray:
        """Level or rate of a channel's bias at every cell."""
        return np.asarray(values[self.places(kind, channel)][self._run_of[channel]])

    def places(self, kind: str, channel: str) -> range:
        """Where among the baseline's parameters level or rate of a channel's bias stand, run by run."""
        first = len(SHARED) + OF_A_RUN.index(f"{kind}_{channel}") * len(self.run_ids)
        return range(first, first + len(self.run_ids))

    @cached_property
    def _run_of(self) -> dict[str, IntArray]:
        """Which run each cell is of, by channel."""
        found = {}
        for channel in CHANNELS:
            own = [each.run for each in self.channels if each.channel == channel]
            numbers = [self.run_ids.index(run.run_id) for run in own]
            found[channel] = np.repeat(np.array(numbers, dtype=np.intp), [run.cells.period.size for run in own])
        return found

    @cached_property
    def chain(self) -> dict[str, PlatformRuns]:
        """All cells of all runs, by channel."""
        # Of either channel: what turns leave behind does not depend on which sensor feels it.
        afterwards = Afterwards([each.run.cells for each in self.channels if each.channel == CHANNELS[0]])
        return {channel: self._chain(channel, afterwards) for channel in CHANNELS}

    def _chain(self, channel: str, afterwards: Afterwards) -> PlatformRuns:
        runs = [each for each in self.channels if each.channel == channel]
        cells = [each.run.cells for each in runs]
        before = turns_before(self.channels)
        moving = np.concatenate([off_stop(each) for each in cells], axis=1)

        def joined(of: Callable[[ChannelRun], FloatArray]) -> FloatArray:
            return np.concatenate([of(each) for each in runs])

        names = sorted({name for each in runs for name in (*own_columns(each.run.conditions), *each.run.cells.own)})
        return PlatformRuns(
            channel=channel,
            t=joined(lambda each: known_start_s(each.run.conditions) + each.run.cells.time_s),
            within=joined(
                lambda each: each.run.cells.time_s - 0.5 * each.run.cells.periods * each.run.cells.period_s
            ),
            cos=np.concatenate([each.geometry[:, 0] for each in cells]),
            sin=np.concatenate([each.geometry[:, 1] for each in cells]),
            since=np.concatenate([each.since_s for each in cells]),
            turns_in_run=joined(lambda each: np.asarray(each.run.cells.turn_number, np.float64)),
            turns=joined(lambda each: np.asarray(before[each.run.run_id] + each.run.cells.turn_number, np.float64)),
            direction=np.concatenate([each.direction for each in cells]),
            speed_squared=moving[0],
            turning=moving[1],
            c_y=np.concatenate([each.state[:, 1] for each in cells]),
            c_z=np.concatenate([each.state[:, 0] for each in cells]),
            temperature=joined(_temperatures),
            period=joined(lambda each: np.full(each.run.cells.period.size, each.run.cells.period_s)),
            g=self.g_m_s2,
            cells=cells,
            columns={name: np.concatenate([_own_column(each, name) for each in runs]) for name in names},
            afterwards=afterwards,
        )

    @cached_property
    def operators(self) -> dict[str, sparse.csr_matrix]:
        """By channel, from means over all its cells to the whole vector, (n, cells)."""
        return {channel: self._operator(channel) for channel in CHANNELS}

    def _operator(self, channel: str) -> sparse.csr_matrix:
        # A row of the other channel, and of a spectrum, sees no cell of this one.
        counts = np.zeros(len(self._stacked.value), dtype=np.int64)
        values, columns, cells = [], [], 0
        for each, rows in zip(self.channels, self.rows, strict=True):
            if each.channel == channel:
                own = each.reducer.operator
                counts[rows] = np.diff(own.indptr)
                values.append(own.data)
                columns.append(own.indices + cells)
                cells += own.shape[1]
        starts = np.concatenate([[0], np.cumsum(counts)])
        return sparse.csr_matrix((np.concatenate(values), np.concatenate(columns), starts), (counts.size, cells))

    def reduced(self, added: Mapping[str, FloatArray]) -> FloatArray:
        """The observables of what has these means over all cells of a channel, by channel; shape (n,), or (n, k)."""
        return np.asarray(sum(self.operators[channel] @ means for channel, means in added.items()))


def _own_column(each: ChannelRun, name: str) -> FloatArray:
    """A laboratory's own column by cells, of the samples where it is there."""
    cells = each.run.cells
    if name in cells.own:
        return np.asarray(cells.state[:, len(STATE) + cells.own.index(name)])
    return np.full(cells.period.size, own_columns(each.run.conditions).get(name, math.nan))


def _temperatures(each: ChannelRun) -> FloatArray:
    sampled = each.run.cells.state[:, 2]
    if np.isfinite(sampled).all():
        return sampled
    return np.full(sampled.size, float(each.run.conditions.get("temperature_c", math.nan)))
