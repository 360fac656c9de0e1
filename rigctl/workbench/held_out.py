"""How far a model is off on runs its fit never used.

Blocks (mountings, else stretches of time) are left out in turn. At the fit everything is linear enough to fit the
rest again by one step; a parameter that no other block knows (the null of that mounting) is fitted on the block left
out.
"""

from __future__ import annotations

import numpy as np

from rigctl.workbench.noise import Noise, orthonormal
from rigctl.workbench.study import FloatArray, IntArray, Observations

_LOCAL = 1e-6
_RIDGE = 1e-12


class HeldOut:
    """Blocks of whitened data left out of a fit in turn.

    `jacobian` (n + priors, m) and `left` (n + priors,) are whitened, at the fit of all data.
    """

    def __init__(self, given: Observations, noise: Noise, jacobian: FloatArray, left: FloatArray) -> None:
        self._noise = noise
        self._jacobian, self._left = jacobian, left
        blocks = given.block_of[given.run_of]
        data = len(given.value)
        self._blocks = [np.flatnonzero(blocks == number) for number in np.unique(blocks)]
        self._data = data
        self._series_of = given.series_of

    @property
    def possible(self) -> bool:
        """False when there is one block only."""
        return len(self._blocks) > 1

    def error(self, columns: FloatArray | None = None, series: IntArray | None = None) -> float:
        """Rms error of held-out data in units of what is expected when the model is right; 1.00 is noise.

        `columns` (n + priors, d) are added to the model; `series` restricts to some series. NaN when nothing can be
        held out.
        """
        jacobian = self._jacobian if columns is None else np.hstack([self._jacobian, columns])
        size = np.linalg.norm(jacobian, axis=0)
        jacobian = jacobian[:, size > 0.0] / size[size > 0.0]
        wanted = np.ones(self._data, dtype=bool) if series is None else np.isin(self._series_of, series)
        found = expected = 0.0
        for block in self._blocks if self.possible else []:
            square, mean = self._predicted(block, jacobian, wanted)
            found += square
            expected += mean
        return float(np.sqrt(found / expected)) if expected > 0.0 else float("nan")

    def _predicted(self, block: IntArray, jacobian: FloatArray, wanted: np.ndarray) -> tuple[float, float]:
        """Square sum of one block's errors and its expectation when the model is right."""
        rest = np.ones(len(self._left), dtype=bool)
        rest[block] = False
        known = np.linalg.norm(jacobian[rest], axis=0) > _LOCAL
        own = orthonormal(jacobian[np.ix_(block, ~known)], _LOCAL)
        shared = jacobian[:, known]
        gram = shared[rest].T @ shared[rest]
        gram += _RIDGE * np.trace(gram) / max(len(gram), 1) * np.eye(len(gram))
        step = np.linalg.solve(gram, shared[rest].T @ self._left[rest])
        here = shared[block]
        error = self._left[block] - here @ step
        error -= own @ (own.T @ error)
        seen = wanted[block]
        free = here - own @ (own.T @ here)
        # When right, errors are noise outside the block's own parameters, and what the rest left uncertain.
        expected = float(seen.sum() - np.sum(own[seen] ** 2))
        expected += float(np.sum(free[seen] * np.linalg.solve(gram, free[seen].T).T)) if len(gram) else 0.0
        return float(error[seen] @ error[seen]), expected
