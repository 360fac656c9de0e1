"""Steady lines of unknown frequency in the residual spectra of many runs: the mains, a machine.

A line has the same amplitude in every run and a phase of its own there, so the runs' powers at its frequency add,
in units of each run's noise (the detector that is best for a weak line of unknown phase). Their noise level is
taken from the neighbouring frequencies. A bump of the noise raises the power too, but its power is exponentially
distributed over the runs (Rayleigh amplitudes), that of a line is not (Rice): Bartlett's statistic, log of the mean
minus mean of the logs, tells them apart whatever the level (Bartlett 1937; it is independent of the sum). Where a
bump may be narrower than the neighbourhood a line must show by it, elsewhere it must not contradict it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special  # not scipy.stats, whose import takes longer than a search for lines
from scipy.ndimage import median_filter

from rigctl.analysis.line_scan import LEVEL_CELLS, FoundLine, LineScan
from rigctl.core.arrays import FloatArray

# In units of 1/T: nearer to zero or to the Nyquist frequency a level has no neighbours on one side.
_FIRST_BIN = 8
# Next neighbours and wider ones, in bins; the two at the line's shoulder hold its own main lobe.
_NEIGHBOURS, _SHOULDER = (6, 24), 2
# Left out at either end of the neighbours: another line among them is no noise.
_TRIMMED = 0.125
# Standard deviations by which the next neighbours must exceed the wider ones to be believed instead.
_BULGE = 2.0
# No bump of the ground's noise is narrower than a thirtieth of its frequency: below, the neighbours may miss it.
_NARROWEST_BUMP = 1.0 / 30.0
# A line is refused where its powers scatter as a line's own would once in ten thousand.
_CONTRADICTED = 1e-4
_BEYOND_FLOATS = -600.0
# Of the logarithm of a run's power, from its own noise level being an estimate.
# The logarithm of an exponential variable has the variance pi^2 / 6.
_LEVEL_VARIANCE = np.pi**2 / 6.0 / LEVEL_CELLS


def find_lines(scan: LineScan, alpha: float = 0.01, most: int = 5) -> list[FoundLine]:
    """The steady lines in a scan, strongest evidence first; false ones with a probability of `alpha` together.

    True frequencies up to the lowest of the runs' Nyquist frequencies are tried.
    """
    if not scan.groups or not np.isfinite(scan.shortest_s):
        return []
    pools = _pools(scan)
    if not pools:
        return []
    lines: list[FoundLine] = []
    test = _Test(scan, pools)
    while len(lines) < most:
        at = test.most_significant()
        if at is None or test.p_corrected(at) >= alpha:
            break
        line = test.line_at(at)
        if line is not None and line.p_value < alpha:
            lines.append(line)
        test.leave_out(at)
    return lines


@dataclass
class _Pool:
    """One pool's normalised mean power (1: noise), on the scan's frequencies, and what stands behind it."""

    halves: tuple[FloatArray, ...]
    runs: FloatArray
    level: FloatArray
    level_variance: FloatArray
    excess: FloatArray
    log_ratio: FloatArray
    sensitivity: FloatArray


class _Test:
    def __init__(self, scan: LineScan, pools: list[_Pool]) -> None:
        self.scan, self.pools = scan, pools
        self._looks = 0
        bins = pools[0].runs.size
        self.frequency_hz = np.arange(bins) * scan.step_hz
        per_bin = 1.0 / (scan.shortest_s * scan.step_hz)
        self.open = np.sum([pool.runs for pool in pools], axis=0) >= 1.0
        self.open[: int(_FIRST_BIN * per_bin)] = False
        highest = 0.5 * min(scan.rates_hz) - _FIRST_BIN / scan.shortest_s
        self.open[self.frequency_hz > highest] = False
        self.trials = int(self.open.sum())
        self._evaluate()

    def _evaluate(self) -> None:
        """Power weighted by how much of a line each pool would show, and its probability under noise."""
        weight = np.array([pool.sensitivity * pool.runs for pool in self.pools])
        total = weight.sum(axis=0) + np.finfo(float).tiny
        runs = np.array([pool.runs for pool in self.pools])
        excess = np.array([pool.excess for pool in self.pools])
        self.power = 1.0 + (weight * excess).sum(axis=0) / total
        # A weighted mean of exponential powers is about a gamma variable of shape total^2 / squares (Satterthwaite).
        squares = (weight**2 / np.maximum(runs, 1.0)).sum(axis=0) + np.finfo(float).tiny
        self.to_amplitude = total / squares
        self.squares = squares
        self.shape = total**2 / squares
        spread = (weight**2 * np.array([pool.level_variance for pool in self.pools])).sum(axis=0)
        self.level_shape = total**2 / np.maximum(spread, np.finfo(float).tiny)
        self.log_p = np.zeros(self.power.size)
        tried = self.open & (self.power > 1.0)
        power, shape = self.power[tried], self.shape[tried]
        # The tail grows by what each run's own noise level is uncertain by (saddle point of the sum).
        # It is an expansion: for a line as strong as tens of levels it would grow beyond what it corrects.
        # F, for the level below is an estimate as well.
        with np.errstate(divide="ignore"):
            known = np.log(special.fdtrc(2 * shape, 2 * self.level_shape[tried], power))
        tail = np.minimum(0.5 * _LEVEL_VARIANCE * shape * (power - 1.0) ** 2, -0.5 * known)
        self.log_p[tried] = known + tail

    def most_significant(self) -> int | None:
        if not self.open.any():
            return None
        log_p = np.where(self.open, self.log_p, np.inf)
        # Probabilities beyond the range of floats are all alike: there the power tells.
        likeliest = log_p <= max(float(log_p.min()), _BEYOND_FLOATS)
        at = int(np.argmax(np.where(likeliest, self.power, -np.inf)))
        if log_p[at] >= 0.0:
            return None
        # The least p may lie on a peak's flank, where the level is better known; amplitude is the top's.
        while 0 < at < self.power.size - 1 and (step := int(np.argmax(self.power[at - 1 : at + 2])) - 1):
            at += step
        return at

    def p_corrected(self, at: int) -> float:
        # Clipped: log1p(-1) is no number, and beyond one half the corrected p is 1 anyway.
        return float(-np.expm1(self.trials * np.log1p(-min(np.exp(self.log_p[at]), 0.5))))

    def line_at(self, at: int) -> FoundLine | None:
        """The line there; None where the runs' powers are those of a bump."""
        bump, contradicted = self._shape_of_powers(at)
        if contradicted < _CONTRADICTED:
            return None
        p_value = self.p_corrected(at)
        frequency_hz = float(self.frequency_hz[at])
        # There a bump may be narrower than three bins, and the neighbours would not see it.
        if frequency_hz * _NARROWEST_BUMP * self.scan.shortest_s < 3.0:
            # A bump is wider than a bin: each further look at one is given half the level.
            self._looks += 1
            p_value = max(p_value, min(1.0, bump * 2.0 ** (1 + self._looks)))
        # Trial frequencies are half a bin apart or less: a parabola places the top between them.
        shift, peak = vertex(self.power[at - 1 : at + 2])
        square = max((peak - 1.0) * self.to_amplitude[at], np.finfo(float).tiny)
        amplitude = float(np.sqrt(square))
        seen = sum(
            float(pool.runs[at])
            * float(pool.sensitivity[at]) ** 2
            # The variance of a line's power in noise is 1 + 2 ratio (noncentral chi-squared of two dof).
            * (1.0 + 2.0 * square * float(pool.sensitivity[at]))
            for pool in self.pools
        )
        sigma = float(np.sqrt(seen) / self.squares[at] / (2.0 * amplitude))
        frequency_hz += shift * self.scan.step_hz
        return FoundLine(
            frequency_hz, amplitude, sigma, p_value, self._held_out(at), self.scan.aliases_hz(frequency_hz)
        )

    def _shape_of_powers(self, at: int) -> tuple[float, float]:
        """p of Bartlett's statistic for exponential powers (small: a line) and for a line's (small: none)."""
        statistic, expected, variance = 0.0, 0.0, 0.0
        counts: list[float] = []
        for pool in self.pools:
            n = float(pool.runs[at])
            if n < 2.0:
                continue
            ratio = max(float(pool.excess[at]), 1e-6)
            statistic += n * float(pool.log_ratio[at])
            counts.append(n)
            mean, scatter = _log_ratio_of_rice(ratio)
            expected += (n - 1.0) * (mean + 0.5 * _LEVEL_VARIANCE)
            variance += n * (scatter + _LEVEL_VARIANCE)
        if not counts:
            return 1.0, 1.0
        return p_of_alike_powers(statistic, counts), float(special.ndtr(-(statistic - expected) / np.sqrt(variance)))

    def _held_out(self, at: int) -> float:
        """Error of the power at the line in one half, predicted from the other, after over before; 1 for one half."""
        before = runs = left = 0.0
        for test in (0, 1):
            seen = square = 0.0
            for pool in self.pools:
                n, power = _half(pool, 1 - test, at)
                seen += n * float(pool.sensitivity[at]) ** 2
                square += float(pool.sensitivity[at]) * n * (power - 1.0)
            if seen <= 0.0:
                continue
            square = max(square / seen, 0.0)
            unexplained = 0.0
            for pool in self.pools:
                n, power = _half(pool, test, at)
                before, runs = before + n * power, runs + n
                unexplained += n * (power - 1.0 - square * float(pool.sensitivity[at]))
            left += abs(unexplained)
        return float(np.sqrt((runs + left) / before)) if before > 0.0 else 1.0

    def leave_out(self, at: int) -> None:
        """Close the frequencies a line at `at` spreads to, and take its side lobes off."""
        apart = np.abs(self.frequency_hz - self.frequency_hz[at])
        # The main lobe and the first side lobes of the shortest run.
        self.open[apart < 3.0 / self.scan.shortest_s] = False
        # The harmonics' fit moves some of a strong line's side lobes about.
        lobes = np.minimum(1.0, 3.0 / np.maximum(np.pi * apart * self.scan.shortest_s, 1e-9) ** 2)
        for pool in self.pools:
            pool.excess = pool.excess - max(float(pool.excess[at]), 0.0) * lobes
        self._evaluate()


