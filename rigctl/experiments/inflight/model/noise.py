"""The noise at the lines of runs, from the spectrum of what the baseline leaves near them.

All runs are of the same sensors: they share the form of the density and each has a level of its own. A run alone has
a dozen free bins around its lowest lines, and would misjudge the noise there by a fifth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.experiments.inflight.model.equation import coefficients, own_channel
from rigctl.experiments.inflight.model.parameters import SHARED
from rigctl.experiments.inflight.observe.reduction import ReducedRun

POWERS = (-2, -1, 0, 2, 4)
"""The density is a sum of these powers of frequency with positive weights: drift, flicker, white, read-out."""

LEAST = 1e-30
"""(m/s2)^2/Hz: below lies the rounding of telemetry and model, which is no noise."""

_ROUNDS = 12
_LEVELS = 3
_OUTLIER = 14.0
_NEIGHBOURS = 25
_HANN_WIDTH = 1.5
"""Bins per independent one under a Hann window."""


@dataclass(frozen=True)
class RunNoise:
    """Densities of a run, one-sided, (m/s2)^2/Hz: of the differential channel as a sum of `POWERS` of f over
    `scale_hz`, and of the moved mass's own channel at the stimulus (NaN without). `dof` stand behind them."""

    weights: FloatArray
    scale_hz: float
    own: float
    dof: float

    def density(self, f_hz: FloatArray) -> FloatArray:
        """Of the differential channel (of m_1x - m_2x) at some frequencies."""
        x = np.asarray(f_hz, dtype=np.float64) / self.scale_hz
        return np.asarray(LEAST + sum(w * x**power for w, power in zip(self.weights, POWERS, strict=True)))


def run_noises(runs: Sequence[ReducedRun], values: FloatArray) -> list[RunNoise]:
    """The noise of every run at baseline parameters `values`."""
    spectra = [(run.between.f_hz, run.between.density(_left_over(run, values))) for run in runs]
    levels = np.ones(len(runs))
    f_hz = np.concatenate([f for f, _ in spectra])
    for _ in range(_LEVELS):
        level = np.concatenate([np.full(len(f), level) for (f, _), level in zip(spectra, levels, strict=True)])
        weights, scale_hz = fitted_density(f_hz, np.concatenate([density for _, density in spectra]) / level)
        form = RunNoise(weights, scale_hz, float("nan"), 0.0)
        levels = np.array([_level(density / form.density(f)) for f, density in spectra])
    return [
        RunNoise(weights * level, scale_hz, _own(run), max(2.0 * len(f) / _HANN_WIDTH, 8.0))
        for run, level, (f, _) in zip(runs, levels, spectra, strict=True)
    ]


def _left_over(run: ReducedRun, values: FloatArray) -> FloatArray:
    return np.asarray(coefficients(run.session, run.whole.amplitudes, values[:SHARED, None])[:, 0])


def _level(ratio: FloatArray) -> float:
    """Mean of a periodogram over its form; bins far above the rest count no more."""
    level = float(np.median(ratio)) / np.log(2.0)
    for _ in range(_LEVELS):
        level = float(np.mean(ratio[ratio < _OUTLIER * level]))
    return float(level)


def _own(run: ReducedRun) -> float:
    if not run.session.moves_masses:
        return float("nan")
    between = run.between
    nearest = np.argsort(np.abs(between.f_hz - run.session.frequency_hz))[:_NEIGHBOURS]
    return float(LEAST + np.mean(between.density(own_channel(run.session))[nearest]))


def fitted_density(f_hz: FloatArray, density: FloatArray) -> tuple[FloatArray, float]:
    """Weights of `POWERS` and their scale in Hz for a periodogram; bins far above the rest count no more."""
    scale_hz = float(np.exp(np.mean(np.log(f_hz))))
    shapes = np.stack([(f_hz / scale_hz) ** power for power in POWERS], axis=1)
    used: BoolArray = np.ones(len(f_hz), dtype=bool)
    model = np.full(len(f_hz), float(np.median(density)) / np.log(2.0))
    weights = np.zeros(len(POWERS))
    for _ in range(_ROUNDS):
        rows = shapes[used] / model[used, None]
        size = np.linalg.norm(rows, axis=0)
        weights = optimize.nnls(rows / size, density[used] / model[used])[0] / size
        model = np.maximum(shapes @ weights, 1e-3 * model)
        used = density < _OUTLIER * model
    return weights, scale_hz
