"""How far a model is off on runs its fit never used.

Blocks (mountings, else stretches of time) are left out in turn. At the fit everything is linear enough to fit the
rest again by one step. A block's errors count as far as the rest predicts them: e' (1 + H C H')^-1 e, with C what the
rest leaves uncertain. What only the block itself knows (the null of that mounting) is thereby fitted on it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.workbench.noise import Noise
from rigctl.workbench.study import FloatArray, IntArray, Observations

_UNKNOWN, _RIDGE = 1e-10, 1e-13

BoolArray = NDArray[np.bool_]


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

    def _predicted(self, block: IntArray, jacobian: FloatArray, wanted: BoolArray) -> tuple[float, float]:
        """Square sum of one block's errors, and its expectation when the model is right."""
        rest = np.ones(len(self._left), dtype=bool)
        rest[block] = False
        known = jacobian[rest].T @ jacobian[rest]
        ridge = _RIDGE * np.eye(len(known))
        step = np.linalg.solve(known + ridge, jacobian[rest].T @ self._left[rest])
        seen = block[wanted[block]]
        here = jacobian[seen]
        error = self._left[seen] - here @ step
        both = known + here.T @ here
        along = here.T @ error
        square = error @ error - along @ np.linalg.solve(both + ridge, along)
        return float(square), float(len(seen) - _rank(both) + _rank(known))


def _rank(gram: FloatArray) -> int:
    """Directions a Gram matrix of columns of about unit length determines."""
    return int(np.sum(np.linalg.eigvalsh(gram) > _UNKNOWN))