def _pools(scan: LineScan) -> list[_Pool]:
    by_pool: dict[str, list[FloatArray]] = {}
    bins = min(sums.shape[1] for sums in scan.groups.values())
    for half in (0, 1):
        for name in sorted({pool for pool, _ in scan.groups}):
            sums = scan.groups.get((name, half))
            by_pool.setdefault(name, []).append(np.zeros((4, bins)) if sums is None else sums[:, :bins])
    return [_pool(halves, scan) for halves in by_pool.values() if sum(h[0].max() for h in halves) > 0.5]


def _pool(halves: list[FloatArray], scan: LineScan) -> _Pool:
    runs, power, logarithm, inverse = sum(halves[1:], halves[0])
    # Counts of runs, interpolated and with runs taken out again: not quite whole.
    runs = np.where(runs > 0.5, runs, 0.0)
    safe = np.maximum(runs, 1.0)
    mean = np.where(runs > 0.0, power / safe, np.nan)
    level, variance = _level(mean, safe, max(1, round(1.0 / (scan.longest_s * scan.step_hz))))
    excess = np.where(runs > 0.0, mean / level - 1.0, 0.0)
    log_ratio = np.where(runs > 0.0, np.log(np.maximum(mean, 1e-300)) - logarithm / safe, 0.0)
    return _Pool(tuple(halves), runs, level, variance, excess, log_ratio, inverse / safe / level)


