"""The published chain's weights in closed form: sums of waves and of what the band-pass does from rest.

A filter of poles p answers a wave u^n that begins at n = 0 with H(u) u^n and decays p^n. The adjoint, the same filter
backwards, answers these with the same waves and with decays from the other end. So each row of weights is a sum of
as many waves as there are lines and of a few decays: nothing is filtered, and no row need be held whole.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.inflight.observe.waves import inverse_of, templates

DROPPED_S = 200.0
"""As published. Shorter than the transient of such a band-pass (950 s), which the templates share."""

_STILL = 1e-13
"""Radians from one sample to the next below which a product of waves stands still."""

_GONE = math.log(1e-20)
"""Of a decay that is no longer worth adding."""

_AT_ONCE = 1 << 14


@dataclass(frozen=True)
class BandPass:
    """A digital filter: h_n = sum of residue pole^n, and `direct` besides at n = 0.

    The poles, by their logarithms, are those above the real axis and then their conjugates.
    """

    log_poles: ComplexArray
    residues: ComplexArray
    direct: complex

    def response(self, turns: ComplexArray) -> ComplexArray:
        """To waves exp(turn n) that have always been."""
        delayed = np.exp(self.log_poles - turns[:, None])
        return np.asarray(self.direct + (self.residues / (1.0 - delayed)).sum(axis=1))

    def decays(self, turns: ComplexArray) -> ComplexArray:
        """Besides, to waves that begin at n = 0: the size of each pole^n, (waves, poles)."""
        delayed = np.exp(self.log_poles - turns[:, None])
        return np.asarray(-self.residues * delayed / (1.0 - delayed))


def band_pass(lowest_hz: float, highest_hz: float, sample_rate_hz: float) -> BandPass:
    """Second-order Butterworth high-pass at half the lowest frequency, low-pass at twice the highest."""
    zeros, poles, gain = _butterworth(0.5 * lowest_hz, sample_rate_hz, "high")
    # At so high a corner a digital low-pass has nothing left to take away.
    if 2.0 * highest_hz < 0.45 * sample_rate_hz:
        low = _butterworth(2.0 * highest_hz, sample_rate_hz, "low")
        zeros, poles, gain = np.concatenate([zeros, low[0]]), np.concatenate([poles, low[1]]), gain * low[2]
    above = poles[poles.imag > 0.0]
    poles = np.concatenate([above, above.conj()])
    others = [np.prod(pole - np.delete(poles, place)) for place, pole in enumerate(poles)]
    residues = gain * np.prod(poles[:, None] - zeros, axis=1) / (poles * np.array(others))
    return BandPass(np.log(poles), residues, complex(gain - residues.sum()))


def _butterworth(
    corner_hz: float, sample_rate_hz: float, passes: Literal["high", "low"]
) -> tuple[FloatArray, ComplexArray, float]:
    """Zeros, poles and gain of second order, as by `scipy.signal.butter`.

    Its import takes longer than reducing a session.
    """
    # By the bilinear transform, warped so that the corner stays where it is.
    s = math.tan(math.pi * corner_hz / sample_rate_hz) * np.exp(0.75j * np.pi * np.array([1.0, -1.0]))
    high = passes == "high"
    gain = np.prod((1.0 if high else -s) / (1.0 - s)).real
    return np.full(2, 1.0 if high else -1.0), np.asarray((1.0 + s) / (1.0 - s)), float(gain)


@dataclass(frozen=True)
class PublishedWeights:
    """Rows w with w s = c, s of each line, s = c cos + s sin, of `count` evenly spaced samples from `first_s` on.

    `on_waves` (2 lines, 2 lines) is of the lines' cosines and sines, from the first sample that is not dropped on.
    `late`, `back` and `early` (2 lines, 2 poles) are of the real and imaginary parts of decays: from the first sample
    on, from the last one back, and from the last that is dropped back. `level` (2 lines,) is subtracted everywhere.
    """

    first_s: float
    step_s: float
    count: int
    lines_hz: tuple[float, ...]
    log_poles: ComplexArray
    on_waves: FloatArray
    late: FloatArray
    back: FloatArray
    early: FloatArray
    level: FloatArray

    @property
    def dropped(self) -> int:
        """Samples whose filtered values are not used."""
        return min(round(DROPPED_S / self.step_s), self.count)

    def rows(self, which: slice = slice(None)) -> FloatArray:
        """The weights of all samples, all rows of them or some."""
        rows = np.empty((len(self.level[which]), self.count))
        for start, stop in self._pieces():
            rows[:, start:stop] = self._piece(which, start, stop)
        return rows

    def squares(self) -> FloatArray:
        """Sums of each row's squares, (2 lines,)."""
        pieces = (self._piece(slice(None), start, stop) for start, stop in self._pieces())
        return np.asarray(sum(np.einsum("rs,rs->r", each, each) for each in pieces))

    def _pieces(self) -> Iterator[tuple[int, int]]:
        for begin, end in pairwise((0, self.dropped, self.count)):
            for start in range(begin, end, _AT_ONCE):
                yield start, min(start + _AT_ONCE, end)

    def _piece(self, which: slice, start: int, stop: int) -> FloatArray:
        size = stop - start
        if start < self.dropped:
            made = self.early[which] @ self._decays(self.dropped - stop, size)[:, ::-1]
        else:
            t_s = np.float64(self.first_s) + np.float64(self.step_s) * np.arange(start, stop)
            made = self.on_waves[which] @ templates(t_s, self.lines_hz)
            made += self.late[which] @ self._decays(start, size)
            made += self.back[which] @ self._decays(self.count - stop, size)[:, ::-1]
        made -= self.level[which, None]
        return np.asarray(made)

    def _decays(self, youngest: int, size: int) -> FloatArray:
        """From an age on; as in `templates`, of a block and within it."""
        within = math.isqrt(size) + 1
        blocks = np.exp(self.log_poles[:, None] * np.arange(youngest, youngest + size, within))
        ages = np.exp(self.log_poles[:, None] * np.arange(within))
        return on_parts((blocks[:, :, None] * ages[:, None]).reshape(len(blocks), -1)[:, :size])


