"""Baseline and effects as a function of parameters, for all modulated runs of a recording.

The baseline is linear: one tilt gain and two accelerations for all runs, and of every run level and rate of each
bias. It is reduced exactly as the readings are, sample by sample. Effects are small: what they add is worked out cell
by cell along the chain, and reduced alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy import sparse

from rigctl.analysis.least_squares import Parameter, Prior
from rigctl.core.arrays import FloatArray
from rigctl.effects.catalogue import Effect
from rigctl.experiments.rotating_platform.model.chain import PlatformRuns, off_stop
from rigctl.experiments.rotating_platform.observe.observables import (
    ChannelRun,
    baseline_columns,
    bias_columns,
    own_columns,
    stacked,
)
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.workbench.study import Observations, Term

SHARED = ("tilt_gain", "accel_z0", "accel_y0")
OF_A_RUN = tuple(f"{kind}_{channel}" for kind in ("bias", "bias_rate") for channel in CHANNELS)

_STEPS = np.array([1e-3, 1e-6, 1e-6])
_BIAS_STEP, _RATE_STEP = 1e-6, 1e-9
_FRACTION = 1e-3
_NOTHING = 1e-7
_SCAN_SPREAD = 0.3
_TOLD = 1e-3


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect: its name in the model and in the function, channel ("" for all), unit, start."""

    name: str
    own: str
    channel: str
    unit: str
    start: float
    typical: float
    scanned: bool = False


@dataclass(frozen=True)
class Placed:
    """An effect in a model, with the values of its choice."""

    effect: Effect
    term: Term
    parameters: tuple[EffectParameter, ...]


