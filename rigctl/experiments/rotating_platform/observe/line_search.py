"""Steady lines in the spectra of a recording, without the images of stronger ones."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy import special, stats

from rigctl.analysis.line_scan import FoundLine, LineScan
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.line_spectra import Spectra

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
    kept: list[FoundLine] = []
    while len(kept) < most:
        score = np.where(log_p < 0.9 * log_p.min(), power - count, -np.inf)
        at = int(np.argmax(score))
        p_value = float(-np.expm1(trials * np.log1p(-min(math.exp(max(log_p[at], -700.0)), 0.5))))
        if not p_value < alpha or not 0 < at < bins - 1:
            break
        kept.append(_line_at(at, p_value, halves, scan))
        line_hz = kept[-1].frequency_hz
        for tone_hz in tones:
            for order in range(-_IMAGES, _IMAGES + 1):
                apart = np.minimum(
                    np.abs(frequency_hz - line_hz - order * tone_hz), np.abs(frequency_hz + line_hz + order * tone_hz)
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
    return FoundLine(
        (at + shift) * scan.step_hz, amplitude, sigma, p_value, ratio, scan.aliases_hz(at * scan.step_hz)
    )


def _log_tail(power: FloatArray, count: FloatArray) -> FloatArray:
    """Logarithm of the probability that so many exponentials add up to more."""
    with np.errstate(divide="ignore"):
        log_tail = stats.gamma.logsf(power, count)
    # A strong line's is beyond the range of floats: the first term of the tail's expansion.
    far = power > 10.0 * count + 100.0
    beyond = (count - 1.0) * np.log(np.maximum(power, 1.0)) - power - special.gammaln(count)
    return np.where(far, beyond, log_tail)
