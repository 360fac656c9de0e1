"""Cross-validation: the error of a model on held-out blocks of runs.

Blocks (mountings, else stretches of time) are left out in turn. At the fit everything is linear, so that the fit of
the rest follows from that of all: with Q an orthonormal basis of what is fitted and e the residuals, a block's errors
when it was left out are (1 - Q Q')^-1 e on its rows, and that inverse is their covariance when the model is right.
They count as far as the rest predicts them: what only the block itself knows (the null of that mounting) is fitted
on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray, IntArray
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.noise import orthonormal

_LOG_TWO_PI = float(np.log(2.0 * np.pi))
_ONLY_HERE = 1e-9
"""Of a direction's information, left over in all other blocks: below, only this block knows it."""


@dataclass(frozen=True)
class Predicted:
    """A block predicted from the others: the `square` sum of its errors in units of their covariance, what is
    `expected` of that when the model is right, and that covariance's `log_determinant` in units of the noise."""

    square: float
    expected: float
    log_determinant: float


class HeldOut:
    """Blocks of whitened data left out of a fit in turn.

    `basis` (n + priors, rank) spans what is fitted, `residuals` (n + priors,) are what the fit leaves.
    """

    def __init__(self, given: Observations, basis: FloatArray, residuals: FloatArray) -> None:
        self._basis, self._residuals = basis, residuals
        blocks = given.block_of[given.run_of]
        self._blocks = [np.flatnonzero(blocks == number) for number in np.unique(blocks)]
        self._data = len(given.value)
        self._series_of = given.series_of

    @property
    def possible(self) -> bool:
        """False when there is one block only."""
        return len(self._blocks) > 1

    def error(self, further: FloatArray | None = None, series: IntArray | None = None) -> float:
        """Rms error of held-out data in units of what is expected when the model is right; 1.00 is noise.

        `further` (n + priors, d), orthonormal and outside the basis, is added to the model; `series` restricts to
        some series. NaN when nothing can be held out.
        """
        basis, left = self._basis, self._residuals
        if further is not None:
            basis, left = np.hstack([basis, further]), left - further @ (further.T @ left)
        wanted = np.ones(self._data, dtype=bool) if series is None else np.isin(self._series_of, series)
        if not self.possible:
            return float("nan")
        # Many models with something more are compared with one that stays.
        made = self._apart if further is None else [_Block.of(basis[block], left[block]) for block in self._blocks]
        blocks = [each.predicted(wanted[block]) for each, block in zip(made, self._blocks, strict=True)]
        expected = sum(block.expected for block in blocks)
        return float(np.sqrt(sum(block.square for block in blocks) / expected)) if expected > 0.0 else float("nan")

    def log_score(self, log_determinant: float) -> float:
        """Mean log density of held-out data, per datum; `log_determinant` is that of all data's covariance.

        NaN when nothing can be held out.
        """
        if not self.possible:
            return float("nan")
        blocks = self.blocks
        total = sum(each.square + each.log_determinant + each.expected * _LOG_TWO_PI for each in blocks)
        return -0.5 * (total + log_determinant) / max(sum(each.expected for each in blocks), 1.0)

    @cached_property
    def blocks(self) -> list[Predicted]:
        """Every block as the others predict it."""
        return [each.predicted(np.ones(len(each.error), dtype=bool)) for each in self._apart]

    @cached_property
    def _apart(self) -> list[_Block]:
        return [_Block.of(self._basis[block], self._residuals[block]) for block in self._blocks]


def error_ratio(after: float, before: float) -> float:
    """Of held-out errors; NaN where readings that a model follows exactly were off by nothing before."""
    return after / before if before > 0.0 else float("nan")


def rise_beyond_chance(after: HeldOut, before: HeldOut) -> float:
    """The rise of the squared error from one model to another on the same blocks over its standard error, paired.

    0 where it cannot be told.
    """
    if not after.possible or len(after.blocks) != len(before.blocks):
        return 0.0
    shares = [
        np.array([block.square for block in each.blocks]) / max(sum(block.expected for block in each.blocks), 1.0)
        for each in (after, before)
    ]
    change = shares[0] - shares[1]
    # Of the sum over blocks, from how the blocks' changes scatter.
    spread = float(np.sqrt(len(change)) * np.std(change, ddof=1))
    return float(np.sum(change)) / spread if spread > 0.0 else 0.0


@dataclass(frozen=True)
class _Block:
    """A block left out: its errors (n,), whose covariance is 1 + S S' with `spread` S (n, directions), and what is
    `free` of each direction once the rest has been fitted, (directions,)."""

    error: FloatArray
    spread: FloatArray
    free: FloatArray

    @classmethod
    def of(cls, basis: FloatArray, left: FloatArray) -> _Block:
        """From its rows of the basis of what is fitted and of what the fit leaves."""
        # Eigenvalues of Q Q' on the block, by whichever side is smaller.
        if len(basis) < basis.shape[1]:
            share, vectors = np.linalg.eigh(basis @ basis.T)
            fitted = share > _ONLY_HERE
            vectors = vectors[:, fitted]
        else:
            share, ways = np.linalg.eigh(basis.T @ basis)
            fitted = share > _ONLY_HERE
            vectors = basis @ (ways[:, fitted] / np.sqrt(share[fitted]))
        free = np.maximum(1.0 - share[fitted], _ONLY_HERE)
        # (1 - Q Q')^-1 = 1 + V (1 / free - 1) V' with eigenvectors V, since Q Q' is nil outside them.
        error = left + vectors @ ((1.0 / free - 1.0) * (vectors.T @ left))
        # Their covariance is 1 + V D V': little outside the few directions of V.
        return cls(error, vectors * np.sqrt((1.0 - free) / free), free)

    def predicted(self, seen: BoolArray) -> Predicted:
        """The block where it was `seen`."""
        error, spread = self.error[seen], self.spread[seen]
        gram = spread.T @ spread
        along = spread.T @ error
        square = error @ error - along @ np.linalg.solve(np.eye(len(gram)) + gram, along)
        only_here = self.free <= _ONLY_HERE
        # Such directions were fitted on the block itself, and each takes one of its degrees of freedom.
        size = np.linalg.eigvalsh(gram[np.ix_(only_here, only_here)])
        known_here = orthonormal(spread[:, only_here], _ONLY_HERE)
        rest = spread[:, ~only_here]
        rest = rest - known_here @ (known_here.T @ rest)
        determinant = float(np.linalg.slogdet(np.eye(rest.shape[1]) + rest.T @ rest)[1])
        return Predicted(float(square), float(seen.sum() - np.sum(size > 1.0)), determinant)
