"""Lengths of columns, in one pass and without a copy of their squares."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray


def lengths(columns: FloatArray) -> FloatArray:
    """Euclidean norm of each column of a matrix (n, k), (k,)."""
    return np.asarray(np.sqrt(np.einsum("nk,nk->k", columns, columns)))
