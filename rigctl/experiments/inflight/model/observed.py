"""Reduced runs with their noise: what the estimates and the workbench are given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import ComplexArray, FloatArray
from rigctl.experiments.inflight.model.baseline import Stretch
from rigctl.experiments.inflight.model.equation import own_channel, own_force
from rigctl.experiments.inflight.model.joint import joint_estimate
from rigctl.experiments.inflight.model.noise import RunNoise, run_noises
from rigctl.experiments.inflight.model.paper import FittedRun
from rigctl.experiments.inflight.observe.reduction import ReducedRun, ReducedStretch
from rigctl.experiments.inflight.observe.sessions import STIMULUS, Session

_ROUNDS = 3
_FIRST = 4e-24
"""Densities to begin with, (m/s2)^2/Hz: only their ratio matters, once."""

_LEAST_OWN = (1e-3, 2e-4)
"""No moved mass's own channel counts as better known, as a part of its amplitude or of the injected one, in phase
and in quadrature. Its gain is wanted for nothing else, and a prior of 1e-2 must not drown beside it; the two masses'
gains differ by as much, so that a spring's loss, some hundredths of the amplitude, is seen to a hundredth."""


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
        found = {}
        for run, noise in zip(self.runs, self.noises, strict=True):
            frequencies = np.array([run.session.frequency_of(line) for line in run.whole.lines])
            sigma = np.sqrt(noise.density(frequencies)) * run.whole.spread
            both = np.stack([sigma, sigma], axis=1)
            found[run.session.name] = FittedRun(run.session, run.whole.amplitudes, both)
        return found


def observed(runs: Sequence[ReducedRun]) -> Observed:
    """Estimate the noise of runs from what the baseline leaves between their lines: fit, look, fit again."""
    noises: list[RunNoise] = [RunNoise(np.array([0.0, 0.0, _FIRST, 0.0, 0.0]), 1.0, _FIRST, 8.0) for _ in runs]
    values = np.zeros(0)
    for _ in range(_ROUNDS):
        values = joint_estimate(Observed(tuple(runs), tuple(noises), values).stretches()).fit.values
        noises = run_noises(runs, values)
    return Observed(tuple(runs), tuple(noises), values)


def own_sigma(session: Session, amplitudes: ComplexArray, noise: float) -> tuple[float, float]:
    """Of a moved mass's own channel, in phase and in quadrature, m/s2: `noise`, and what its gain is not known to.

    `amplitudes` are those of all series at the stimulus, shape (series,).
    """
    amplitude = max(abs(complex(amplitudes @ each)) for each in (own_channel(session), own_force(session)))
    return math.hypot(noise, _LEAST_OWN[0] * amplitude), math.hypot(noise, _LEAST_OWN[1] * amplitude)


def _stretch(run: ReducedRun, half: ReducedStretch, noise: RunNoise) -> Stretch:
    frequencies = np.array([run.session.frequency_of(line) for line in half.lines])
    sigma = np.sqrt(noise.density(frequencies)) * half.spread
    own = (float("nan"), float("nan"))
    if run.session.moves_masses and STIMULUS in half.lines:
        place = half.lines.index(STIMULUS)
        plain = float(np.sqrt(noise.own) * half.spread[place])
        own = own_sigma(run.session, half.amplitudes.table[place], plain)
    return Stretch(run.run_id, run.session, half.lines, half.amplitudes, sigma, own)