def _level(mean: FloatArray, runs: FloatArray, stride: int) -> tuple[FloatArray, FloatArray]:
    """The noise level at every frequency from its neighbours on both sides, and its relative variance.

    The wide neighbourhood's, or the narrow one's where the noise bulges there; after the median's slope is taken off.
    """
    known = np.isfinite(mean) & (mean > 0.0)
    everywhere = np.arange(mean.size)
    if not known.any():
        return np.ones(mean.size), np.ones(mean.size)
    # One frequency per bin of the longest run: the trial frequencies between are no neighbours of their own.
    at = np.arange(0, mean.size, stride)
    # The mean of the logarithm of a mean of n exponentials, and its variance: n differs between neighbours.
    logs = np.log(mean[known]) - special.digamma(runs[known]) + np.log(runs[known])
    log_mean = np.interp(at, everywhere[known], logs)
    one = np.interp(at, everywhere[known], special.polygamma(1, runs[known]))
    slope = median_filter(log_mean, 2 * _NEIGHBOURS[-1] + 1, mode="nearest")
    narrow, wide = (_neighbourhood(log_mean - slope, width) for width in _NEIGHBOURS)
    narrow_variance, wide_variance = (_neighbourhood(one, width) / (2 * (width - _SHOULDER)) for width in _NEIGHBOURS)
    bulge = narrow - wide > _BULGE * np.sqrt(narrow_variance)
    log_level = np.where(bulge, narrow, wide) + slope
    variance = np.where(bulge, narrow_variance, wide_variance)
    return np.exp(np.interp(everywhere, at, log_level)), np.interp(everywhere, at, variance)


