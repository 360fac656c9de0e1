"""How much every frequency stands out of a run's noise, summed over runs: what steady lines are looked for in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy import special
from scipy.ndimage import uniform_filter1d

from rigctl.analysis.kept import Packed
from rigctl.analysis.noise import Spectrum
from rigctl.analysis.sine_fit import HarmonicBasis
from rigctl.core.arrays import FloatArray

MAX_BINS = 2**17
LEVEL_CELLS = 201
"""Cells of a spectrum from which the noise of one run is known at a frequency."""

_FEWEST_CELLS = 31
# A line between two trial frequencies, a quarter of a bin off at worst, keeps 81 % of its power (sinc squared).
_OVERSAMPLING = 2.0
# The drive's own harmonics, more of them than are fitted, are signal and no steady line.
_MASKED_HARMONICS = 12
# In units of 1/T: the main lobe of a rectangular window ends at 1, its largest side lobe is at 1.43.
_CLEAR_BINS = 1.5
# Bins beside a fitted line are known in part only.
_WHOLE_BIN = 0.8


@dataclass(frozen=True)
class FoundLine:
    """A steady line: amplitude with its standard uncertainty, in the samples' unit.

    `p_value` is that of noise alone, corrected for all frequencies tried. `held_out_error_ratio` is the error at the
    line, predicted from the other half of the recording, after over before. `aliases_hz` are the lowest true
    frequencies that would look the same at the sampling rates there were.
    """

    frequency_hz: float
    amplitude: float
    sigma: float
    p_value: float
    held_out_error_ratio: float
    aliases_hz: tuple[float, ...]


class ScannedRun(NamedTuple):
    """One run's part of a scan, on frequencies `step_hz` apart from zero; `sums` as in `LineScan`."""

    step_hz: float
    duration_s: float
    sample_rate_hz: float
    sums: FloatArray


def scanned(basis: HarmonicBasis, residuals: FloatArray, noise: Spectrum) -> ScannedRun | None:
    """What one run adds to a scan: `residuals`, shape (samples,), of a fit with `basis` and their spectrum.

    None for a run without a uniform time grid or without noise.
    """
    if not basis.uniform or (noise.weight > _WHOLE_BIN).sum() < _FEWEST_CELLS or not np.median(noise.psd) > 0.0:
        return None
    # Powers of two: the grids of runs of different lengths then have their frequencies in common.
    step_hz = 2.0 ** np.floor(np.log2(1.0 / (_OVERSAMPLING * basis.duration_s)))
    length = max(basis.grid_length, round(1.0 / (step_hz * basis.sample_period_s)))
    on_grid = np.zeros(basis.grid_length)
    on_grid[basis.grid_index] = residuals
    transform = np.fft.rfft(on_grid, length)[:MAX_BINS]
    frequency_hz = np.arange(transform.size) * step_hz
    power = (transform.real**2 + transform.imag**2) * (2.0 / basis.samples) ** 2
    seconds = basis.samples * basis.sample_period_s
    whole = noise.weight > _WHOLE_BIN
    # The digamma unbiases the logarithm of a mean of exponentials.
    logs = np.log(np.maximum(noise.psd[whole], np.finfo(float).tiny)) - special.digamma(noise.weight[whole])
    logs += np.log(noise.weight[whole])
    # The mean of logarithms: a line among the neighbours raises it far less than a mean of powers.
    level = np.exp(uniform_filter1d(logs, LEVEL_CELLS, mode="reflect"))
    # Noise gives an amplitude squared of 2 S / T, S / T in each of the two parts.
    inverse = np.interp(frequency_hz, noise.frequency_hz[whole], 0.5 * seconds / level)
    power *= inverse
    use = np.ones(transform.size)
    harmonics = basis.frequency_hz * np.arange(_MASKED_HARMONICS + 1)
    half = _CLEAR_BINS / basis.duration_s
    for centre in (*harmonics, *basis.lines_hz):
        use[max(0, int(np.ceil((centre - half) / step_hz))) : int((centre + half) / step_hz) + 1] = 0.0
    use[frequency_hz > 0.5 / basis.sample_period_s - half] = 0.0
    logarithm = np.log(np.maximum(power, np.finfo(float).tiny))
    sums = np.stack([use, use * power, use * logarithm, use * inverse])
    return ScannedRun(float(step_hz), basis.duration_s, 1.0 / basis.sample_period_s, sums)