def on_parts(values: ComplexArray) -> FloatArray:
    """Complex (..., k, n) as rows of real and imaginary parts, by turns, (..., 2 k, n)."""
    parts = np.stack([values.real, values.imag], axis=-2)
    return np.asarray(parts.reshape(*values.shape[:-2], -1, values.shape[-1]))


class Streamed:
    """What several weights of one stretch come to, while its series come `most` samples at a time or fewer, an array
    (series, samples, k) of `shape` (series, k).

    Waves and decays of a piece are those of the first one, turned and shrunk by what has passed: products are of rows
    that stay, and no row of weights is made.
    """

    def __init__(self, groups: Sequence[PublishedWeights], most: int, shape: tuple[int, int]) -> None:
        self._groups, first = groups, groups[0]
        self._count, self._dropped = first.count, first.dropped
        self._first_s, self._step_s = first.first_s, first.step_s
        lines_hz = list(dict.fromkeys(f_hz for group in groups for f_hz in group.lines_hz))
        self._lines_of = [[lines_hz.index(f_hz) for f_hz in group.lines_hz] for group in groups]
        self._rates: ComplexArray = 2j * np.pi * np.array(lines_hz)
        self._waves = templates(self._step_s * np.arange(most, dtype=np.float64), lines_hz)
        # Of every group those from the first sample, from the last, and from the last that is dropped.
        self._log_poles = np.concatenate([group.log_poles for group in groups for _ in range(3)])
        self._kind = np.concatenate([np.repeat(range(3), len(group.log_poles)) for group in groups])
        self._decays = np.exp(self._log_poles[:, None] * np.arange(most))
        self._rows: dict[tuple[int, bool, bytes], FloatArray] = {}
        self._on_waves = np.zeros((shape[0], len(self._rates), shape[1]), dtype=np.complex128)
        self._on_decays = np.zeros((shape[0], len(self._log_poles), shape[1]), dtype=np.complex128)
        self._totals = np.zeros(shape)

    def add(self, first: int, series: FloatArray) -> None:
        """Samples from number `first` on, (series, samples, k)."""
        early = min(max(self._dropped - first, 0), series.shape[1])
        for start, part in ((first, series[:, :early]), (first + early, series[:, early:])):
            if part.shape[1]:
                self._add(start, part)
        self._totals += np.ones(series.shape[1]) @ series

    def _add(self, first: int, series: FloatArray) -> None:
        count, late = series.shape[1], first >= self._dropped
        youngest = np.array([first, self._count - first - count, self._dropped - first - count])[self._kind]
        alive = ((self._kind < 2) == late) & (self._log_poles.real * youngest > _GONE)
        product = np.matmul(self._rows_of(count, late, alive), series)
        product = product[:, 0::2] + 1j * product[:, 1::2]
        if late:
            begin = np.exp(self._rates * (self._first_s + self._step_s * first))
            self._on_waves += begin[:, None] * product[:, : len(begin)]
        shrunk = np.exp(self._log_poles[alive] * youngest[alive])
        self._on_decays[:, alive] += shrunk[:, None] * product[:, len(self._rates) if late else 0 :]

    def _rows_of(self, count: int, late: bool, alive: NDArray[np.bool_]) -> FloatArray:
        key = count, late, alive.tobytes()
        if key not in self._rows:
            forwards = self._decays[alive, :count]
            decays = np.where((self._kind[alive] == 0)[:, None], forwards, forwards[:, ::-1])
            self._rows[key] = np.vstack([self._waves[: len(self._waves) if late else 0, :count], on_parts(decays)])
        return self._rows[key]

    def parts(self) -> list[FloatArray]:
        """By weights, w s of every series, (series, 2 lines, k)."""
        parts, at = [], 0
        for group, lines in zip(self._groups, self._lines_of, strict=True):
            part = group.on_waves @ on_parts(self._on_waves[:, lines]) - group.level[:, None] * self._totals[:, None]
            for coefficients in (group.late, group.back, group.early):
                end = at + len(group.log_poles)
                part += coefficients @ on_parts(self._on_decays[:, at:end])
                at = end
            parts.append(np.asarray(part))
        return parts

    def means(self) -> FloatArray:
        """Of every series, (series, k)."""
        return np.asarray(self._totals / self._count)


