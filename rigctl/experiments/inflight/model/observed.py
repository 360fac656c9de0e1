"""Reduced runs with their noise: what the estimates and the workbench are given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.inflight.model.baseline import Stretch, joint_estimate
from rigctl.experiments.inflight.model.equation import own_channel, own_force
from rigctl.experiments.inflight.model.noise import RunNoise, run_noises
from rigctl.experiments.inflight.model.paper import FittedRun
from rigctl.experiments.inflight.observe.reduction import ReducedRun, ReducedStretch
from rigctl.experiments.inflight.observe.series import Amplitudes
from rigctl.experiments.inflight.observe.sessions import STIMULUS, Line, Session

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
        fitted = {}
        for run, noise in zip(self.runs, self.noises, strict=True):
            frequencies = np.array([run.session.frequency_of(line) for line in run.whole.lines])
            sigma = np.sqrt(noise.density(frequencies)) * run.whole.spread
            both = np.stack([sigma, sigma], axis=1)
            fitted[run.session.name] = FittedRun(run.session, run.whole.amplitudes, both)
        return fitted


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
    frequencies = np.array([run.session.frequency_of(line) for line in half.lines])
    sigma = np.sqrt(noise.density(frequencies)) * half.spread
    return stretch_of(run.run_id, run.session, half.lines, half.amplitudes, sigma, np.sqrt(noise.own) * half.spread)
