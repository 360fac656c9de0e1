"""How many independent trials many correlated ones amount to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.workbench.verdict.noise import orthonormal
from rigctl.workbench.verdict.scan import ScanScores
from rigctl.workbench.verdict.score import smallest_p

# Forty lie below the 2 % quantile: the number of trials is known to 16 %.
DRAWS = 2000
QUANTILE = 0.02


def trials(bases: Sequence[FloatArray], scans: Sequence[ScanScores], rows: int, seed: int) -> float:
    """How many independent trials candidates with these bases (rows, d) and scans amount to.

    Noise is drawn, in the span of the bases alone where there are no scans; 1 - (1 - p)^n is matched to the smallest
    p at its 2 % quantile.
    """
    wide = [basis for basis in bases if basis.shape[1]]
    scans = [each for each in scans if each.dimension.any()]
    if not wide and not scans:
        return 1.0
    # A stream of its own; 2 draws for shapes, 3 for the bootstrap, 4 for shapes beside others.
    rng, smallest = np.random.default_rng([seed, 1]), np.ones(DRAWS)
    dimensions = np.array([basis.shape[1] for basis in wide], dtype=np.intp)
    span = np.hstack([np.zeros((rows, 0)), *wide])
    first = np.concatenate([[0], np.cumsum(dimensions)[:-1]])
    if not scans and span.shape[1] <= rows:
        # Only what the bases span is drawn: few numbers instead of one for every datum.
        frame = orthonormal(span, 1e-6) if span.shape[1] > 1 else span
        along = rng.standard_normal((DRAWS, frame.shape[1])) @ (frame.T @ span)
        return trials_of(smallest_p(np.add.reduceat(along**2, first, axis=1), dimensions))
    draws = rng.standard_normal((DRAWS, rows), dtype=np.float32)
    if wide:
        squares = np.square(draws @ span.astype(np.float32))
        smallest = smallest_p(np.add.reduceat(squares, first, axis=1), dimensions)
    for each in scans:
        smallest = np.minimum(smallest, each.smallest_p(draws, (seed, rows)))
    return trials_of(smallest)


def trials_of(smallest: FloatArray) -> float:
    """Independent trials whose smallest p has the 2 % quantile of these."""
    # Where every trial is absorbed by the model, all of them are 1.
    level = min(float(np.quantile(smallest, QUANTILE)), 1.0 - 1e-16)
    return max(float(np.log1p(-QUANTILE) / np.log1p(-level)), 1.0)
