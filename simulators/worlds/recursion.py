"""Linear recursions over many steps, solved as the banded triangular systems that they are.

Not by `scipy.signal`, whose import takes longer than all else that a simulated bench needs to start.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from rigctl.core.arrays import ComplexArray, FloatArray

_Number = TypeVar("_Number", np.float64, np.complex128)


def first_order(kept: complex, driven: ComplexArray, before: complex) -> ComplexArray:
    """y[n] = kept y[n - 1] + driven[n] from y[-1] = `before` on, (steps,)."""
    return _continued(np.array([1.0, -kept], dtype=np.complex128), np.array([[before]]), driven[:, np.newaxis])[:, 0]


class SecondOrderSection:
    """a0 y[n] + a1 y[n - 1] + a2 y[n - 2] = b0 x[n] + b1 x[n - 1] + b2 x[n - 2] with a0 = 1, from rest.

    What comes out does not depend on how much is put in at a time.
    """

    def __init__(self, b: FloatArray, a: FloatArray, columns: int) -> None:
        self._b, self._a = b, a
        # The last two of each, the older first.
        self._entered, self._left = np.zeros((2, columns)), np.zeros((2, columns))

    def filtered(self, entering: FloatArray) -> FloatArray:
        """What leaves, (steps, columns), as what enters."""
        x = np.concatenate([self._entered, entering])
        left = _continued(self._a, self._left, self._b[0] * x[2:] + self._b[1] * x[1:-1] + self._b[2] * x[:-2])
        self._entered, self._left = x[-2:], np.concatenate([self._left, left])[-2:]
        return left


def _continued(a: NDArray[_Number], before: NDArray[_Number], driven: NDArray[_Number]) -> NDArray[_Number]:
    """The y of sum_k a[k] y[n - k] = driven[n] with a[0] = 1 that follow `before`, (len(a) - 1, columns)."""
    order = len(before)
    bands = np.empty((order + 1, order + len(driven)), dtype=a.dtype, order="F")
    bands[:] = a[:, np.newaxis]
    for column in range(order):
        # What came before is given and not solved for.
        bands[1 : order - column, column] = 0.0
    solve = lapack.ztbtrs if np.iscomplexobj(a) else lapack.dtbtrs
    solved, _ = solve(bands, np.concatenate([before, driven]), uplo="L", diag="U")
    return np.asarray(solved[order:])
