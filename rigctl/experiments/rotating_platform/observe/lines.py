"""What the kept samples of a run leave after every period's fit, and the steady lines in that.

Lines are taken off before a reduction. What is left is transformed with zeros where the platform moves. A line then
shows at its frequency and, weaker, whole modulation frequencies away; these images are known and left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.lines import vertex
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.rotating_platform.observe.cells import Cells, Columns
from rigctl.experiments.rotating_platform.observe.estimates import usual_mask
from rigctl.experiments.rotating_platform.observe.even_samples import COMMANDED, EvenSamples, filled
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, READINGS, Chains

# Samples of a block: each is transformed by itself, in memory that does not grow with the run.
_SEGMENT = 1 << 18
# (1e-12 m/s2)^2 a sample: a command that is straight within periods leaves no more.
_ROUNDING = 1e-24


@dataclass(frozen=True)
class ResidualBlock:
    """Whole periods of a run: `left` of the kept samples (samples,) by channel, their times, and the fits' basis."""

    left: Mapping[str, FloatArray]
    time_s: FloatArray
    kept: FloatArray
    basis: FloatArray
    whole: FloatArray

    def project(self, rows: FloatArray) -> FloatArray:
        """What the fits leave of further rows, shape (k, samples)."""
        periods = len(self.whole)
        table = rows.reshape(len(rows), periods, -1) * self.kept
        table = table - (table @ self.basis.T) @ self.basis
        return np.asarray((table * self.whole[:, None]).reshape(len(rows), -1))


def residual_blocks(chunks: Iterable[Columns], chains: Chains, cells: Cells) -> Iterator[ResidualBlock]:
    """What the fit of every period leaves, block by block; zero where the platform moves and in spoilt periods."""
    sampled = usual_mask(cells)
    sign, q = sampled.sign.astype(np.float64), cells.samples
    kept = np.abs(sign)
    # What the joint fit of a period has: bias and acceleration, each with its slope.
    line = np.stack([kept, kept * sampled.time_s, sign, sign * sampled.time_s])
    basis = np.linalg.qr(line.T)[0].T
    stream = EvenSamples(chains, cells.period_s, cells.sample_rate_hz)
    done = 0
    for last, chunk in _with_end(chunks):
        stream.take(chunk)
        periods = stream.length // q
        if not periods or (stream.length < _SEGMENT and not last):
            continue
        block = stream.block()[:, : periods * q]
        left: dict[str, FloatArray] = {}
        usable = np.ones((len(CHANNELS), periods))
        for number, channel in enumerate(CHANNELS):
            table = np.where(kept > 0.0, block[number].reshape(periods, q), 0.0)
            spoilt = np.any(cells.faults[done : done + periods, number], axis=1)
            spoilt |= ~np.isfinite(table).all(axis=1)
            usable[number] = ~spoilt
            table = np.where(spoilt[:, None], 0.0, table)
            left[channel] = (table - (table @ basis.T) @ basis).ravel()
            commanded = sign * filled(block[COMMANDED][number]).reshape(periods, q)
            commanded = np.where(spoilt[:, None], 0.0, commanded - (commanded @ basis.T) @ basis).ravel()
            size = float(commanded @ commanded)
            if size > _ROUNDING * periods * q:
                # What an external signal bends within a period is no noise.
                left[channel] = left[channel] - commanded * (float(commanded @ left[channel]) / size)
        whole = usable.min(axis=0)
        for channel in CHANNELS:
            left[channel] *= np.repeat(whole, q)
        index = np.arange(done * q, (done + periods) * q, dtype=np.float64)
        yield ResidualBlock(left, index / cells.sample_rate_hz, kept, basis, whole)
        stream.drop(periods * q)
        done += periods


def _with_end(chunks: Iterable[Columns]) -> Iterator[tuple[bool, Columns]]:
    """Chunks with word of which is the last."""
    before: Columns | None = None
    for chunk in chunks:
        if before is not None:
            yield False, before
        before = chunk
    if before is not None:
        yield True, before


_AROUND, _FINER = 4, 8