def _neighbourhood(values: FloatArray, width: int) -> FloatArray:
    """Mean of the neighbours up to `width` bins away on both sides without the next two, extremes left out."""
    padded = np.pad(values, width, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1)
    offsets = np.r_[0 : width - _SHOULDER, width + _SHOULDER + 1 : 2 * width + 1]
    left_out = int(_TRIMMED * offsets.size)
    ordered = np.partition(windows[:, offsets], (left_out, offsets.size - left_out - 1), axis=1)
    return np.asarray(np.mean(ordered[:, left_out : offsets.size - left_out], axis=1))


def _log_ratio_of_rice(ratio: float) -> tuple[float, float]:
    """Expectation of log(mean) - log(u), and the variance it has per run, for powers u of a line in noise.

    u is Gamma(1 + J) with J a Poisson number of mean `ratio`, the line's power over the noise's.
    """
    # Ten standard deviations of a Poisson number, and for small ones enough.
    numbers = np.arange(int(ratio + 10.0 * np.sqrt(ratio) + 30.0))
    weight = np.exp(special.xlogy(numbers, ratio) - special.gammaln(numbers + 1) - ratio)
    digamma = special.digamma(1.0 + numbers)
    mean, mean_log = 1.0 + ratio, float(weight @ digamma)
    variance_log = float(weight @ (special.polygamma(1, 1.0 + numbers) + digamma**2)) - mean_log**2
    # Of a gamma variable u of shape k: E(log u) = psi(k), E(u log u) = k psi(k + 1), var(log u) = psi'(k).
    covariance = float(weight @ ((1.0 + numbers) * special.digamma(2.0 + numbers))) - mean * mean_log
    variance = (1.0 + 2.0 * ratio) / mean**2
    return float(np.log(mean)) - mean_log, variance_log - 2.0 * covariance / mean + variance


def _half(pool: _Pool, half: int, at: int) -> tuple[float, float]:
    """Runs of a half there, and their mean power in units of the noise."""
    runs, power = float(pool.halves[half][0, at]), float(pool.halves[half][1, at])
    return (runs, power / runs / float(pool.level[at])) if runs > 0.5 else (0.0, 1.0)


def vertex(values: FloatArray) -> tuple[float, float]:
    """Place, in steps from the middle, and height of the parabola through three values."""
    if values.size < 3:
        return 0.0, float(values.max())
    left, middle, right = (float(each) for each in values)
    bend = left - 2.0 * middle + right
    if bend >= 0.0:
        return 0.0, middle
    shift = float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5))
    return shift, middle - 0.25 * (left - right) * shift


def p_of_alike_powers(statistic: float, counts: Sequence[float]) -> float:
    """The probability that exponential powers of one mean in each of several groups are as alike as these.

    `statistic` is the sum over groups of n log mean - sum log power, `counts` the n of each. Bartlett (1937), with
    two degrees of freedom behind each power.
    """
    dof = sum(n - 1.0 for n in counts)
    correction = 1.0 + sum(n - 1.0 / n for n in counts) / (6.0 * dof)
    return float(special.chdtr(dof, 2.0 * statistic / correction))
