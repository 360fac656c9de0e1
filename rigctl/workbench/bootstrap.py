"""Are p-values right where the noise itself was estimated? Noise like the one found is drawn, and estimated anew.

A parametric bootstrap of "nothing hidden". Everything is linear at the fit, and data whose noise is known act through
what they say of the columns only: a draw costs some products of small matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rigctl.workbench.generic import main_columns
from rigctl.workbench.noise import orthonormal
from rigctl.workbench.score import ABSORBED, corrected, p_of
from rigctl.workbench.study import FloatArray, IntArray

if TYPE_CHECKING:
    from rigctl.workbench.attempt import Attempt

DRAWS = 500


@dataclass(frozen=True)
class Bootstrap:
    """Smallest p-values of draws in which nothing is hidden, (draws,): of the catalogue, of the plain shapes."""

    catalogue: FloatArray
    shapes: FloatArray

    def p_catalogue(self, p_value: float) -> float:
        """How often the catalogue's smallest p is as small as that."""
        return _share(self.catalogue, p_value)

    def p_shapes(self, p_value: float, n_eff: float) -> float:
        """How often the plain shapes' smallest p is: of those drawn, and of all others as if independent."""
        return 1.0 - (1.0 - _share(self.shapes, p_value)) * (1.0 - corrected(p_value, n_eff))


def bootstrap(attempt: Attempt, seed: int) -> Bootstrap:
    """Draws for one attempt; `seed` fixes them."""
    rng = np.random.default_rng([seed, 3])
    given, noise, scatter = attempt.model.observations, attempt.noise, attempt.estimator.rows
    data = given.value.size
    plain = main_columns(given)
    plain = plain[:, np.any(plain[scatter] != 0.0, axis=0)]
    tried = [*(candidate.derivative for candidate in attempt.candidates), *plain.T[:, :, None]]
    widths = np.array([columns.shape[1] for columns in tried], dtype=np.intp)
    of_plain = np.full(plain.shape[1], float(np.min(noise.dof[scatter])))
    dofs = np.concatenate([[score.dof for score in attempt.scores], of_plain])
    fitted, columns = attempt.model.jacobian(attempt.result.values), np.hstack([np.zeros((data, 0)), *tried])
    known = np.setdiff1d(np.arange(len(attempt.left)), scatter)
    white = attempt.jacobian[known], attempt.padded(noise.whiten(columns))[known]
    frame = orthonormal(np.hstack(white), 1e-9)
    above = frame.T @ white[0], frame.T @ white[1]
    smallest = np.ones((DRAWS, 2))
    for draw in range(DRAWS):
        noisy = np.zeros(data)
        noisy[scatter] = noise.colour(rng.standard_normal(data))[scatter]
        found = attempt.estimator.estimate(noisy)
        left = np.concatenate([rng.standard_normal(frame.shape[1]), found.whiten(noisy)[scatter]])
        statistics = _statistics(
            np.vstack([above[0], found.whiten(fitted)[scatter]]),
            np.vstack([above[1], found.whiten(columns)[scatter]]),
            widths,
            left,
        )
        p_values = p_of(*statistics, dofs)
        smallest[draw] = [np.min(part, initial=1.0) for part in np.split(p_values, [len(tried) - plain.shape[1]])]
    return Bootstrap(smallest[:, 0], smallest[:, 1])


def _statistics(
    fitted: FloatArray, columns: FloatArray, widths: IntArray, left: FloatArray
) -> tuple[FloatArray, IntArray]:
    """(T, dimensions) of candidates whose columns stand side by side, `widths` of them each."""
    basis = orthonormal(fitted, 1e-8)
    free = columns - basis @ (basis.T @ columns)
    along = free.T @ (left - basis @ (basis.T @ left))
    size = np.sum(columns**2, axis=0)
    own = np.sum(free**2, axis=0)
    kept = own > ABSORBED**2 * np.where(size > 0.0, size, 1.0)
    first = np.concatenate([[0], np.cumsum(widths)[:-1]])
    statistics = np.where(kept, along**2 / np.where(kept, own, 1.0), 0.0)[first]
    dimensions = np.ones(len(widths), dtype=np.intp)
    for number in np.flatnonzero(widths > 1):
        where = first[number] + np.flatnonzero(kept[first[number] : first[number] + widths[number]])
        if len(where):
            root = orthonormal(free[:, where], ABSORBED)
            statistics[number] = np.sum((root.T @ left) ** 2)
            dimensions[number] = root.shape[1]
    return statistics, dimensions


def _share(smallest: FloatArray, p_value: float) -> float:
    return float((1 + np.sum(smallest <= p_value)) / (1 + len(smallest)))