@dataclass
class LineScan:
    """Sums over runs, by group: the runs that share their noise, in two halves for held-out tests.

    `groups` maps (pool, half) to sums of shape (4, bins): runs, power in units of the run's noise, its logarithm,
    inverse noise power (1 / unit^2); frequencies are `step_hz` apart from zero.
    """

    step_hz: float = 0.0
    longest_s: float = 0.0
    shortest_s: float = np.inf
    rates_hz: tuple[float, ...] = ()
    groups: dict[tuple[str, int], FloatArray] = field(default_factory=dict)
    runs: dict[str, tuple[str, int]] = field(default_factory=dict)

    def packed(self) -> Packed:
        """For keeping, bit for bit."""
        head = {
            "step_hz": self.step_hz,
            "longest_s": self.longest_s,
            "shortest_s": self.shortest_s,
            "rates_hz": self.rates_hz,
            "groups": list(self.groups),
            "runs": self.runs,
        }
        return Packed(head, {str(place): sums for place, sums in enumerate(self.groups.values())})

    @classmethod
    def unpacked(cls, kept: Packed) -> LineScan:
        """What `packed` was called on."""
        head = kept.head
        groups = {(pool, half): kept.arrays[str(place)] for place, (pool, half) in enumerate(head["groups"])}
        runs = {run_id: (pool, half) for run_id, (pool, half) in head["runs"].items()}
        times = head["step_hz"], head["longest_s"], head["shortest_s"]
        return cls(*times, tuple(head["rates_hz"]), groups, runs)

    def add(self, run_id: str, group: tuple[str, int], run: ScannedRun | None) -> None:
        """Add a run; one without a spectrum is only remembered."""
        self.runs[run_id] = group
        if run is not None:
            self.longest_s = max(self.longest_s, run.duration_s)
            self.shortest_s = min(self.shortest_s, run.duration_s)
            self.rates_hz = tuple(sorted({*self.rates_hz, float(f"{run.sample_rate_hz:.6g}")}))
            self._sum(group, run, 1.0)

    def remove(self, run_id: str, run: ScannedRun | None) -> None:
        """Take a run out that had been added."""
        group = self.runs.pop(run_id)
        if run is not None:
            self._sum(group, run, -1.0)

    def aliases_hz(self, frequency_hz: float) -> tuple[float, ...]:
        """The next true frequencies that every sampling rate folds to this one."""
        slowest, width_hz = self.rates_hz[0], 1.0 / self.longest_s
        same = []
        for k in range(1, 40):
            for true in (k * slowest - frequency_hz, k * slowest + frequency_hz):
                folded = [abs(true - round(true / rate) * rate) for rate in self.rates_hz]
                if all(abs(each - frequency_hz) < width_hz for each in folded):
                    same.append(float(true))
        return tuple(same[:4])

    def _sum(self, group: tuple[str, int], run: ScannedRun, sign: float) -> None:
        if not self.step_hz:
            self.step_hz = run.step_hz
        if run.step_hz < self.step_hz:
            self.groups = {key: _on_grid(sums, self.step_hz, run.step_hz) for key, sums in self.groups.items()}
            self.step_hz = run.step_hz
        part = _on_grid(run.sums, run.step_hz, self.step_hz)
        have = self.groups.get(group)
        bins = part.shape[1] if have is None else max(part.shape[1], have.shape[1])
        total = np.zeros((4, bins)) if have is None or have.shape[1] < bins else have
        if have is not None and total is not have:
            total[:, : have.shape[1]] = have
        total[:, : part.shape[1]] += sign * part
        self.groups[group] = total


def _on_grid(sums: FloatArray, step_hz: float, wanted_hz: float) -> FloatArray:
    """Sums at frequencies `wanted_hz` apart, interpolated."""
    if step_hz == wanted_hz:
        return sums
    ratio = step_hz / wanted_hz
    place = np.arange(min(MAX_BINS, int((sums.shape[1] - 1) * ratio) + 1)) / ratio
    return np.stack([np.interp(place, np.arange(sums.shape[1]), row) for row in sums])
