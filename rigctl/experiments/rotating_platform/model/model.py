"""Baseline and effects as a function of parameters, for all modulated runs of a recording.

The baseline is linear: one tilt gain and two accelerations for all runs, and of every run level and rate of each
bias. It is reduced exactly as the readings are, sample by sample. Effects are small: what they add is worked out cell
by cell along the chain, and reduced alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from rigctl.analysis.least_squares import Parameter
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.model.alike_biases import READING, AlikeBiases, alike_biases, is_curve
from rigctl.experiments.rotating_platform.model.chain import PlatformRuns, turned
from rigctl.experiments.rotating_platform.model.recorded_runs import MISMATCH, OF_A_RUN, SHARED, Recorded
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS
from rigctl.workbench.asked_again import once_in_a_row
from rigctl.workbench.other_minima import OtherMinimum
from rigctl.workbench.placed import (
    EffectParameter,
    Placed,
    fit_parameter,
    sizes_for,
)
from rigctl.workbench.study import Observations, Term

# Small beside what they are steps of: a gain of 1, tilts and biases of 1e-3 m/s2, their change over hours.
_SHARED_STEPS = np.array([1e-3, 1e-6, 1e-6])
_BIAS_STEP, _RATE_STEP = 1e-6, 1e-9
_STEP_OF_TYPICAL = 1e-3
# Below is the rounding of the reduction: brought to unit length it would be scored like an effect.
_NEGLIGIBLE_SIGMAS = 1e-7
_KEPT_AT_REST = 4


class PlatformModel:
    """Baseline and effects; parameters as files and commands name them."""

    def __init__(self, recorded: Recorded, placed: Sequence[Placed], terms: Sequence[Term]) -> None:
        self.recorded = recorded
        self._here: tuple[bytes, FloatArray] | None = None
        self.placed = tuple(placed)
        self.terms = tuple(terms)
        runs = recorded.run_ids
        fixed = () if recorded.tilted else SHARED[:1]
        names = [*SHARED, *(f"{name}[{run_id}]" for name in OF_A_RUN for run_id in runs)]
        units = ["1", "m/s2", "m/s2", *(["m/s2"] * 2 * len(runs)), *(["m/s3"] * 2 * len(runs))]
        start = recorded.start.tolist()
        if recorded.off_stops is not None:
            names, units, start = [*names, MISMATCH], [*units, "1"], [*start, 0.0]
        added = [parameter for each in self.placed for parameter in each.parameters]
        self._baseline_size = len(names)
        self.parameters: Sequence[Parameter] = (
            *(Parameter(n, at, fixed=n in fixed) for n, at in zip(names, start, strict=True)),
            *(fit_parameter(each) for each in added),
        )
        self.units: Sequence[str] = (*units, *(each.unit for each in added))
        self.owners: Sequence[str] = (
            *([""] * self._baseline_size),
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
        recorded = self.recorded
        predicted = recorded.baseline @ values[: recorded.start.size] + recorded.commanded_y
        if recorded.off_stops is not None:
            gain = self._mismatched(values[recorded.start.size])
            predicted = predicted + gain * (recorded.off_stops @ np.append(values[: len(SHARED)], 1.0))
        return np.asarray(predicted + self.added(values))

    def _mismatched(self, mismatch: float) -> FloatArray:
        """By how much each datum's chain reads more of the other's acceleration than that chain does, shape (n,)."""
        return np.where(self.recorded.of_z, 1.0 / (1.0 + mismatch) - 1.0, mismatch)

    def added(self, values: FloatArray) -> FloatArray:
        """What the effects add to the observables of the baseline; shape (n,)."""
        if not self.placed:
            return np.zeros(len(self.observations.value))
        amplitudes = values[self._baseline_size :]
        sizes, at = [], 0
        for each in self.placed:
            sizes.append(amplitudes[at : at + len(each.parameters)])
            at += len(each.parameters)
        return self.recorded.reduced({channel: self._added_to(channel, values, sizes) for channel in CHANNELS})

    def added_here(self, values: FloatArray) -> FloatArray:
        """The same, kept for the point where all candidates are asked for."""
        key = np.asarray(values, dtype=np.float64).tobytes()
        if self._here is None or self._here[0] != key:
            self._here = key, self.added(values)
        return self._here[1]

    def _added_to(self, channel: str, values: FloatArray, sizes: Sequence[FloatArray]) -> FloatArray:
        run = at_rest(self.recorded, channel, values)
        before = run.along + run.signal

        def passed(point: str, at: PlatformRuns, signal: FloatArray) -> FloatArray:
            for each, arguments in zip(self.placed, sizes, strict=True):
                if each.effect.on == point and not each.effect.scanned:
                    signal = signal + each.effect(at.at(signal=signal), **sizes_for(channel, each, arguments))
            return signal

        turns = any(each.effect.on == "platform_angle_rad" for each in self.placed)
        moved = turned(run, passed("platform_angle_rad", run, np.zeros(run.t.size))) if turns else run
        reading = passed("reading_m_s2", moved, passed("force_m_s2", moved, moved.along) + run.signal)
        # What effects add only: the baseline is a thousand times the noise and is reduced exactly, sample by sample.
        return np.asarray(reading - before)

    def elsewhere(self, values: FloatArray) -> list[OtherMinimum]:
        """Of a chain's curves: with biases that are alike in all runs."""
        found, first = [], self._baseline_size
        for each in self.placed:
            for number, parameter in enumerate(each.parameters):
                place = first + number
                if (alike := self.alike_biases(values, each, parameter.channel, float(values[place]))) is not None:
                    there = alike_there(self.recorded, parameter.channel, values, alike)
                    found.append(OtherMinimum({place: alike.size, **there}, place, alike.likelier))
            first += len(each.parameters)
        return found

    def alike_biases(self, values: FloatArray, one: Placed, channel: str, size: float) -> AlikeBiases | None:
        """Of an effect with this size in a channel, whether in the model or not; None for what is no curve."""
        # What is proposed was not measured: it has no bias yet.
        if one.effect.on != READING or not channel or self.recorded.imagined:
            return None
        run = at_rest(self.recorded, channel, values)
        if not is_curve(one, run):
            return None
        return alike_biases(one, run, values[self.recorded.places("bias", channel)], size)

    @once_in_a_row
    def jacobian(self, values: FloatArray) -> FloatArray:
        """d predict / d values, shape (n, m)."""
        values = np.asarray(values, dtype=np.float64)
        derivatives = np.zeros((len(self.observations.value), values.size))
        recorded = self.recorded
        derivatives[:, : recorded.start.size] = recorded.baseline
        if recorded.off_stops is not None:
            mismatch = values[recorded.start.size]
            seen = recorded.off_stops @ np.append(values[: len(SHARED)], 1.0)
            derivatives[:, recorded.start.size] = seen * np.where(recorded.of_z, -1.0 / (1.0 + mismatch) ** 2, 1.0)
            derivatives[:, : len(SHARED)] += (
                self._mismatched(mismatch)[:, None] * recorded.off_stops[:, : len(SHARED)]
            )
        if not self.placed:
            return derivatives
        first = self._baseline_size
        for each in self.placed:
            for together in _moved_together(each.parameters):
                columns = [first + number for number in together]
                slope = self._slope(values, columns, _STEP_OF_TYPICAL * abs(each.parameters[together[0]].typical))
                for number, column in zip(together, columns, strict=True):
                    derivatives[:, column] = self.recorded.of_channel(each.parameters[number].channel, slope)
            first += len(each.parameters)
        if not self._on_baseline:
            return derivatives
        for column in range(len(SHARED)):
            derivatives[:, column] += self._slope(values, [column], float(_SHARED_STEPS[column]))
        runs = len(self.recorded.run_ids)
        of_runs = len(SHARED) + np.arange(len(OF_A_RUN) * runs).reshape(-1, len(CHANNELS), runs)
        for of_kind, step in zip(of_runs, (_BIAS_STEP, _RATE_STEP), strict=True):
            # All runs and channels in one difference: the level of a run moves its own rows only.
            slope = self._slope(values, of_kind.ravel().tolist(), step)
            for one, rows in zip(self.recorded.channels, self.recorded.rows, strict=True):
                run = self.recorded.run_ids.index(one.run.run_id)
                derivatives[rows, of_kind[CHANNELS.index(one.channel), run]] += slope[rows]
        return derivatives

    @cached_property
    def _on_baseline(self) -> bool:
        """Whether what the effects add depends on the baseline's parameters."""
        typical = [parameter.typical for each in self.placed for parameter in each.parameters]
        # With and without tilt and bias of the usual size.
        here, there = np.zeros((2, len(self.parameters)))
        here[self._baseline_size :] = there[self._baseline_size :] = typical
        there[: len(SHARED)] = (1.0, 1e-3, 1e-3)
        there[len(SHARED) : len(SHARED) + len(CHANNELS) * len(self.recorded.run_ids)] = 1e-3
        return bool(np.any(self.added(here) != self.added(there)))

    def _slope(self, values: FloatArray, columns: Sequence[int], step: float) -> FloatArray:
        above, below = values.copy(), values.copy()
        above[list(columns)] += step
        below[list(columns)] -= step
        # Central: exact for the squares and products that effects make of the baseline.
        return np.asarray((self.added(above) - self.added(below)) / (2.0 * step))


