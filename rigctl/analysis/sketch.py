"""A sketch of long columns: few numbers whose products are those of the columns, but for two or three per cent.

Every row goes to one of so many buckets, with a sign of its own (Charikar, Chen and Farach-Colton, ICALP 2002, 693):
the mean of a product of two sketched columns is the product of the columns, its standard deviation at most
sqrt(2 / buckets) of the product of their lengths.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray

BUCKETS = 2048


@lru_cache(maxsize=2)
def sketch_of(rows: int) -> Sketch:
    """The sketch of all columns of so many rows."""
    return Sketch(rows)


class Sketch:
    """Of columns with so many `rows`; `bucket_of` (rows,) and `sign` (rows,) are drawn with a fixed seed."""

    def __init__(self, rows: int, buckets: int = BUCKETS) -> None:
        # A stream of its own: the same table has the same sketch.
        rng = np.random.default_rng([0, 7])
        self.buckets = buckets
        self.bucket_of: IntArray = rng.integers(0, buckets, rows)
        self.sign: FloatArray = np.where(rng.integers(0, 2, rows) > 0, 1.0, -1.0)

    def of(self, columns: FloatArray, rows: IntArray | slice = slice(None)) -> FloatArray:
        """Columns (rows, k) as (buckets, k); of some `rows` where the columns are zero elsewhere."""
        bucket_of, sign = self.bucket_of[rows], self.sign[rows]
        sums = [np.bincount(bucket_of, sign * column, self.buckets) for column in columns.T]
        return np.stack(sums, axis=1) if sums else np.zeros((self.buckets, 0))
