"""The rotation between two frames from directions that are known in both.

Wahba's problem (SIAM Review 7, 1965, 409), weighted by the directions' uncertainties. What is uncertain of a rotation
is a small turn after it, v_to = (1 + [turn x]) R v_from, three angles about the axes of the target frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError

# Of the information on the three turns: directions along one line leave the turn about it open.
_MIN_INFORMATION = 1e-6


@dataclass(frozen=True)
class FrameRotation:
    """`matrix` (3, 3) takes vectors into the target frame; `covariance` (3, 3) [rad^2] is of the small turn after it.

    `chi2` is what the directions leave in units of their uncertainty, with `dof` degrees of freedom; both are 0 for a
    matrix that was given.
    """

    matrix: FloatArray
    covariance: FloatArray
    chi2: float = 0.0
    dof: int = 0

    def carried(self, vector: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A unit vector (3,) and its covariance (3, 3) in the target frame, what the rotation adds included."""
        there = self.matrix @ vector
        # turn x v: linear in the turn.
        lever = -_cross_matrix(there)
        return there, self.matrix @ covariance @ self.matrix.T + lever @ self.covariance @ lever.T

    def turns(self) -> list[tuple[FloatArray, float]]:
        """Independent parts of what is uncertain: directions (3,) in the target frame, the turn about each [rad]."""
        variances, directions = np.linalg.eigh(self.covariance)
        return [
            (_pointing_up(direction), float(np.sqrt(variance)))
            for variance, direction in zip(variances, directions.T, strict=True)
            # Turns that go wholly together leave others exactly known, but for rounding.
            if variance > 1e-12 * variances[-1]
        ]


def rotation_between(from_directions: FloatArray, to_directions: FloatArray, sigma_rad: FloatArray) -> FrameRotation:
    """The rotation that takes directions (n, 3) to the same ones in another frame, each known to `sigma_rad` (n,).

    `sigma_rad` is the standard uncertainty of a direction across itself, of both frames together, the same in all
    senses. `DataError` for directions along one line, which leave the turn about it open.
    """
    from scipy.spatial.transform import Rotation

    there = to_directions / np.linalg.norm(to_directions, axis=1)[:, None]
    here = from_directions / np.linalg.norm(from_directions, axis=1)[:, None]
    weights = sigma_rad**-2.0
    # Each direction knows nothing of the turn about itself.
    information = sum(w * (np.eye(3) - np.outer(v, v)) for w, v in zip(weights, there, strict=True))
    size = np.linalg.eigvalsh(information)
    if not size[0] > _MIN_INFORMATION * size[-1]:
        raise DataError("directions along one line leave the turn about it open: measure another one across it")
    matrix = Rotation.align_vectors(there, here, weights=weights)[0].as_matrix()
    left = ((there - here @ matrix.T) ** 2).sum(axis=1)
    return FrameRotation(matrix, np.linalg.inv(information), float(weights @ left), 2 * len(there) - 3)


def _cross_matrix(vector: FloatArray) -> FloatArray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _pointing_up(direction: FloatArray) -> FloatArray:
    """Of a direction and its opposite the one with its largest component positive."""
    return np.asarray(direction * np.sign(direction[np.argmax(np.abs(direction))]))
