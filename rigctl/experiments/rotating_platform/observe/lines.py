"""Steady lines in the samples: looked for in what the fit of every period leaves, and taken off before a reduction.

What the kept samples of a run leave after every period's fit is transformed with zeros where the platform moves. A
line then shows at its frequency and, weaker, whole modulation frequencies away; these images are known and left out.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats
from scipy.ndimage import uniform_filter1d

from rigctl.analysis.kept import Kept, Packed
from rigctl.analysis.lines import MAX_BINS, FoundLine, LineScan, ScannedRun
from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.rotating_platform.observe.cells import Cells, Columns
from rigctl.experiments.rotating_platform.observe.even_samples import COMMANDED, EvenSamples, filled
from rigctl.experiments.rotating_platform.observe.mask import usual_mask
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, READINGS, Chains

_SEGMENT = 1 << 18
_LEVEL_BINS = 401
_LOWEST = 2.5
_NOTCH = 0.8
_BANDS, _FEWEST_IN_BAND = 24, 30
_IMAGES, _IMAGE_WIDTH = 40, 3.0
_AROUND, _FINER = 4, 8
_ROUNDING = 1e-24
_SCAN, _PEAKS = "scan", "peaks"


@dataclass(frozen=True)
class Spectra:
    """The scan of a recording, and by run and channel how unlikely its highest peak is, in sigma."""

    scan: LineScan
    peaks: Mapping[str, float]


def line_amplitudes(
    chunks: Iterable[Columns], chains: Chains, cells: Cells, lines_hz: Sequence[float]
) -> dict[str, FloatArray]:
    """Cosine and sine of each line, from the start of the run, by channel [m/s2]; shape (2 lines,)."""
    found: dict[str, FloatArray] = {}
    gram = {channel: np.zeros((2 * len(lines_hz), 2 * len(lines_hz))) for channel in CHANNELS}
    along = {channel: np.zeros(2 * len(lines_hz)) for channel in CHANNELS}
    for block in _left(chunks, chains, cells):
        waves = block.project(_waves(block.time_s, lines_hz))
        for channel in CHANNELS:
            gram[channel] += waves @ waves.T
            along[channel] += waves @ block.left[channel]
    for channel in CHANNELS:
        found[channel] = np.asarray(np.linalg.lstsq(gram[channel], along[channel], rcond=1e-9)[0])
    return found


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


def found_lines(found: Spectra, periods_s: Iterable[float], alpha: float = 0.01, most: int = 3) -> list[FoundLine]:
    """The steady lines of a recording modulated with `periods_s`, without the images of stronger ones.

    The powers of all runs in units of their noise add up at each frequency, whatever the phases.
    """
    scan = found.scan
    if not scan.groups:
        return []
    bins = min(sums.shape[1] for sums in scan.groups.values())
    halves = np.zeros((2, 4, bins))
    for (_, half), sums in scan.groups.items():
        halves[half] += sums[:, :bins]
    count, power, _, inverse = halves.sum(axis=0)
    frequency_hz = np.arange(bins) * scan.step_hz
    open_ = (count > 0.5) & (inverse > 0.0)
    log_p = np.where(open_, _log_tail(power, np.maximum(count, 0.5)), 0.0)
    trials = float(open_.sum())
    tones = [1.0 / period_s for period_s in set(periods_s)]
    near_hz = _IMAGE_WIDTH / max(scan.shortest_s, 1.0)
    kept: list[FoundLine] = []
    while len(kept) < most:
        score = np.where(log_p < 0.9 * log_p.min(), power - count, -np.inf)
        at = int(np.argmax(score))
        p_value = float(-np.expm1(trials * np.log1p(-min(math.exp(max(log_p[at], -700.0)), 0.5))))
        if not p_value < alpha or not 0 < at < bins - 1:
            break
        kept.append(_line_at(at, p_value, halves, scan))
        own = kept[-1].frequency_hz
        for tone_hz in tones:
            for order in range(-_IMAGES, _IMAGES + 1):
                apart = np.minimum(
                    np.abs(frequency_hz - own - order * tone_hz), np.abs(frequency_hz + own + order * tone_hz)
                )
                log_p[apart < near_hz] = 0.0
    return kept


def _line_at(at: int, p_value: float, halves: FloatArray, scan: LineScan) -> FoundLine:
    """Size and place of a line from the powers of all runs, and how well one half of them foretells the other."""
    count, power, _, inverse = halves[:, :, at].sum(axis=0)
    around = halves[:, 1, at - 1 : at + 2].sum(axis=0)
    bend = around[0] - 2.0 * around[1] + around[2]
    shift = float(np.clip(0.5 * (around[0] - around[2]) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0
    square = max(float((power - count) / inverse), np.finfo(float).tiny)
    amplitude = math.sqrt(square)
    sigma = math.sqrt(max(2.0 * power - count, count)) / float(inverse) / (2.0 * amplitude)
    left = before = 0.0
    for test, other in ((0, 1), (1, 0)):
        if halves[other, 3, at] > 0.0:
            known = (halves[other, 1, at] - halves[other, 0, at]) / halves[other, 3, at]
            left += halves[test, 0, at] + abs(halves[test, 1, at] - halves[test, 0, at] - known * halves[test, 3, at])
            before += halves[test, 1, at]
    ratio = math.sqrt(left / before) if before > 0.0 else 1.0
    return FoundLine((at + shift) * scan.step_hz, amplitude, sigma, p_value, ratio, _aliases(at * scan.step_hz, scan))


def _log_tail(power: FloatArray, count: FloatArray) -> FloatArray:
    """Logarithm of the probability that so many exponentials add up to more."""
    with np.errstate(divide="ignore"):
        found = stats.gamma.logsf(power, count)
    # A strong line's is beyond the range of floats: the first term of the tail's expansion.
    far = power > 10.0 * count + 100.0
    beyond = (count - 1.0) * np.log(np.maximum(power, 1.0)) - power - special.gammaln(count)
    return np.where(far, beyond, found)


def _aliases(frequency_hz: float, scan: LineScan) -> tuple[float, ...]:
    """The next true frequencies that look the same at every sampling rate there was."""
    slowest, width = scan.rates_hz[0], 1.0 / scan.longest_s
    same = []
    for k in range(1, 20):
        for true in (k * slowest - frequency_hz, k * slowest + frequency_hz):
            if all(abs(abs(true - round(true / rate) * rate) - frequency_hz) < width for rate in scan.rates_hz):
                same.append(float(true))
    return tuple(same[:4])


def refined(
    runs: Iterable[tuple[Cells, Iterable[Columns]]], chains: Chains, near_hz: float, step_hz: float
) -> tuple[float, float]:
    """Where a line is, from the samples of all runs, some `step_hz` about a first guess, and its amplitude.

    What every period gives is shifted down once; small further shifts act on the periods alone.
    """
    apart = np.linspace(-_AROUND * step_hz, _AROUND * step_hz, 2 * _AROUND * _FINER + 1)
    power, weight, count = np.zeros(apart.size), 0.0, 0.0
    for cells, chunks in runs:
        sums: dict[str, list[ComplexArray]] = {channel: [] for channel in CHANNELS}
        square, kept = dict.fromkeys(CHANNELS, 0.0), 0.0
        for block in _left(chunks, chains, cells):
            down = np.exp(-2j * np.pi * near_hz * block.time_s)
            for channel in CHANNELS:
                left = block.left[channel]
                sums[channel].append((left * down).reshape(len(block.whole), -1).sum(axis=1))
                square[channel] += float(left @ left)
            kept += float(block.kept.sum() * block.whole.sum())
        for channel in CHANNELS:
            each = np.concatenate([np.zeros(0, dtype=np.complex128), *sums[channel]])
            middle_s = (np.arange(each.size) + 0.5) * cells.period_s
            shifted = np.exp(-2j * np.pi * np.outer(apart, middle_s)) @ each
            power += np.abs(shifted) ** 2 / max(square[channel], np.finfo(float).tiny)
            # An amplitude's noise is that of the sum over half the samples.
            weight += 0.25 * kept**2 / max(square[channel], np.finfo(float).tiny)
            count += 1.0
    at = int(np.clip(np.argmax(power), 1, power.size - 2))
    bend = power[at - 1] - 2.0 * power[at] + power[at + 1]
    shift = 0.5 * (power[at - 1] - power[at + 1]) / bend if bend < 0.0 else 0.0
    frequency_hz = float(near_hz + apart[at] + np.clip(shift, -0.5, 0.5) * (apart[1] - apart[0]))
    return frequency_hz, math.sqrt(max(float(power[at]) - count, 0.0) / max(weight, np.finfo(float).tiny))


def spectra(kept: Kept, runs: Mapping[str, tuple[Cells, Iterable[Columns]]], chains: Chains) -> Spectra:
    """The scan of these runs, kept as long as the runs are the same."""
    names = [f"{run_id} {channel}" for run_id in runs for channel in CHANNELS]
    before = kept.get(_SCAN, _unpacked)
    if before is not None and list(before.peaks) == names:
        return before
    scan, peaks = LineScan(), {}
    for run_id, (cells, chunks) in runs.items():
        half = zlib.crc32(run_id.encode()) & 1
        for channel, parts in _scanned(chunks, chains, cells).items():
            for number, part in enumerate(parts):
                scan.add(f"{run_id} {channel} {number}", (channel, half), part)
            peaks[f"{run_id} {channel}"] = _peak(parts)
    packed = scan.packed()
    kept.put(_SCAN, Packed({**packed.head, _PEAKS: peaks}, packed.arrays))
    return Spectra(scan, peaks)


def _unpacked(kept: Packed) -> Spectra:
    return Spectra(LineScan.unpacked(kept), kept.head[_PEAKS])


@dataclass(frozen=True)
class _Block:
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


def _left(chunks: Iterable[Columns], chains: Chains, cells: Cells) -> Iterator[_Block]:
    """What the fit of every period leaves, block by block; zero where the platform moves and in spoilt periods."""
    sampled = usual_mask(cells)
    sign, q = sampled.sign.astype(np.float64), cells.samples
    kept = np.abs(sign)
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
        yield _Block(left, index / cells.sample_rate_hz, kept, basis, whole)
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


def _waves(time_s: FloatArray, lines_hz: Sequence[float]) -> FloatArray:
    phase = 2.0 * np.pi * np.outer(np.asarray(lines_hz, dtype=np.float64), time_s)
    return np.concatenate([np.cos(phase), np.sin(phase)])


def _scanned(chunks: Iterable[Columns], chains: Chains, cells: Cells) -> dict[str, list[ScannedRun]]:
    found: dict[str, list[ScannedRun]] = {channel: [] for channel in CHANNELS}
    for block in _left(chunks, chains, cells):
        usable = max(float(block.whole.sum()), 1.0)
        kept = float(np.tile(block.kept, len(block.whole)) @ np.repeat(block.whole, cells.samples))
        for channel in CHANNELS:
            # What every period has alike comes of the turns and is no line.
            table = block.left[channel].reshape(len(block.whole), -1)
            alike = (table.sum(axis=0) / usable) * block.whole[:, None]
            part = _part((table - alike).ravel(), kept, cells)
            if part is not None:
                found[channel].append(part)
    return found


def _part(left: FloatArray, kept: float, cells: Cells) -> ScannedRun | None:
    """One stretch's powers in units of their level, as the mean of the neighbours' logarithms."""
    rate_hz = cells.sample_rate_hz
    duration_s = left.size / rate_hz
    step_hz = 2.0 ** math.floor(math.log2(0.5 / duration_s))
    length = max(round(rate_hz / step_hz), left.size)
    step_hz = rate_hz / length
    power = np.abs(np.fft.rfft(left, length)[:MAX_BINS]) ** 2
    if kept < 1.0 or power.size < 2 * _LEVEL_BINS or not power.any():
        return None
    power *= (2.0 / kept) ** 2
    frequency: FloatArray = np.asarray(np.arange(power.size) * step_hz)
    logs = np.log(np.maximum(power, np.finfo(float).tiny)) - special.digamma(1.0)
    # Where the periods' mean was taken off there is nothing left to look at.
    apart_hz = np.abs(frequency - np.rint(frequency * cells.period_s) / cells.period_s)
    seen = (frequency > _LOWEST / cells.period_s) & (frequency < 0.5 * rate_hz - 2.0 / duration_s)
    use: FloatArray = np.asarray(seen & (apart_hz > _NOTCH / duration_s), dtype=np.float64)
    if use.sum() < 2 * _LEVEL_BINS:
        return None
    slope, use = _slope(frequency, logs, use)
    smooth = uniform_filter1d((logs - slope) * use, _LEVEL_BINS, mode="constant")
    share = uniform_filter1d(use, _LEVEL_BINS, mode="constant")
    inverse = np.exp(-slope - smooth / np.maximum(share, 1e-9)) * use
    normal = power * inverse
    logarithm = np.log(np.maximum(normal, np.finfo(float).tiny)) * use
    return ScannedRun(step_hz, duration_s, rate_hz, np.stack([use, normal, logarithm, inverse]))


def _slope(frequency: FloatArray, logs: FloatArray, use: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The course of the logarithms over the frequency in broad bands, and what can be used: no band of few bins."""
    where = np.flatnonzero(use)
    at = np.log(frequency[where])
    edges = np.linspace(at[0], at[-1] + 1e-9, _BANDS + 1)
    band = np.searchsorted(edges, at, side="right") - 1
    count = np.bincount(band, minlength=_BANDS)
    full = count >= _FEWEST_IN_BAND
    if full.sum() < 2:
        return np.full(frequency.size, float(logs[where].mean())), use
    middle = np.bincount(band, at, _BANDS)[full] / count[full]
    mean = np.bincount(band, logs[where], _BANDS)[full] / count[full]
    course = np.interp(np.log(np.maximum(frequency, frequency[where[0]])), middle, mean)
    seen = use * (np.log(np.maximum(frequency, frequency[1])) >= middle[0])
    return np.asarray(course), np.asarray(seen)


def _peak(parts: Sequence[ScannedRun]) -> float:
    """The highest peak of a run, as the normal deviate that is as unlikely; about N(0, 1) without a line."""
    log_p, trials = 0.0, 0.0
    for part in parts:
        use, power = part.sums[0], part.sums[1]
        trials += float(use.sum())
        log_p = min(log_p, -float(power.max()))
    if not trials:
        return 0.0
    # One minus the chance that none of so many exponentials is as high.
    none = trials * math.log1p(-math.exp(log_p)) if log_p < 0.0 else -math.inf
    p = -math.expm1(none)
    return float(stats.norm.isf(max(p, 1e-300))) if p < 1.0 else -8.0