def at_rest(recorded: Recorded, channel: str, values: FloatArray) -> PlatformRuns:
    """The chain of a channel with the baseline's accelerations; `signal` is the bias of the baseline."""
    # Candidates and amplitudes are asked for one after the other at one fit.
    kept, key = recorded.kept_at_rest, (channel, values[: recorded.start.size].tobytes())
    if key not in kept:
        while len(kept) >= _KEPT_AT_REST:
            del kept[next(iter(kept))]
        kept[key] = _at_rest(recorded, channel, values)
    return kept[key]


def _at_rest(recorded: Recorded, channel: str, values: FloatArray) -> PlatformRuns:
    run = recorded.chain[channel]
    gain, z0, y0 = values[: len(SHARED)]
    a_z, a_y = gain * run.c_z + z0, y0 + run.c_y
    bias = recorded.of_run(values, "bias", channel) + recorded.of_run(values, "bias_rate", channel) * run.within
    return turned(run.at(a_z=a_z, a_y=a_y, signal=bias), 0.0)


def alike_there(recorded: Recorded, channel: str, values: FloatArray, alike: AlikeBiases) -> dict[int, float]:
    """The baseline's parameters of a channel, by place, where its biases are alike."""
    along = (0, 1) if channel == "z" else (2,)
    biases = zip(recorded.places("bias", channel), alike.levels.tolist(), strict=True)
    return {place: alike.gain * float(values[place]) for place in along} | dict(biases)