@dataclass(frozen=True)
class Recorded:
    """The runs of a recording in both channels, as the chain and the vector of observables see them."""

    channels: tuple[ChannelRun, ...]
    g_m_s2: float
    imagined: frozenset[str] = frozenset()
    peaks: Mapping[str, float] | None = None

    @cached_property
    def observations(self) -> Observations:
        """The vector."""
        return stacked(self.channels, self.imagined, self.peaks)

    @cached_property
    def run_ids(self) -> tuple[str, ...]:
        """Of the runs, in order."""
        return tuple(dict.fromkeys(each.run.run_id for each in self.channels))

    @cached_property
    def rows(self) -> list[slice]:
        """Where in the vector each channel of a run stands."""
        bounds = np.cumsum([0, *(each.value.size for each in self.channels)])
        return [slice(int(a), int(b)) for a, b in pairwise(bounds)]

    @cached_property
    def baseline(self) -> FloatArray:
        """Derivatives by the baseline's parameters, shape (n, 3 + 4 runs)."""
        runs = len(self.run_ids)
        found = np.zeros((len(self.observations.value), len(SHARED) + len(OF_A_RUN) * runs))
        for each, rows in zip(self.channels, self.rows, strict=True):
            means, ramps = baseline_columns(each.run.cells, each.channel)
            found[rows, : len(SHARED)] = each.reducer.of(means[:, :3], ramps[:, :3])
            bias = each.reducer.of(*bias_columns(each.run.cells))
            for column, kind in enumerate(("bias", "bias_rate")):
                found[rows, self._place(kind, each)] = bias[:, column]
        return found

    @cached_property
    def tilted(self) -> bool:
        """Whether the commands tell the gain of the tilt from an acceleration that is always there."""
        shared = self.baseline[:, : len(SHARED)] / self.observations.sigma[:, None]
        size = np.linalg.norm(shared, axis=0)
        if not size[0] > 0.0:
            return False
        rest = shared[:, 1:] / np.where(size[1:] > 0.0, size[1:], 1.0)
        found, *_ = np.linalg.lstsq(rest, shared[:, 0], rcond=1e-12)
        return bool(np.linalg.norm(shared[:, 0] - rest @ found) > _TOLD * size[0])

    @cached_property
    def commanded_y(self) -> FloatArray:
        """What the commanded c_Y adds to the observables, shape (n,)."""
        found = np.zeros(len(self.observations.value))
        for each, rows in zip(self.channels, self.rows, strict=True):
            means, ramps = baseline_columns(each.run.cells, each.channel)
            found[rows] = each.reducer.of(means[:, 3:], ramps[:, 3:])[:, 0]
        return found

    def _place(self, kind: str, each: ChannelRun) -> int:
        of_run = OF_A_RUN.index(f"{kind}_{each.channel}")
        return len(SHARED) + of_run * len(self.run_ids) + self.run_ids.index(each.run.run_id)

    def of_run(self, values: FloatArray, kind: str, channel: str) -> FloatArray:
        """Level or rate of a channel's bias at every cell."""
        first = len(SHARED) + OF_A_RUN.index(f"{kind}_{channel}") * len(self.run_ids)
        return np.asarray(values[first : first + len(self.run_ids)][self._run_of(channel)])

    def _run_of(self, channel: str) -> FloatArray:
        return np.concatenate(
            [
                np.full(each.run.cells.period.size, self.run_ids.index(each.run.run_id))
                for each in self.channels
                if each.channel == channel
            ]
        ).astype(np.intp)

    @cached_property
    def chain(self) -> dict[str, PlatformRuns]:
        """All cells of all runs, by channel."""
        return {channel: self._chain(channel) for channel in CHANNELS}

    def _chain(self, channel: str) -> PlatformRuns:
        own = [each for each in self.channels if each.channel == channel]
        cells = [each.run.cells for each in own]
        moving = np.concatenate([off_stop(each) for each in cells], axis=1)

        def joined(of: Callable[[ChannelRun], FloatArray]) -> FloatArray:
            return np.concatenate([of(each) for each in own])

        names = sorted({name for each in own for name in own_columns(each.run.conditions)})
        return PlatformRuns(
            channel=channel,
            t=joined(lambda each: _start_s(each) + each.run.cells.time_s),
            within=joined(
                lambda each: each.run.cells.time_s - 0.5 * each.run.cells.periods * each.run.cells.period_s
            ),
            cos=np.concatenate([each.geometry[:, 0] for each in cells]),
            sin=np.concatenate([each.geometry[:, 1] for each in cells]),
            since=np.concatenate([each.since_s for each in cells]),
            direction=np.concatenate([each.direction for each in cells]),
            speed_squared=moving[0],
            turning=moving[1],
            c_y=np.concatenate([each.state[:, 1] for each in cells]),
            c_z=np.concatenate([each.state[:, 0] for each in cells]),
            temperature=joined(_temperatures),
            period=joined(lambda each: np.full(each.run.cells.period.size, each.run.cells.period_s)),
            g=self.g_m_s2,
            cells=cells,
            columns={
                name: joined(
                    lambda each, name=name: np.full(  # type: ignore[misc]
                        each.run.cells.period.size, own_columns(each.run.conditions).get(name, math.nan)
                    )
                )
                for name in names
            },
        )

    @cached_property
    def operators(self) -> dict[str, sparse.csr_matrix]:
        """By channel, from means over all its cells to the whole vector, (n, cells)."""
        found = {}
        for channel in CHANNELS:
            parts = [
                each.reducer.operator if each.channel == channel else sparse.csr_matrix((each.value.size, 0))
                for each in self.channels
            ]
            rest = sparse.csr_matrix((len(self.observations.value) - self.rows[-1].stop, 0))
            found[channel] = sparse.csr_matrix(sparse.block_diag([*parts, rest]))
        return found

    def reduced(self, added: Mapping[str, FloatArray]) -> FloatArray:
        """The observables of what has these means over all cells of a channel, by channel; shape (n,)."""
        found = np.zeros(len(self.observations.value))
        for channel, means in added.items():
            found += self.operators[channel] @ means
        return found


