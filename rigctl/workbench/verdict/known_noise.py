"""Noise that was estimated once and is used for every model of the same data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.noise_estimate import NoiseEstimator


@dataclass(frozen=True)
class KnownNoise:
    """The `noise` of data as `observed`, the `estimator` that told it, and whether it was told beside a break of the
    level, for which correlated noise may stand. `beside_fit` is the noise that fitted parameters are uncertain by."""

    noise: Noise
    estimator: NoiseEstimator
    observed: Observations
    beside_fit: Callable[[], Noise]
    beside_break: bool = False

    def noise_of(self, given: Observations) -> Noise | None:
        """The noise of the same data in another model's reduction; None when there are not the same data.

        A term that is taken off the samples (a line) changes sigmas that are known beforehand: those are kept.
        """
        return self._in(given, self.noise)

    def beside_fit_of(self, given: Observations) -> Noise | None:
        """The same of the noise by which fitted parameters are uncertain; None too where it is no other."""
        told = self.beside_fit()
        return None if told is self.noise else self._in(given, told)

    def _in(self, given: Observations, noise: Noise) -> Noise | None:
        if given is self.observed:
            return noise
        same = len(given.value) == len(self.observed.value) and np.array_equal(given.pool_of, self.observed.pool_of)
        if not same:
            return None
        sigma = given.sigma * (noise.sigma / self.observed.sigma)
        return Noise(sigma, noise.dof, noise.factors, noise.correlations, slow=noise.slow, least=noise.least)
