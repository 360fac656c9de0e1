"""Spectra, run by run, of what the fits of all periods leave, and the steady lines in them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special
from scipy.ndimage import uniform_filter1d

from rigctl.analysis.kept import Kept, Packed
from rigctl.analysis.line_scan import MAX_BINS, FoundLine, LineScan, ScannedRun
from rigctl.analysis.lines import vertex
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.cells import Cells, Columns
from rigctl.experiments.rotating_platform.observe.lines import ResidualBlock, residual_blocks, size_of_line
from rigctl.experiments.rotating_platform.observe.recorded import CHANNELS, Chains

# A level from so many bins is known to 6 %, pi / sqrt(6 * 401).
_LEVEL_BINS = 401
# In modulation frequencies: below, the fits of each period take most of the power.
_LOWEST = 2.5
# What the periods' mean takes of a line is corrected for up to a quarter (decision 022).
_LEAST_LEFT = 0.75
_BANDS, _FEWEST_IN_BAND = 24, 30
_SCAN, _PEAKS, _ALIKE = "scan", "peaks", "alike"
# Modulation frequencies that are looked at in what all periods have alike.
_MOST_HARMONICS = 4096
# Of the power of a line there: what else may be alike, of which what turns leave behind has a tenth and more beside
# any one frequency; and how much it may differ from period to period, as another line that is near does.
_BESIDE_A_LINE, _UNSTEADY = 0.05, 0.25


@dataclass(frozen=True)
class Spectra:
    """The scan of a recording, and by run and channel how unlikely its highest peak is, in sigma, and what all of the
    run's periods have alike."""

    scan: LineScan
    peaks: Mapping[str, float]
    alike: Mapping[str, Alike]


class Alike(NamedTuple):
    """What the fits of a run's periods leave in all of them, in units of its noise: the square sum of it, `power`, of
    so many `numbers`; how much of that is a sine of `frequency_hz`, a whole multiple of that of the modulation, and
    how much more of its power, in units of that, is not alike."""

    period_s: float
    frequency_hz: float
    of_line: float
    power: float
    numbers: int
    unsteady: float
    amplitude: float
    sigma: float


@dataclass(frozen=True)
class _Part:
    """A stretch of a run as it is scanned; so many of its frequencies are `independent` of each other."""

    scanned: ScannedRun
    independent: float


def spectra(kept: Kept, runs: Mapping[str, tuple[Cells, Iterable[Columns]]], chains: Chains) -> Spectra:
    """The scan of these runs, in order of time; kept as long as the runs are the same."""
    names = [f"{run_id} {channel}" for run_id in runs for channel in CHANNELS]
    before = kept.get(_SCAN, _unpacked)
    if before is not None and list(before.peaks) == names:
        return before
    scan, peaks, alike = LineScan(), {}, dict[str, Alike]()
    for number_of_run, (run_id, (cells, chunks)) in enumerate(runs.items()):
        # By the place in time and not by the name, which means nothing.
        half = number_of_run & 1
        scanned, common = _scanned(chunks, chains, cells)
        alike |= {f"{run_id} {channel}": each for channel, each in common.items()}
        for channel, parts in scanned.items():
            for number, part in enumerate(parts):
                scan.add(f"{run_id} {channel} {number}", (channel, half), part.scanned)
            peaks[f"{run_id} {channel}"] = _peak(parts)
    packed = scan.packed()
    kept.put(_SCAN, Packed({**packed.head, _PEAKS: peaks, _ALIKE: alike}, packed.arrays))
    return Spectra(scan, peaks, alike)


def _unpacked(kept: Packed) -> Spectra:
    alike = {name: Alike(*each) for name, each in kept.head[_ALIKE].items()}
    return Spectra(LineScan.unpacked(kept), kept.head[_PEAKS], alike)