class PlatformModel:
    """Baseline and effects; parameters as files and commands name them."""

    def __init__(self, recorded: Recorded, placed: Sequence[Placed], terms: Sequence[Term]) -> None:
        self.recorded = recorded
        self.placed = tuple(placed)
        self.terms = tuple(terms)
        runs = recorded.run_ids
        fixed = () if recorded.tilted else SHARED[:1]
        names = [*SHARED, *(f"{name}[{run_id}]" for name in OF_A_RUN for run_id in runs)]
        units = ["1", "m/s2", "m/s2", *(["m/s2"] * 2 * len(runs)), *(["m/s3"] * 2 * len(runs))]
        starts = [1.0, 0.0, 0.0, *([0.0] * len(OF_A_RUN) * len(runs))]
        added = [parameter for each in self.placed for parameter in each.parameters]
        self._own = len(names)
        self.parameters: Sequence[Parameter] = (
            *(Parameter(n, start, fixed=n in fixed) for n, start in zip(names, starts, strict=True)),
            *(_parameter(each) for each in added),
        )
        self.units: Sequence[str] = (*units, *(each.unit for each in added))
        self.owners: Sequence[str] = (
            *([""] * self._own),
            *(each.effect.id for each in self.placed for _ in each.parameters),
        )
        self.local: Sequence[bool] = tuple("[" in name for name in names) + (False,) * len(added)

    @property
    def observations(self) -> Observations:
        """The data, in the order of predictions."""
        return self.recorded.observations

    def predict(self, values: FloatArray) -> FloatArray:
        """The data for parameter values of shape (m,); shape (n,)."""
        values = np.asarray(values, dtype=np.float64)
        found = self.recorded.baseline @ values[: self._own] + self.recorded.commanded_y
        return np.asarray(found + self.added(values))

    def added(self, values: FloatArray) -> FloatArray:
        """What the effects add to the observables of the baseline; shape (n,)."""
        if not self.placed:
            return np.zeros(len(self.observations.value))
        own = values[self._own :]
        sizes, at = [], 0
        for each in self.placed:
            sizes.append(own[at : at + len(each.parameters)])
            at += len(each.parameters)
        return self.recorded.reduced({channel: self._added_to(channel, values, sizes) for channel in CHANNELS})

    def _added_to(self, channel: str, values: FloatArray, sizes: Sequence[FloatArray]) -> FloatArray:
        run = at_rest(self.recorded, channel, values)
        before = run.along + run.signal
        angle = np.zeros(run.t.size)
        passed = [(each.effect, _sizes_for(channel, each, own)) for each, own in zip(self.placed, sizes, strict=True)]
        for effect, own in passed:
            if effect.on == "platform_angle_rad":
                angle = angle + effect(run.at(signal=angle), **own)
        turned = _turned(run, angle)
        bias = run.signal
        force = turned.along
        for effect, own in passed:
            if effect.on == "force_m_s2":
                force = force + effect(turned.at(signal=force), **own)
        reading = force + bias
        for effect, own in passed:
            if effect.on == "reading_m_s2" and not effect.scanned:
                reading = reading + effect(turned.at(signal=reading), **own)
        return np.asarray(reading - before)

    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        values = np.asarray(values, dtype=np.float64)
        found = np.zeros((len(self.observations.value), values.size))
        found[:, : self._own] = self.recorded.baseline
        if not self.placed:
            return found
        parameters = [parameter for each in self.placed for parameter in each.parameters]
        for number, parameter in enumerate(parameters):
            column = self._own + number
            found[:, column] = self._slope(values, [column], _FRACTION * abs(parameter.typical))
        if not self._on_baseline:
            return found
        for column in range(len(SHARED)):
            found[:, column] += self._slope(values, [column], float(_STEPS[column]))
        runs = len(self.recorded.run_ids)
        for kind in range(len(OF_A_RUN)):
            columns = list(range(len(SHARED) + kind * runs, len(SHARED) + (kind + 1) * runs))
            step = _BIAS_STEP if kind < len(CHANNELS) else _RATE_STEP
            slope = self._slope(values, columns, step)
            for each, rows in zip(self.recorded.channels, self.recorded.rows, strict=True):
                found[rows, columns[self.recorded.run_ids.index(each.run.run_id)]] += slope[rows]
        return found

    @cached_property
    def _on_baseline(self) -> bool:
        """Whether what the effects add depends on the baseline's parameters."""
        typical = [parameter.typical for each in self.placed for parameter in each.parameters]
        here, there = np.zeros((2, len(self.parameters)))
        here[self._own :] = there[self._own :] = typical
        there[: len(SHARED)] = (1.0, 1e-3, 1e-3)
        there[len(SHARED) : len(SHARED) + len(CHANNELS) * len(self.recorded.run_ids)] = 1e-3
        return bool(np.any(self.added(here) != self.added(there)))

    def _slope(self, values: FloatArray, columns: Sequence[int], step: float) -> FloatArray:
        above, below = values.copy(), values.copy()
        above[list(columns)] += step
        below[list(columns)] -= step
        return np.asarray((self.added(above) - self.added(below)) / (2.0 * step))


