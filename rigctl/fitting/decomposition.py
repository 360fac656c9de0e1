"""A singular value decomposition that always ends."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from rigctl.interfaces import FloatArray


def thin_svd(matrix: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """U (n, k), s (k,) and V' (k, m) of a finite matrix (n, m), k = min(n, m).

    LAPACK's divide and conquer (gesdd) is fast, and gives up on some columns that are orthonormal already; QR
    iteration (gesvd) does not. Raises `numpy.linalg.LinAlgError` for a matrix that is not finite.
    """
    try:
        left, s, right = np.linalg.svd(matrix, full_matrices=False)
    except np.linalg.LinAlgError:
        if not np.all(np.isfinite(matrix)):
            raise
        left, s, right = linalg.svd(matrix, full_matrices=False, lapack_driver="gesvd")
    return left, s, right
