"""A singular value decomposition that always ends."""

from __future__ import annotations

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
