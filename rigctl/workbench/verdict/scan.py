"""Score tests of many choices of one effect at once: the periods, rates and places of a scan.

What `score.Projector.score` does for one candidate, with one product of matrices for all of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.score import ABSORBED, Projector, Score, p_of

TOGETHER = 32
"""So many choices of an effect are scored together."""


def scores_of_choices(projector: Projector, columns: FloatArray, dimension: int) -> list[Score]:
    """Scores of candidates whose whitened columns (n, choices x dimension) stand side by side."""
    n, choices = len(columns), columns.shape[1] // dimension
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0.0, size, 1.0)
    free = projector.free(unit)
    keep = np.linalg.norm(free, axis=0)
    keep, size = keep.reshape(choices, dimension), size.reshape(choices, dimension)
    stack = np.where(keep > ABSORBED, free.reshape(n, choices, dimension), 0.0)
    gram = np.einsum("nki,nkj->kij", stack, stack, optimize=True)
    square, vectors = np.linalg.eigh(gram)
    s = np.sqrt(np.maximum(square, 0.0))
    determined = (s > ABSORBED * s[:, -1:]) & (s[:, -1:] > 0.0)
    root = np.where(determined[:, None, :], vectors / np.where(determined, s, 1.0)[:, None, :], 0.0)
    bases = np.einsum("nki,kij->nkj", stack, root, optimize=True)
    along = np.einsum("nkj,n->kj", bases, projector.left, optimize=True)
    scale = np.where(size > 0.0, size, 1.0)
    seen = (keep > ABSORBED) & determined.any(axis=1, keepdims=True)
    estimate = np.where(seen, np.einsum("kij,kj->ki", root, along) / scale, 0.0)
    sigma = np.where(seen, np.sqrt(np.sum(root**2, axis=2)) / scale, np.inf)
    statistic, dimensions = np.sum(along**2, axis=1), determined.sum(axis=1)
    dof = projector.dof_of_each(bases)
    dof = np.where(dimensions > 0, dof, np.inf)
    p_values = np.where(dimensions > 0, p_of(statistic, dimensions, dof), 1.0)
    return [
        Score(
            float(statistic[k]),
            int(dimensions[k]),
            float(dof[k]),
            float(p_values[k]),
            keep[k],
            estimate[k],
            sigma[k],
            bases[:, k, determined[k]],
        )
        for k in range(choices)
    ]


def by_own_noise(scores: list[Score], frame: FloatArray, left: FloatArray, dof: float) -> list[Score]:
    """Scores with the scale of the noise as it is once each is in: what an effect explains inflates it before.

    `frame` (data, p) spans all that is projected out where the noise is estimated, `left` (data,) are the whitened
    residuals, `dof` the degrees of freedom of their scale.
    """
    data = len(frame)
    bases = np.hstack([score.basis[:data] for score in scores])
    if not bases.shape[1]:
        return scores
    inside = frame.T @ bases
    outside = left - frame @ (frame.T @ left)
    explained = np.append((outside @ bases) ** 2, 0.0)
    taken = np.append(np.maximum(np.sum(bases**2, axis=0) - np.sum(inside**2, axis=0), 0.0), 0.0)
    dimensions = np.array([score.dimension for score in scores])
    first = np.concatenate([[0], np.cumsum(dimensions)[:-1]])
    # An effect without dimensions takes the sum of the next one's first column: it is not used.
    explained, taken = np.add.reduceat(explained, first), np.add.reduceat(taken, first)
    used = (dimensions > 0) & (dof - taken >= 1.0)
    rest = np.where(used, dof - taken, 1.0)
    scale = np.maximum(dof - explained, 1e-9 * dof) / rest
    statistics = np.array([score.statistic for score in scores])
    p_values = p_of(statistics / scale, dimensions, rest)
    return [
        replace(score, dof=float(rest[k]), p_value=float(p_values[k])) if used[k] else score
        for k, score in enumerate(scores)
    ]