def published_weights(first_s: float, step_s: float, count: int, lines_hz: Sequence[float]) -> PublishedWeights:
    """The chain's weights of lines; `DataError` when so many samples cannot tell them apart."""
    chain, dropped = band_pass(min(lines_hz), max(lines_hz), 1.0 / step_s), min(round(DROPPED_S / step_s), count)
    rates: ComplexArray = 2j * np.pi * np.array(lines_hz)
    turns, begin = rates * step_s, np.exp(rates * first_s)
    everything = np.concatenate([turns, chain.log_poles])
    # Filtered, by wave and decay: the mean of a wave, which is subtracted first, leaves decays only.
    means = begin * _summed(turns, 0, count) / count
    decays = begin[:, None] * chain.decays(turns) - means[:, None] * chain.decays(np.zeros(1, np.complex128))
    filtered = np.hstack([np.diag(begin * chain.response(turns)), decays])
    inverse = inverse_of(_products(filtered, everything, dropped, count))
    # The same filter backwards: begun at the last sample, and left alone at the first that is not dropped.
    through = filtered * chain.response(-everything)
    back = filtered @ (np.exp(everything[:, None] * (count - 1)) * chain.decays(-everything))
    kept = np.exp(everything * dropped)[:, None] - np.exp(
        everything[:, None] * count + chain.log_poles * (count - dropped)
    )
    shrinking = np.exp(chain.log_poles) * chain.residues / (1.0 - np.exp(everything[:, None] + chain.log_poles))
    early = filtered @ (kept * shrinking)
    sums = through @ _summed(everything, dropped, count)
    sums = sums + back @ _summed(chain.log_poles, 0, count - dropped) + early @ _summed(chain.log_poles, 0, dropped)
    return PublishedWeights(
        first_s,
        step_s,
        count,
        tuple(lines_hz),
        chain.log_poles[: len(chain.log_poles) // 2],
        inverse * np.repeat(np.abs(chain.response(turns)) ** 2, 2),
        inverse @ _of_pairs(through[:, len(turns) :]),
        inverse @ _of_pairs(back),
        inverse @ _of_pairs(early),
        inverse @ on_parts(sums[:, None])[:, 0] / count,
    )


def _products(sizes: ComplexArray, turns: ComplexArray, begin: int, end: int) -> FloatArray:
    """Of the real and imaginary parts of sums of exp(turn n), by twos, over n from `begin` to before `end`."""
    alike = sizes @ _summed(turns[:, None] + turns, begin, end) @ sizes.T
    against = sizes @ _summed(turns[:, None] + turns.conj(), begin, end) @ sizes.conj().T
    products = np.empty((2 * len(sizes), 2 * len(sizes)))
    products[0::2, 0::2] = 0.5 * (against + alike).real
    products[1::2, 1::2] = 0.5 * (against - alike).real
    products[0::2, 1::2] = 0.5 * (alike - against).imag
    products[1::2, 0::2] = products[0::2, 1::2].T
    return products


def _summed(turns: ComplexArray, begin: int, end: int) -> ComplexArray:
    """Of exp(turn n), over n from `begin` to before `end`."""
    still = np.abs(turns) < _STILL
    moving = np.where(still, -1.0, turns)
    ratio = np.exp(moving * begin) * np.expm1(moving * (end - begin)) / np.expm1(moving)
    return np.asarray(np.where(still, end - begin, ratio))


def _of_pairs(sizes: ComplexArray) -> FloatArray:
    """Sizes (lines, decays) of decays and of their conjugates as those of real and imaginary parts, by rows of a real
    and an imaginary part, (2 lines, decays)."""
    above, below = np.split(sizes, 2, axis=1)
    return on_parts(np.stack([above + below, 1j * (above - below)], axis=2).reshape(len(sizes), -1))
