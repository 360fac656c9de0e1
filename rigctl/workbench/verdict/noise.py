"""The noise of the observables as a covariance: whitening with it, drawing from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigctl.analysis.correlated_groups import CorrelatedGroups, Factor, log_determinant, variances
from rigctl.analysis.decomposition import basis_by_gram, svd
from rigctl.analysis.lengths import lengths
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.verdict.kernels import SlowNoise


@dataclass(frozen=True)
class Correlation:
    """A pool's noise from run to run: R = 1 + ratio * kernel.

    `kernel` is "exp TAU" for a relaxation, "power A" for a power law 1/f^A, "" for white noise.
    """

    kernel: str
    ratio: float

    @property
    def kind(self) -> str:
        """ "exp", "power", or "" for white noise."""
        return self.kernel.partition(" ")[0]

    @property
    def shape(self) -> float:
        """The time constant or the exponent; NaN for white noise."""
        return float(self.kernel.partition(" ")[2] or "nan")


@dataclass(frozen=True)
class Noise:
    """Covariance of n data: `sigma` (n,) of the white part, correlated groups as Cholesky factors of R.

    `dof` (n,) degrees of freedom behind each sigma.
    """

    sigma: FloatArray
    dof: FloatArray
    factors: tuple[Factor, ...]
    correlations: tuple[Correlation, ...]
    between: tuple[tuple[FloatArray, float], ...] = ()
    """Of offsets that data share, what varies only between them, whitened, (n, k), and their degrees of freedom."""
    slow: tuple[SlowNoise, ...] = ()
    """By which law data are correlated along an order, for those of `factors` that are."""
    least: float = 0.0
    """Of the variance, where one scale of the scatter's is that of all data: below, no estimate of it goes."""

    def whiten(self, columns: FloatArray) -> FloatArray:
        """W columns, shape (n,) or (n, k): independent, of unit variance where `columns` are this noise."""
        scaled = columns / (self.sigma if columns.ndim == 1 else self.sigma[:, None])
        return np.asarray(self._groups.solve(scaled), dtype=np.float64)

    def whiten_rows(self, rows: IntArray, columns: FloatArray) -> tuple[IntArray, FloatArray]:
        """Columns (rows, k) that are zero elsewhere, whitened: the rows they then have, and their values there."""
        touched = np.zeros(len(self.sigma), dtype=bool)
        touched[rows] = True
        factors = [(where, factor) for where, factor in self.factors if touched[where].any()]
        if not factors:
            return rows, columns / self.sigma[rows][:, None]
        everywhere = np.unique(np.concatenate([rows, *(where for where, _ in factors)]))
        white = np.zeros((len(everywhere), columns.shape[1]))
        white[np.searchsorted(everywhere, rows)] = columns / self.sigma[rows][:, None]
        if len(everywhere) == len(self.sigma):
            return everywhere, self._groups.solve(white)
        own = [(np.searchsorted(everywhere, where), factor) for where, factor in factors]
        return everywhere, CorrelatedGroups(own, len(everywhere)).solve(white)

    def colour(self, white: FloatArray) -> FloatArray:
        """The inverse of `whiten`: noise of this kind from independent numbers of unit variance."""
        coloured = self._groups.times(white)
        return np.asarray(coloured * (self.sigma if white.ndim == 1 else self.sigma[:, None]), dtype=np.float64)

    def variance_of(self, sums: FloatArray) -> FloatArray:
        """Covariance (k, k) of sums of the data with weights (n, k)."""
        spread = self._groups.transposed_times(sums * self.sigma[:, None])
        return np.asarray(spread.T @ spread)

    def weights_of(self, white: FloatArray) -> FloatArray:
        """W' columns (n, k): the weights of the data themselves in sums of whitened data."""
        return np.asarray(self._groups.solve_transposed(white) / self.sigma[:, None], dtype=np.float64)

    def log_determinant(self) -> float:
        """Of the covariance."""
        of_factors = sum(log_determinant(factor) for _, factor in self.factors)
        return 2.0 * (float(np.sum(np.log(self.sigma))) + of_factors)

    @cached_property
    def _groups(self) -> CorrelatedGroups:
        return CorrelatedGroups(self.factors, len(self.sigma))

    def total_sigma(self) -> FloatArray:
        """Standard deviation of each datum, correlations included, shape (n,)."""
        return self._total_sigma

    @cached_property
    def _total_sigma(self) -> FloatArray:
        total = self.sigma.copy()
        for where, factor in self.factors:
            # The diagonal of L L': in R = 1 + ratio * kernel it is more than the white part's 1.
            total[where] *= np.sqrt(variances(factor))
        total.flags.writeable = False
        return total


def orthonormal(columns: FloatArray, tolerance: float) -> FloatArray:
    """Orthonormal basis of the span of columns, those scaled to unit length first; shape (n, rank)."""
    norms = lengths(columns)
    there = norms > 0.0
    if not there.any():
        return np.zeros((len(columns), 0))
    used, norms = columns if there.all() else columns[:, there], norms[there]
    if (basis := basis_by_gram(used, norms)) is not None:
        return basis
    left, s, _ = svd(used / norms)
    return np.asarray(left[:, s > tolerance * s[0]])
