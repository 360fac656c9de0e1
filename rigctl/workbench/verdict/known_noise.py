"""Noise that was estimated once and is used for every model of the same data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.noise_estimate import NoiseEstimator


@dataclass(frozen=True)
class KnownNoise:
    """The `noise` of data as `observed`, the `estimator` that told it, and whether it was told beside a break of the
    level, for which correlated noise may stand."""

    noise: Noise
    estimator: NoiseEstimator
    observed: Observations
    beside_break: bool = False

    def noise_of(self, given: Observations) -> Noise | None:
        """The noise of the same data in another model's reduction; None when there are not the same data.

        A term that is taken off the samples (a line) changes sigmas that are known beforehand: those are kept.
        """
        if given is self.observed:
            return self.noise
        same = len(given.value) == len(self.observed.value) and np.array_equal(given.pool_of, self.observed.pool_of)
        if not same:
            return None
        sigma = given.sigma * (self.noise.sigma / self.observed.sigma)
        return Noise(sigma, self.noise.dof, self.noise.factors, self.noise.correlations, slow=self.noise.slow)
