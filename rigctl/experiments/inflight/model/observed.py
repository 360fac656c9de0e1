"""Reduced runs with their noise, from the spectrum of what the baseline leaves near their lines.

All runs are of the same sensors: they share the form of the density and each has a level of its own. A run alone has
a dozen free bins around its lowest lines, and would misjudge the noise there by a fifth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.experiments.inflight.model.baseline import Stretch, joint_estimate
from rigctl.experiments.inflight.model.equation import coefficients, own_channel, own_force
from rigctl.experiments.inflight.model.paper import FittedRun
from rigctl.experiments.inflight.model.parameters import SHARED
from rigctl.experiments.inflight.observe.edge import FAST
from rigctl.experiments.inflight.observe.reduction import ReducedRun, ReducedStretch
from rigctl.experiments.inflight.observe.series import INDEX, Amplitudes
from rigctl.experiments.inflight.observe.sessions import DRIFT, STIMULUS, Line, Session
from rigctl.experiments.inflight.observe.weights import DRIFT_CYCLES

POWERS = (-2, -1, 0, 2, 4)
"""The density is a sum of these powers of frequency with positive weights: drift, flicker, white, read-out."""

LEAST = 1e-30
"""(m/s2)^2/Hz: below lies the rounding of telemetry and model, which is no noise."""

_NOISE_ROUNDS = 12
_LEVELS = 3
# Times the level: noise gives a bin so high once in a million (e^-14).
_OUTLIER = 14.0
# Bins about the stimulus: some 33 degrees of freedom under a Hann window.
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
        # Neighbouring bins under a Hann window are not independent.
        RunNoise(weights * level, scale_hz, _own(run), max(2.0 * len(f) / _HANN_WIDTH, 8.0))
        for run, level, (f, _) in zip(runs, levels, spectra, strict=True)
    ]


def _left_over(run: ReducedRun, values: FloatArray) -> FloatArray:
    return np.asarray(coefficients(run.session, run.whole.amplitudes, values[:SHARED, None])[:, 0])


def _level(ratio: FloatArray) -> float:
    """Mean of a periodogram over its form; bins far above the rest count no more."""
    # The median of an exponential variable is ln 2 of its mean.
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
    from scipy import optimize  # 0.2 s, which an import of samples does without

    scale_hz = float(np.exp(np.mean(np.log(f_hz))))
    shapes = np.stack([(f_hz / scale_hz) ** power for power in POWERS], axis=1)
    used: BoolArray = np.ones(len(f_hz), dtype=bool)
    model = np.full(len(f_hz), float(np.median(density)) / np.log(2.0))
    weights = np.zeros(len(POWERS))
    for _ in range(_NOISE_ROUNDS):
        # Relative to the model of the round before: a bin scatters by as much as its density.
        rows = shapes[used] / model[used, None]
        size = np.linalg.norm(rows, axis=0)
        # No part of a density is negative.
        weights = optimize.nnls(rows / size, density[used] / model[used])[0] / size
        # Never so little that a single bin outweighs all others in the next round.
        model = np.maximum(shapes @ weights, 1e-3 * model)
        used = density < _OUTLIER * model
    return weights, scale_hz


_ROUNDS = 3
_FIRST = 4e-24
"""Densities to begin with, (m/s2)^2/Hz: only their ratio matters, once."""

_LEAST_OWN = (1e-3, 2e-7)
"""No moved mass's own channel counts as better known, as a part of its amplitude or of the injected one, in phase and
in quadrature. Its gain is wanted for nothing else, and a prior of 1e-2 must not drown beside it. In quadrature there
is nothing but what a spring loses, or a clock, and what unequal gains leave where they are known to 1e-4."""


@dataclass(frozen=True)
class Observed:
    """Runs and their noise, and where the baseline's parameters came to rest."""

    runs: tuple[ReducedRun, ...]
    noises: tuple[RunNoise, ...]
    values: FloatArray

    def stretches(self) -> list[Stretch]:
        """The halves of all runs, in order."""
        return [
            _stretch(run, half, noise)
            for run, noise in zip(self.runs, self.noises, strict=True)
            for half in run.halves
        ]

    def fitted_runs(self) -> dict[str, FittedRun]:
        """By session what the published estimate takes: of several runs of one session the last."""
        fitted = {}
        for run, noise in zip(self.runs, self.noises, strict=True):
            frequencies = np.array([run.session.frequency_of(line) for line in run.whole.lines])
            sigma = np.sqrt(noise.density(frequencies)) * run.whole.spread
            both = np.hypot(sigma[:, None], np.sqrt(_at_the_edge(run, self.values)))
            fitted[run.session.name] = FittedRun(run.session, run.whole.amplitudes, both)
        return fitted


def _at_the_edge(run: ReducedRun, values: FloatArray) -> FloatArray:
    """Variance of cosine and sine of each published line by noise far above them, (lines, 2)."""
    if run.whole.fast is None:
        return np.zeros((len(run.whole.lines), 2))
    c = _left_over(run, values)[[INDEX[name] for name in FAST]]
    return np.asarray(np.einsum("i,rij,j->r", c, run.whole.fast, c).reshape(-1, 2))


def observed(runs: Sequence[ReducedRun]) -> Observed:
    """Estimate the noise of runs from what the baseline leaves between their lines: fit, look, fit again."""
    noises: list[RunNoise] = [RunNoise(np.array([0.0, 0.0, _FIRST, 0.0, 0.0]), 1.0, _FIRST, 8.0) for _ in runs]
    values = np.zeros(0)
    for _ in range(_ROUNDS):
        values = joint_estimate(Observed(tuple(runs), tuple(noises), values).stretches()).values
        noises = run_noises(runs, values)
    return Observed(tuple(runs), tuple(noises), values)


def stretch_of(
    run_id: str, session: Session, lines: tuple[Line, ...], amplitudes: Amplitudes, sigma: FloatArray, own: FloatArray
) -> Stretch:
    """A reduced stretch with its noise, (lines,): `sigma` of the differential channel, `own` of the moved mass's own
    [m/s2], whose gain is known no better than `_LEAST_OWN`."""
    stretch = Stretch(run_id, session, lines, amplitudes, sigma)
    if not stretch.has_own:
        return stretch
    place = lines.index(STIMULUS)
    row = amplitudes.table[place]
    amplitude = max(abs(complex(row @ each)) for each in (own_channel(session), own_force(session)))
    in_phase, quadrature = (math.hypot(float(own[place]), least * amplitude) for least in _LEAST_OWN)
    return replace(stretch, own_sigma=(in_phase, quadrature))


def _stretch(run: ReducedRun, half: ReducedStretch, noise: RunNoise) -> Stretch:
    slow_hz = DRIFT_CYCLES / (half.stop_s - half.start_s)
    frequencies = [slow_hz if line == DRIFT else run.session.frequency_of(line) for line in half.lines]
    sigma = np.sqrt(noise.density(np.array(frequencies))) * half.spread
    return stretch_of(run.run_id, run.session, half.lines, half.amplitudes, sigma, np.sqrt(noise.own) * half.spread)
