"""Decompositions of matrices: of singular values, one that always ends; and into a triangle, for least squares."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigctl.core.arrays import FloatArray


def svd(matrix: FloatArray, *, full: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
    """U (n, k), s (k,) and V' (k, m) of a finite matrix (n, m), k = min(n, m); `full`: U (n, n) and V' (m, m).

    LAPACK's divide and conquer (gesdd) is fast, and gives up on some columns that are orthonormal already; QR
    iteration (gesvd) does not. Raises `numpy.linalg.LinAlgError` for a matrix that is not finite.
    """
    try:
        left, s, right = np.linalg.svd(matrix, full_matrices=full)
    except np.linalg.LinAlgError:
        if not np.all(np.isfinite(matrix)):
            raise
        from scipy import linalg  # only then: it takes longer to import than most fits take

        left, s, right = linalg.svd(matrix, full_matrices=full, lapack_driver="gesvd")
    return left, s, right


MANY_NUMBERS = 20_000
"""From here on a Gram matrix, where it is accurate enough, takes a quarter of the time of a QR decomposition."""

_WELL_CONDITIONED = 1e4
"""At this ratio of singular values a Gram matrix loses half of the digits in the weakest direction."""


@dataclass(frozen=True)
class Triangle:
    """R (k, m), upper triangular, of a matrix Q R with unit columns; k = m unless it has fewer rows than columns.

    `rcond` is the relative singular value below which a direction counts as undetermined. Singular values are worked
    out where rank or damping need them.
    """

    R: FloatArray
    rcond: float

    @cached_property
    def certain_inverse(self) -> FloatArray | None:
        """R^-1 where it is certain without singular values that R has full rank."""
        if self.R.shape[0] < self.R.shape[1] or not self.R.size:
            return None
        with np.errstate(all="ignore"):
            try:
                inverse = np.linalg.inv(self.R)
            except np.linalg.LinAlgError:
                return None
            # The product of these norms is no less than the ratio of the largest singular value to the smallest.
            certain = np.linalg.norm(self.R) * np.linalg.norm(inverse) * self.rcond < 1.0
        return np.asarray(inverse) if certain else None

    @cached_property
    def _singular(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """U, s and V' (all its rows: with fewer rows than columns the last of them span the null space)."""
        return svd(self.R, full=True)

    @cached_property
    def rank(self) -> int:
        """Of the matrix."""
        if self.certain_inverse is not None:
            return int(self.R.shape[1])
        s = self._singular[1]
        return int(np.sum(s > self.rcond * s[0])) if s.size and s[0] > 0.0 else 0

    @property
    def null(self) -> FloatArray:
        """Orthonormal rows (m - rank, m) that span what is undetermined."""
        return np.zeros((0, self.R.shape[1])) if self.certain_inverse is not None else self._singular[2][self.rank :]

    @property
    def inverse(self) -> FloatArray:
        """A root (m, rank) of the pseudo-inverse of R' R: that is it times its transpose."""
        if self.certain_inverse is not None:
            return self.certain_inverse
        return np.asarray(self._singular[2][: self.rank].T / self._singular[1][: self.rank])

    def within(self, projected: FloatArray) -> FloatArray:
        """The part of `projected` (k,) that R reaches, in an orthonormal basis of it."""
        return projected if self.certain_inverse is not None else (self._singular[0].T @ projected)[: self.rank]

    def solve(self, projected: FloatArray, damping: float) -> FloatArray:
        """The shortest x (m,) that makes |R x - `projected`|^2 + damping s_max^2 |x|^2 least."""
        if damping == 0.0 and self.certain_inverse is not None:
            return np.asarray(self.certain_inverse @ projected)
        left, s, right = self._singular
        s = s[: self.rank]
        filtered = s / (s**2 + damping * (s[0] ** 2 if s.size else 1.0))
        return np.asarray(right[: self.rank].T @ (filtered * (left.T @ projected)[: self.rank]))

    def fall(self, projected: FloatArray, damping: float) -> float:
        """By how much that x lowers |R x - `projected`|^2."""
        left, s, _ = self._singular
        share = s[: self.rank] ** 2
        share = share / (share + damping * (share[0] if share.size else 1.0))
        return float(np.sum((left.T @ projected)[: self.rank] ** 2 * (2.0 * share - share**2)))


def triangle_of(columns: FloatArray, scale: FloatArray, r: FloatArray, rcond: float) -> tuple[Triangle, FloatArray]:
    """R and Q' r of `columns` / `scale` = Q R, columns (n, m) of unit length; `r` (n,)."""
    if (by_gram := _by_gram(columns, scale)) is not None:
        triangle, inverse = by_gram
        return triangle, inverse.T @ ((columns.T @ r) / scale)
    # The residuals go along as one more column: Q^T r comes out of it, and Q need not be formed.
    count = min(columns.shape)
    whole: FloatArray = np.linalg.qr(np.column_stack([columns / scale, r]), mode="r")  # type: ignore[assignment]
    return Triangle(whole[:count, :-1], rcond), whole[:count, -1]


def _by_gram(columns: FloatArray, scale: FloatArray) -> tuple[Triangle, FloatArray] | None:
    """R of large matrices, and its inverse, from their Gram matrix; None where that is not accurate, or no faster."""
    if columns.size >= MANY_NUMBERS and columns.shape[1] <= columns.shape[0]:
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            gram = (columns.T @ columns) / np.outer(scale, scale)
            triangle = Triangle(np.asarray(np.linalg.cholesky(gram).T), 1.0 / _WELL_CONDITIONED)
            if triangle.certain_inverse is not None:
                return triangle, triangle.certain_inverse
    return None


VERY_MANY_NUMBERS = 500_000
"""From here on the Gram matrix, used twice, takes half of the time of singular values."""


def basis_by_gram(columns: FloatArray, scale: FloatArray) -> FloatArray | None:
    """An orthonormal basis (n, m) of very many numbers `columns` (n, m) of lengths `scale`, to rounding; None of
    fewer, and where columns are so alike that it takes singular values to tell their span.

    The first basis is orthogonal to the rounding of the Gram matrix, a step towards its inverse root does the rest
    (as Cholesky QR 2, Yamamoto et al., ETNA 44 (2015) 306).
    """
    by_gram = _by_gram(columns, scale) if columns.size >= VERY_MANY_NUMBERS else None
    if by_gram is None:
        return None
    basis = columns @ (by_gram[1] / scale[:, None])
    return np.asarray(basis @ (1.5 * np.eye(columns.shape[1]) - 0.5 * (basis.T @ basis)))