def _parameter(each: EffectParameter) -> Parameter:
    """One to be fitted; what was scanned stays near the value of its scan, where the others are not far."""
    prior = Prior(each.start, _SCAN_SPREAD * each.start) if each.scanned else None
    return Parameter(each.name, each.start, prior=prior)


def at_rest(recorded: Recorded, channel: str, values: FloatArray) -> PlatformRuns:
    """The chain of a channel with the baseline's accelerations; `signal` is the bias of the baseline."""
    run = recorded.chain[channel]
    gain, z0, y0 = values[: len(SHARED)]
    a_z, a_y = gain * run.c_z + z0, y0 + run.c_y
    bias = recorded.of_run(values, "bias", channel) + recorded.of_run(values, "bias_rate", channel) * run.within
    return _turned(run.at(a_z=a_z, a_y=a_y, signal=bias), 0.0)


def _turned(run: PlatformRuns, angle_rad: FloatArray | float) -> PlatformRuns:
    """With what acts along and across the sensing axis, the platform turned on by an angle."""
    cos = run.cos - angle_rad * run.sin
    sin = run.sin + angle_rad * run.cos
    own_y, own_z = run.a_y * cos + run.a_z * sin, run.a_z * cos - run.a_y * sin
    along, across = (own_z, own_y) if run.channel == "z" else (own_y, own_z)
    return run.at(cos=cos, sin=sin, along=along, across=across)


def placed(effect: Effect, term: Term, taken: Sequence[str] = ()) -> Placed:
    """An effect as part of a model; names that others have `taken` get its id before them."""
    found: list[EffectParameter] = []
    for name, unit in effect.parameters.items():
        typical = float(effect.typical[name])
        shown = f"{effect.id}.{name}" if name in taken else name
        if name in effect.scans:
            start = float(term.choice.get(name, typical))
            found.append(EffectParameter(shown, name, "", unit, start, start, scanned=True))
        elif effect.scope == "channel":
            start = 0.1 * typical if effect.scans else 0.0
            found += [EffectParameter(f"{shown}[{c}]", name, c, unit, start, typical) for c in CHANNELS]
        else:
            found.append(EffectParameter(shown, name, "", unit, 0.0, typical))
    return Placed(effect, term, tuple(found))


def slopes_at_zero(
    model: PlatformModel, values: FloatArray, one: Placed, sigma: FloatArray
) -> tuple[list[EffectParameter], FloatArray]:
    """Derivatives of the data by an effect's amplitudes while there is none of it, shape (n, d).

    What a typical size does not move by a part of `sigma` is nothing.
    """
    wider = PlatformModel(model.recorded, [*model.placed, one], [*model.terms, one.term])
    start = np.concatenate([values, [p.start if p.scanned else 0.0 for p in one.parameters]])
    before = wider.added(start)
    amplitudes = [p for p in one.parameters if not p.scanned]
    columns = np.zeros((before.size, len(amplitudes)))
    for number, parameter in enumerate(amplitudes):
        moved = start.copy()
        moved[len(values) + one.parameters.index(parameter)] = parameter.typical
        change = wider.added(moved) - before
        if np.any(np.abs(change) > _NOTHING * sigma):
            columns[:, number] = change / parameter.typical
    return amplitudes, columns


def _sizes_for(channel: str, each: Placed, values: FloatArray) -> dict[str, float]:
    found: dict[str, float] = {}
    for parameter, value in zip(each.parameters, values.tolist(), strict=True):
        if parameter.scanned and not value > 0.0:
            value = parameter.start
        if parameter.channel in ("", channel):
            found[parameter.own] = value
    return found


def _start_s(each: ChannelRun) -> float:
    start_s = float(each.run.conditions.get("start_s", math.nan))
    return start_s if math.isfinite(start_s) else 0.0


def _temperatures(each: ChannelRun) -> FloatArray:
    sampled = each.run.cells.state[:, 2]
    if np.isfinite(sampled).all():
        return sampled
    return np.full(sampled.size, float(each.run.conditions.get("temperature_c", math.nan)))
