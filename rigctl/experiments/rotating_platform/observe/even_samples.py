"""A run's columns as rows of samples on an even time base, in calibrated units; what was lost of them is NaN."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, Int64Array
from rigctl.experiments.rotating_platform.observe.cells import Columns
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, COMMANDS, READINGS, Chains

MOVING, THETA, COMMANDED, TEMPERATURE, OWN = 2, 3, slice(4, 6), 6, slice(7, None)
"""Rows after the readings of `CHANNELS`: the flag, the angle [rad], the commands of `CHANNELS` [m/s2], [degC], and a
laboratory's own columns."""

_FORMAT_COLUMNS = {"t_s", "theta_deg", "moving", "temperature_c", *READINGS.values(), *COMMANDS.values()}

# Written times are rounded: a stated rate this near to their steps is the truer one.
_SAME_RATE = 2e-3
_WRAPPED_TURN = 0.75


class EvenSamples:
    """Takes chunks of any length and holds their rows until they are dropped: readings [m/s2], then as above."""

    def __init__(self, chains: Chains, period_s: float, sample_rate_hz: float) -> None:
        self._chains, self._period_s, self._nominal_rate_hz = chains, period_s, sample_rate_hz
        self.rate_hz, self.samples, self.length = math.nan, 0, 0
        self._step_s = self._last_s = math.nan
        self._angle = _Unwrapped()
        self.own: tuple[str, ...] = ()
        self._waiting: list[FloatArray] = []

    def take(self, chunk: Columns) -> None:
        """Add a chunk."""
        t_s = chunk["t_s"]
        if not t_s.size:
            return
        if not self.samples:
            self._set_rate(t_s)
            self.own = tuple(sorted(set(chunk) - _FORMAT_COLUMNS))
        # A step of several samples is a gap, which NaN fills, so that sample k of a period stays sample k.
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
        """All rows that are held, shape (7 and as many as `own` names, `length`)."""
        if len(self._waiting) > 1:
            self._waiting = [np.concatenate(self._waiting, axis=1)]
        return self._waiting[0]

    def drop(self, samples: int) -> None:
        """The first `samples` are no longer needed."""
        self._waiting = [self.block()[:, samples:]]
        self.length -= samples

    def _set_rate(self, t_s: FloatArray) -> None:
        step_s = float(np.median(np.diff(t_s))) if t_s.size > 1 else 1.0 / self._nominal_rate_hz
        near = abs(self._nominal_rate_hz * step_s - 1.0) < _SAME_RATE
        self.rate_hz = self._nominal_rate_hz if near else 1.0 / step_s
        self._step_s = step_s
        self.samples = max(round(self._period_s * self.rate_hz), 1)
        self._last_s = float(t_s[0]) - step_s

    def _rows(self, chunk: Columns) -> FloatArray:
        size = chunk["t_s"].size
        rows = [chunk[READINGS[name]] / self._chains.gain_v_per_m_s2[name] for name in CHANNELS]
        rows += [chunk["moving"], self._angle.on(np.deg2rad(chunk["theta_deg"]))]
        for name in CHANNELS:
            command = chunk.get(COMMANDS[name])
            rows.append(np.zeros(size) if command is None else command / self._chains.command_v_per_m_s2[name])
        rows += [chunk.get(name, np.full(size, np.nan)) for name in ("temperature_c", *self.own)]
        return np.stack(rows)


class _Unwrapped:
    """An angle whose encoder begins anew after a whole turn, made to go on; chunk after chunk."""

    def __init__(self) -> None:
        self._last_rad = math.nan
        self._turns = 0.0

    def on(self, theta_rad: FloatArray) -> FloatArray:
        """The next samples; what was lost stays so."""
        known = np.flatnonzero(np.isfinite(theta_rad))
        if not known.size:
            return theta_rad
        before = self._last_rad if math.isfinite(self._last_rad) else theta_rad[known[0]]
        steps = np.diff(theta_rad[known], prepend=before) / (2.0 * np.pi)
        # Half a turn may pass unseen while samples are lost; no encoder's step is three quarters.
        turns = self._turns - np.cumsum(np.where(np.abs(steps) > _WRAPPED_TURN, np.rint(steps), 0.0))
        self._last_rad, self._turns = float(theta_rad[known[-1]]), float(turns[-1])
        going_on = theta_rad.copy()
        going_on[known] += 2.0 * np.pi * turns
        return going_on


def held(moving: FloatArray, theta_rad: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Moving and angle with what was lost filled in, and where that tells the stop at which the platform rests.

    The flag is believed wherever it was recorded: a turn begins by it, whatever became of the angle.
    """
    flagged, known = np.isfinite(moving), np.isfinite(theta_rad)
    if flagged.all() and known.all():
        return moving, theta_rad, np.ones(known.size, dtype=np.bool_)
    before, after = _beside(known)
    turned = (np.cos(theta_rad[before]) > 0.0) != (np.cos(theta_rad[after]) > 0.0)
    flag_before, flag_after = (moving[each] for each in _beside(flagged))
    # A stop that changed meanwhile was a turn, and what nobody knows counts as moving: such samples are never used.
    moving = np.nan_to_num(np.where(flagged, moving, np.where(turned, 1.0, flag_before)), nan=1.0)
    # Between rest and a turn nobody knows where the one ended and the other began.
    certain = flagged | (flag_before == flag_after)
    stretch = np.cumsum(np.diff(moving != 0.0, prepend=False))
    at_before, at_after = (known[each] & (stretch[each] == stretch) for each in (before, after))
    filled_in = np.nan_to_num(theta_rad[np.where(at_after & ~at_before, after, before)])
    return moving, filled_in, certain & (at_before | at_after)


def _beside(known: BoolArray) -> tuple[Int64Array, Int64Array]:
    """Of each sample, the last known one up to it and the first from it on, or the other where there is none."""
    index = np.arange(known.size)
    before = np.maximum.accumulate(np.where(known, index, -1))
    after = np.minimum.accumulate(np.where(known, index, known.size)[::-1])[::-1]
    before = np.where(before < 0, np.minimum(after, known.size - 1), before)
    return before, np.where(after >= known.size, before, after)


def filled(values: FloatArray) -> FloatArray:
    """What was commanded while samples were lost: straight lines between what is known; 0 where nothing is."""
    known = np.isfinite(values)
    if known.all():
        return values
    if not known.any():
        return np.zeros(values.size)
    index = np.arange(values.size)
    return np.asarray(np.interp(index, index[known], values[known]))
