"""Linear recursions over many steps, solved as the banded triangular systems that they are.

Not by `scipy.signal`, whose import takes as long as all others of a simulated campaign.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from rigctl.core.arrays import ComplexArray, FloatArray

_Number = TypeVar("_Number", np.float64, np.complex128)

_AT_ONCE = 1024
"""Steps solved at a time: what is used again stays near the processor."""


def first_order(kept: complex, driven: ComplexArray, before: complex) -> ComplexArray:
    """y[n] = kept y[n - 1] + driven[n] from y[-1] = `before` on, (steps,)."""
    bands = _bands(np.array([1.0, -kept], dtype=np.complex128), driven.size)
    return np.asarray(_continued(bands, np.array([[before]]), driven[np.newaxis])[0])


class SecondOrderSection:
    """a0 y[n] + a1 y[n - 1] + a2 y[n - 2] = b0 x[n] + b1 x[n - 1] + b2 x[n - 2] with a0 = 1, from rest.

    What comes out does not depend on how much is put in at a time.
    """

    def __init__(self, b: FloatArray, a: FloatArray, series: int) -> None:
        self._b, self._bands = b, _bands(a, _AT_ONCE)
        # The last two of each, the older first.
        self._entered, self._left = np.zeros((2, series, 2))

    def filtered(self, entering: FloatArray) -> FloatArray:
        """What leaves, (series, steps), as what enters."""
        leaving = np.empty_like(entering)
        for start in range(0, entering.shape[1], _AT_ONCE):
            here = slice(start, start + _AT_ONCE)
            x = np.concatenate([self._entered, entering[:, here]], axis=1)
            driven = self._b[0] * x[:, 2:]
            driven += self._b[1] * x[:, 1:-1]
            driven += self._b[2] * x[:, :-2]
            leaving[:, here] = left = _continued(self._bands, self._left, driven)
            self._entered, self._left = x[:, -2:], np.concatenate([self._left, left], axis=1)[:, -2:]
        return leaving


def _bands(a: NDArray[_Number], steps: int) -> NDArray[_Number]:
    """Of the system sum_k a[k] y[n - k] = driven[n] for so many steps after those that are known."""
    order = len(a) - 1
    bands = np.empty((order + 1, order + steps), dtype=a.dtype, order="F")
    bands[:] = a[:, np.newaxis]
    for column in range(order):
        # What came before is given and not solved for.
        bands[1 : order - column, column] = 0.0
    return bands


def _continued(bands: NDArray[_Number], before: NDArray[_Number], driven: NDArray[_Number]) -> NDArray[_Number]:
    """What follows `before`, (series, order), where `driven` drives it, (series, steps)."""
    order = before.shape[1]
    solve = lapack.ztbtrs if np.iscomplexobj(bands) else lapack.dtbtrs
    right = np.concatenate([before, driven], axis=1)
    solved, _ = solve(bands[:, : right.shape[1]], right.T, uplo="L", diag="U", overwrite_b=True)
    return np.asarray(solved.T[:, order:])