def slopes_at_zero(
    model: PlatformModel, values: FloatArray, one: Placed, sigma: FloatArray
) -> tuple[list[EffectParameter], FloatArray]:
    """Derivatives of the data by an effect's amplitudes while there is none of it, shape (n, d).

    What a typical size does not move by a part of `sigma` is nothing.
    """
    wider = PlatformModel(model.recorded, [*model.placed, one], [*model.terms, one.term])
    start = np.concatenate([values, [p.start if p.scanned else 0.0 for p in one.parameters]])
    # Late or filtered, the tilts themselves are read otherwise, however near the axis the sensor is.
    before = wider.added(start) if one.effect.scans else model.added_here(values)
    amplitudes = [p for p in one.parameters if not p.scanned]
    columns = np.zeros((before.size, len(amplitudes)))
    for together in _moved_together(amplitudes):
        moved = start.copy()
        for number in together:
            moved[len(values) + one.parameters.index(amplitudes[number])] = amplitudes[number].typical
        changed = wider.added(moved) - before
        for number in together:
            change = model.recorded.of_channel(amplitudes[number].channel, changed)
            if np.any(np.abs(change) > _NEGLIGIBLE_SIGMAS * sigma):
                columns[:, number] = change / amplitudes[number].typical
    return amplitudes, columns


def slopes_elsewhere(
    model: PlatformModel, values: FloatArray, one: Placed, sigma: FloatArray
) -> tuple[list[EffectParameter], FloatArray] | None:
    """What an effect does for each unit of the amplitudes with which biases are alike, on the way there, (n, d).

    None where it has no other minimum, or that lies too near to do anything.
    """
    amplitudes, there, sizes = list(one.parameters), values.copy(), []
    for each in amplitudes:
        alike = model.alike_biases(values, one, each.channel, 0.0)
        sizes.append(0.0 if alike is None else alike.size)
        if alike is not None:
            for place, value in alike_there(model.recorded, each.channel, values, alike).items():
                there[place] = value
    if not any(sizes):
        return None
    wider = PlatformModel(model.recorded, [*model.placed, one], [*model.terms, one.term])
    changed = wider.added(np.concatenate([there, sizes])) - model.added_here(values)
    columns = np.zeros((changed.size, len(amplitudes)))
    for number, (each, size) in enumerate(zip(amplitudes, sizes, strict=True)):
        change = model.recorded.of_channel(each.channel, changed)
        if size and np.any(np.abs(change) > _NEGLIGIBLE_SIGMAS * sigma):
            columns[:, number] = change / size
    return (amplitudes, columns) if columns.any() else None


def _moved_together(parameters: Sequence[EffectParameter]) -> list[list[int]]:
    """Places of parameters that one difference tells: the same argument of an effect, one of each channel."""
    places: dict[str, list[int]] = {}
    for place, each in enumerate(parameters):
        places.setdefault(each.argument, []).append(place)
    return list(places.values())
