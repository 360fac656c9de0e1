"""How large an effect is in a recording of the second platform, in sigma: from the world and its noise alone.

The observables are those of the page: the four numbers of each period by joint least squares, and what these leave,
in time after and before a turn, dwells at 0 and at pi apart. They are linear in the samples, so that their covariance
follows from the noise's autocovariance; what the baseline can imitate is projected out.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy import fft

from tests.foreign.platform_bundle import Noise
from tests.foreign.platform_world import CHANNELS, Floats, Platform, Run, angle, moving, readings

EDGES_S = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, np.inf)
BEFORE_S = 0.5
RELATIVE_RANK = 1e-8


def kept_sign(run: Run, bench: Platform) -> Floats:
    """c of the page: the sign of cos(theta) where nothing moves, 0 elsewhere."""
    theta, _, _ = angle(run, bench, run.time_s)
    return np.asarray(np.where(moving(run, bench), 0.0, np.sign(np.cos(theta))))


def operator(run: Run, bench: Platform) -> Floats:
    """The observables of a run as rows of weights on its samples."""
    sign = kept_sign(run, bench)
    kept = sign != 0.0
    per_period = round(run.period_s * run.rate_hz)
    t = run.time_s - run.time_s.mean()
    estimates = np.zeros((4 * run.periods, len(t)))
    fitted = np.zeros((len(t), 4 * run.periods))
    for period in range(run.periods):
        rows = np.flatnonzero(kept[period * per_period : (period + 1) * per_period]) + period * per_period
        own = t[rows] - t[rows].mean()
        basis = np.column_stack([sign[rows], sign[rows] * own, np.ones_like(own), own])
        place = slice(4 * period, 4 * period + 4)
        estimates[place, rows] = np.linalg.pinv(basis)
        fitted[rows, place] = basis
    bins = np.array([weights for weights in time_bins(run, bench, sign) if weights.any()])
    return np.vstack([estimates, bins - (bins @ fitted) @ estimates])


def time_bins(run: Run, bench: Platform, sign: Floats) -> list[Floats]:
    """Means over the run of the kept samples by time since a turn and before the next, by sign."""
    began = [stop - bench.mask_short_s for _, stop, _ in run.turns]
    ended = [start + bench.mask_short_s for start, _, _ in run.turns]
    since = np.min([np.where(run.time_s >= t, run.time_s - t, np.inf) for t in began], axis=0)
    until = np.min([np.where(run.time_s < t, t - run.time_s, np.inf) for t in ended], axis=0)
    found = []
    for side in (1.0, -1.0):
        for low, high in pairwise(EDGES_S):
            found.append((sign == side) & (since >= low) & (since < high) & np.isfinite(since))
        found.append((sign == side) & (until <= BEFORE_S))
    return [inside / max(1, inside.sum()) for inside in found]


def covariance_of(weights: Floats, autocovariance: Floats) -> Floats:
    """Of weighted sums, weights in rows, of samples with an autocovariance."""
    count = len(autocovariance)
    # Toeplitz within a circle that is long enough, of a length that is quickly transformed.
    size = fft.next_fast_len(2 * count - 1, real=True)
    circle = np.concatenate([autocovariance, np.zeros(size - 2 * count + 1), autocovariance[:0:-1]])
    through = fft.irfft(fft.rfft(weights, size) * fft.rfft(circle), size)[:, :count]
    return np.asarray(through @ weights.T)


def whitener(run: Run, bench: Platform, noise: Noise, weights: Floats) -> Floats:
    """W with W (covariance of the observables) W' = 1."""
    theta, _, _ = angle(run, bench, run.time_s)
    covariance = covariance_of(weights, noise.autocovariance(run))
    for shape in (np.cos(theta), np.sin(theta)):
        covariance = covariance + covariance_of(weights * shape, noise.pendulum_autocovariance(run))
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    seen = values > RELATIVE_RANK * values.max()
    return np.asarray((vectors[:, seen] / np.sqrt(values[seen])).T / scale)


class Sight:
    """What a recording with this design and noise can show."""

    def __init__(self, runs: list[Run], bench: Platform, noise: Noise) -> None:
        self.runs, self.bench = runs, bench
        self.rows = []
        for run in runs:
            weights = operator(run, bench)
            self.rows.append(whitener(run, bench, noise, weights) @ weights)
        columns = self.baseline()
        columns /= np.linalg.norm(columns, axis=0)
        self.basis = np.linalg.qr(columns)[0]

    def observed(self, samples: list[dict[str, Floats]]) -> Floats:
        """The whitened observables of the readings of every run."""
        parts = [
            rows @ given[channel] for rows, given in zip(self.rows, samples, strict=True) for channel in CHANNELS
        ]
        return np.concatenate(parts)

    @cached_property
    def _unchanged(self) -> list[dict[str, Floats]]:
        return [readings(run, self.bench) for run in self.runs]

    def change(self, other: Platform) -> Floats:
        after = [readings(run, other) for run in self.runs]
        differences = [{c: b[c] - a[c] for c in CHANNELS} for a, b in zip(self._unchanged, after, strict=True)]
        return self.observed(differences)

    def baseline(self) -> Floats:
        """tilt_gain, both constant accelerations, and level and rate of the bias of every run."""
        servo = self.bench.servo_gain_error
        changed = [replace(self.bench, servo_gain_error={**servo, "z": servo["z"] + 1e-6})]
        for channel in CHANNELS:
            rest = self.bench.rest_m_s2 | {channel: self.bench.rest_m_s2[channel] + 1e-6}
            changed.append(replace(self.bench, rest_m_s2=rest))
        columns = [self.change(bench) for bench in changed]
        lengths = [len(rows) for rows in self.rows for _ in CHANNELS]
        ends = np.cumsum(lengths)
        for number, run in enumerate(self.runs):
            t = run.time_s / run.duration_s - 0.5
            own = self.rows[number] @ np.column_stack([np.ones_like(t), t])
            for place in (2 * number, 2 * number + 1):
                for column in own.T:
                    columns.append(np.zeros(ends[-1]))
                    columns[-1][ends[place] - lengths[place] : ends[place]] = column
        return np.column_stack(columns)

    def size(self, effects: dict[str, float]) -> float:
        """The effects' change of the observables, in sigma, after the baseline has refitted."""
        change = self.change(self.bench.with_effects(effects))
        return float(np.linalg.norm(change - self.basis @ (self.basis.T @ change)))