def line_amplitudes(
    chunks: Iterable[Columns], chains: Chains, cells: Cells, lines_hz: Sequence[float]
) -> dict[str, FloatArray]:
    """Cosine and sine of each line, from the start of the run, by channel [m/s2]; shape (2 lines,)."""
    amplitudes: dict[str, FloatArray] = {}
    gram = {channel: np.zeros((2 * len(lines_hz), 2 * len(lines_hz))) for channel in CHANNELS}
    along = {channel: np.zeros(2 * len(lines_hz)) for channel in CHANNELS}
    for block in residual_blocks(chunks, chains, cells):
        waves = block.project(_waves(block.time_s, lines_hz))
        for channel in CHANNELS:
            gram[channel] += waves @ waves.T
            along[channel] += waves @ block.left[channel]
    for channel in CHANNELS:
        amplitudes[channel] = np.asarray(np.linalg.lstsq(gram[channel], along[channel], rcond=1e-9)[0])
    return amplitudes


def without_lines(
    chunks: Iterable[Columns], chains: Chains, lines_hz: Sequence[float], amplitudes: Mapping[str, FloatArray]
) -> Iterator[Columns]:
    """The samples with lines taken off their readings."""
    first_s: float | None = None
    for chunk in chunks:
        if first_s is None and chunk["t_s"].size:
            first_s = float(chunk["t_s"][0])
        waves = _waves(chunk["t_s"] - (first_s or 0.0), lines_hz)
        mended = {
            READINGS[channel]: chunk[READINGS[channel]]
            - chains.gain_v_per_m_s2[channel] * (amplitudes[channel] @ waves)
            for channel in CHANNELS
        }
        yield {**chunk, **mended}


def refined(
    runs: Iterable[tuple[Cells, Iterable[Columns]]], chains: Chains, near_hz: float, step_hz: float
) -> tuple[float, dict[str, tuple[float, float]]]:
    """Where a line is, from the samples of all runs, some `step_hz` about a first guess.

    And how large it is in each channel, with its standard uncertainty [m/s2]. What every period gives is shifted down
    once; small further shifts act on the periods alone.
    """
    apart = np.linspace(-_AROUND * step_hz, _AROUND * step_hz, 2 * _AROUND * _FINER + 1)
    power = {channel: np.zeros(apart.size) for channel in CHANNELS}
    weight, count = dict.fromkeys(CHANNELS, 0.0), 0.0
    for cells, chunks in runs:
        sums: dict[str, list[ComplexArray]] = {channel: [] for channel in CHANNELS}
        square, seen = dict.fromkeys(CHANNELS, 0.0), 0.0
        for block in residual_blocks(chunks, chains, cells):
            down = np.exp(-2j * np.pi * near_hz * block.time_s)
            for channel in CHANNELS:
                left = block.left[channel]
                sums[channel].append((left * down).reshape(len(block.whole), -1).sum(axis=1))
                square[channel] += float(left @ left)
            # What the fits of the periods take of a wave is not seen of it.
            seen += float(np.sum(block.project(_waves(block.time_s, [near_hz])) ** 2))
        count += 1.0
        for channel in CHANNELS:
            each = np.concatenate([np.zeros(0, dtype=np.complex128), *sums[channel]])
            middle_s = (np.arange(each.size) + 0.5) * cells.period_s
            shifted = np.exp(-2j * np.pi * np.outer(apart, middle_s)) @ each
            # In units of each run's noise: quiet runs tell more.
            noise = max(square[channel], np.finfo(float).tiny)
            power[channel] += np.abs(shifted) ** 2 / noise
            # An amplitude's noise is that of the sum over half the samples.
            weight[channel] += 0.25 * seen**2 / noise
    both = np.sum([power[channel] for channel in CHANNELS], axis=0)
    at = int(np.clip(np.argmax(both), 1, both.size - 2))
    shift, _ = vertex(both[at - 1 : at + 2])
    frequency_hz = float(near_hz + apart[at] + shift * (apart[1] - apart[0]))
    sizes = {
        channel: size_of_line(float(power[channel][at]), count, max(weight[channel], np.finfo(float).tiny))
        for channel in CHANNELS
    }
    return frequency_hz, sizes


def size_of_line(power: float, count: float, weight: float) -> tuple[float, float]:
    """Amplitude and its standard uncertainty by the power in units of the noise, of which there are `count`.

    `weight` is the power that an amplitude of one adds.
    """
    amplitude = math.sqrt(max((power - count) / weight, np.finfo(float).tiny))
    return amplitude, math.sqrt(max(2.0 * power - count, count)) / weight / (2.0 * amplitude)


def _waves(time_s: FloatArray, lines_hz: Sequence[float]) -> FloatArray:
    phase = 2.0 * np.pi * np.outer(np.asarray(lines_hz, dtype=np.float64), time_s)
    return np.concatenate([np.cos(phase), np.sin(phase)])