def _scanned(
    chunks: Iterable[Columns], chains: Chains, cells: Cells
) -> tuple[dict[str, list[_Part]], dict[str, Alike]]:
    """What is scanned, and what all periods have alike, by channel."""
    parts: dict[str, list[_Part]] = {channel: [] for channel in CHANNELS}
    sums, squares, periods = dict.fromkeys(CHANNELS, np.zeros(cells.samples)), dict.fromkeys(CHANNELS, 0.0), 0.0
    powers = dict.fromkeys(CHANNELS, np.zeros(min(cells.samples // 2, _MOST_HARMONICS) + 1))
    first: ResidualBlock | None = None
    for block in residual_blocks(chunks, chains, cells):
        usable = max(float(block.whole.sum()), 1.0)
        kept = float(np.tile(block.kept, len(block.whole)) @ np.repeat(block.whole, cells.samples))
        for channel in CHANNELS:
            # What every period has alike comes of the turns and is no line.
            table = block.left[channel].reshape(len(block.whole), -1)
            of_all = table.sum(axis=0)
            alike = (of_all / usable) * block.whole[:, None]
            part = _part((table - alike).ravel(), kept, cells, block.whole)
            if part is not None:
                parts[channel].append(part)
            sums[channel] = sums[channel] + of_all
            squares[channel] += float(np.vdot(table, table))
            of_periods = np.fft.rfft(table, axis=1)[:, : powers[channel].size]
            powers[channel] = powers[channel] + np.sum(np.abs(of_periods) ** 2, axis=0)
        first, periods = first or block, periods + float(block.whole.sum())
    if first is None or periods < 2.0:
        return parts, {}
    common = {
        channel: _alike(sums[channel], squares[channel], powers[channel] / periods, periods, first, cells)
        for channel in CHANNELS
    }
    return parts, {channel: each for channel, each in common.items() if each is not None}


def _alike(
    total: FloatArray, square: float, powers: FloatArray, periods: float, block: ResidualBlock, cells: Cells
) -> Alike | None:
    """What so many periods have alike, from their sum (samples,), the square sum of all their samples, and the power
    of a period, in the mean, at multiples of the modulation frequency."""
    mean, numbers = total / periods, int(np.sum(block.kept)) - len(block.basis)
    noise = (square - periods * float(mean @ mean)) / ((periods - 1.0) * max(numbers, 1)) / periods
    lowest = math.ceil(_LOWEST)
    if noise <= 0.0 or numbers < 3 or powers.size <= lowest:
        return None
    alike = np.abs(np.fft.rfft(mean)[: powers.size]) ** 2
    strongest = lowest + int(np.argmax(alike[lowest:]))
    unsteady = float(powers[strongest] / max(alike[strongest], np.finfo(float).tiny)) - 1.0
    frequency_hz = strongest / cells.period_s
    time_s = np.arange(cells.samples) / cells.sample_rate_hz
    phase = 2.0 * np.pi * frequency_hz * time_s
    waves = np.stack([np.cos(phase), np.sin(phase)]) * block.kept
    waves = waves - (waves @ block.basis.T) @ block.basis
    sizes = np.linalg.lstsq(waves.T, mean, rcond=None)[0]
    shown = sizes @ waves
    amplitude, sigma = float(np.hypot(*sizes)), math.sqrt(2.0 * noise / float(np.sum(block.kept)))
    of_line, power = float(shown @ shown) / noise, float(mean @ mean) / noise
    return Alike(cells.period_s, frequency_hz, of_line, power, numbers, unsteady, amplitude, sigma)


def _part(left: FloatArray, kept: float, cells: Cells, whole: FloatArray) -> _Part | None:
    """One stretch's powers in units of their level, as the mean of the neighbours' logarithms.

    `whole` are the periods that count, shape (periods,): their mean has been taken off `left`.
    """
    rate_hz = cells.sample_rate_hz
    duration_s = left.size / rate_hz
    step_hz = 2.0 ** math.floor(math.log2(0.5 / duration_s))
    length = max(round(rate_hz / step_hz), left.size)
    step_hz = rate_hz / length
    power = np.abs(np.fft.rfft(left, length)[:MAX_BINS]) ** 2
    if kept < 1.0 or power.size < 2 * _LEVEL_BINS or not power.any():
        return None
    # Of a steady wave the periods' mean holds what their phases agree in.
    starts = np.zeros(left.size)
    starts[:: cells.samples] = whole / whole.sum()
    remains = 1.0 - np.abs(np.fft.rfft(starts, length)[:MAX_BINS]) ** 2
    power *= (2.0 / kept) ** 2 / np.maximum(remains, 1.0 - _LEAST_LEFT)
    frequency: FloatArray = np.asarray(np.arange(power.size) * step_hz)
    # The mean logarithm of an exponential variable is digamma(1) below that of its mean.
    logs = np.log(np.maximum(power, np.finfo(float).tiny)) - special.digamma(1.0)
    seen = (frequency > _LOWEST / cells.period_s) & (frequency < 0.5 * rate_hz - 2.0 / duration_s)
    use: FloatArray = np.asarray(seen & (remains > _LEAST_LEFT), dtype=np.float64)
    if use.sum() < 2 * _LEVEL_BINS:
        return None
    # Taken off first: over 401 bins the mean of a steep spectrum would be that of its upper end.
    slope, use = _slope(frequency, logs, use)
    smooth = uniform_filter1d((logs - slope) * use, _LEVEL_BINS, mode="constant")
    share = uniform_filter1d(use, _LEVEL_BINS, mode="constant")
    inverse = np.exp(-slope - smooth / np.maximum(share, 1e-9)) * use
    normal = power * inverse
    logarithm = np.log(np.maximum(normal, np.finfo(float).tiny)) * use
    # A line's power in units of the noise, less what the periods' mean has taken of it.
    inverse = inverse * remains
    # Samples that are left out, and the periods' mean that is taken off, leave as many fewer.
    independent = float(use.sum()) * step_hz * duration_s * (kept / left.size) * (1.0 - 1.0 / float(whole.sum()))
    return _Part(ScannedRun(step_hz, duration_s, rate_hz, np.stack([use, normal, logarithm, inverse])), independent)


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


def _peak(parts: Sequence[_Part]) -> float:
    """The highest peak of a run, as the normal deviate that is as unlikely; about N(0, 1) without a line.

    A peak over a level that so many neighbours tell goes as F; between independent frequencies a spectrum has
    peaks too, sqrt(height) times as many (Baluev, MNRAS 385 (2008) 1279, eq. 6).
    """
    log_p, height = 0.0, 0.0
    for part in parts:
        highest = float(part.scanned.sums[1].max())
        neighbours = _LEVEL_BINS * part.scanned.step_hz * part.scanned.duration_s
        alone = -neighbours * math.log1p(highest / neighbours)
        if alone < log_p:
            log_p, height = alone, highest
    if not height:
        return 0.0
    chances = sum(part.independent for part in parts) * math.sqrt(height) * math.exp(log_p)
    # One minus the chance that there is none as high.
    p = -math.expm1(-chances)
    return float(-special.ndtri(max(p, 1e-300))) if p < 1.0 else -8.0


def harmonic_lines(found: Spectra, alpha: float = 0.01) -> list[FoundLine]:
    """The line, if there is one, whose frequency is a multiple of that of the modulation: all periods have it alike.

    What turns leave behind does so too, but no one sine is nearly all of it. A line that is hardly larger than the
    noise cannot be told from that, and is left to the effects.
    """
    lines = []
    for channel in CHANNELS:
        runs = [each for name, each in found.alike.items() if name.endswith(f" {channel}")]
        if not runs:
            continue
        strongest = max(runs, key=lambda each: each.of_line)
        frequency_hz = strongest.frequency_hz
        seen = [each for each in runs if abs(math.remainder(frequency_hz * each.period_s, 1.0)) < 1e-6]
        numbers = sum(each.numbers for each in seen) - 2 * len(seen)
        of_line = sum(each.of_line for each in seen)
        beside = sum(each.power for each in seen) - of_line - numbers
        sure = beside + 3.0 * math.sqrt(2.0 * numbers) < _BESIDE_A_LINE * of_line
        # One frequency for all runs that can have it so.
        same = all(abs(each.frequency_hz - frequency_hz) < 1e-6 * frequency_hz for each in seen)
        if not (sure and same) or max(each.unsteady for each in seen) > _UNSTEADY:
            continue
        log_p = float(_log_tail(np.array([0.5 * of_line]), np.array([float(len(seen))]))[0])
        p_value = min(_MOST_HARMONICS * math.exp(max(log_p, -700.0)), 1.0)
        if p_value < alpha:
            ratio = math.sqrt((numbers + max(beside, 0.0)) / (numbers + max(beside, 0.0) + of_line))
            size = strongest.amplitude, strongest.sigma
            aliases_hz = found.scan.aliases_hz(frequency_hz) if found.scan.groups else ()
            lines.append(FoundLine(frequency_hz, *size, p_value, ratio, aliases_hz))
    return sorted(lines, key=lambda line: line.p_value)[:1]


_IMAGES, _IMAGE_WIDTH = 40, 3.0


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
    beyond_noise = np.maximum(power - count, 0.0)
    leaked = np.zeros(bins)
    kept: list[FoundLine] = []
    while len(kept) < most:
        # Among places nearly as unlikely the one with the most power beyond the noise.
        score = np.where(log_p < 0.9 * log_p.min(), power - count, -np.inf)
        at = int(np.argmax(score))
        p_value = float(-np.expm1(trials * np.log1p(-min(math.exp(max(log_p[at], -700.0)), 0.5))))
        if not p_value < alpha or not 0 < at < bins - 1:
            break
        kept.append(_line_at(at, p_value, halves, scan))
        for tone_hz in tones:
            # The mask repeats with the period, so a line has images whole modulation frequencies away.
            for image_hz in np.abs(kept[-1].frequency_hz + tone_hz * np.arange(-_IMAGES, _IMAGES + 1)):
                apart = np.abs(frequency_hz - image_hz)
                near = apart < near_hz
                if near.any():
                    open_ = open_ & ~near
                    # Farther away a record of length T shows of it 1 / (pi f T): a strong one beyond the noise.
                    beyond = math.sqrt(float(beyond_noise[near].max()))
                    leaked += beyond / (np.pi * scan.shortest_s * np.maximum(apart, near_hz))
        # A weak line so close to a strong one shows once that is taken off.
        unexplained = np.maximum(power - leaked**2, 0.0)
        log_p = np.where(open_, _log_tail(unexplained, np.maximum(count, 0.5)), 0.0)
    return kept


def _line_at(at: int, p_value: float, halves: FloatArray, scan: LineScan) -> FoundLine:
    """Size and place of a line from the powers of all runs, and how well one half of them foretells the other."""
    count, power, _, inverse = halves[:, :, at].sum(axis=0)
    shift, _ = vertex(halves[:, 1, at - 1 : at + 2].sum(axis=0))
    amplitude, sigma = size_of_line(float(power), float(count), float(inverse))
    left = before = 0.0
    for test, other in ((0, 1), (1, 0)):
        if halves[other, 3, at] > 0.0:
            known = (halves[other, 1, at] - halves[other, 0, at]) / halves[other, 3, at]
            left += halves[test, 0, at] + abs(halves[test, 1, at] - halves[test, 0, at] - known * halves[test, 3, at])
            before += halves[test, 1, at]
    ratio = math.sqrt(left / before) if before > 0.0 else 1.0
    return FoundLine(
        (at + shift) * scan.step_hz, amplitude, sigma, p_value, ratio, scan.aliases_hz(at * scan.step_hz)
    )


def _log_tail(power: FloatArray, count: FloatArray) -> FloatArray:
    """Logarithm of the probability that so many exponentials add up to more."""
    with np.errstate(divide="ignore"):
        log_tail = np.log(special.gammaincc(count, power))
    # A strong line's is beyond the range of floats: the first term of the tail's expansion.
    far = power > 10.0 * count + 100.0
    beyond = (count - 1.0) * np.log(np.maximum(power, 1.0)) - power - special.gammaln(count)
    return np.where(far, beyond, log_tail)
