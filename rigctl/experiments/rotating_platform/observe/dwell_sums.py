"""Sum and first moment of dwells, in one pass over the memory: compiled, since numpy would need three.

The sums are made in pieces, each with a ramp of its own: short partial sums round less. Their order within a piece is
the compiler's, several lanes at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from rigctl.core.arrays import BoolArray, FloatArray

_PIECE = 1024


class DwellSums(NamedTuple):
    """Per period, shape (periods,): sum of a dwell's samples, sum of index times sample, whether one is unusable.

    The index counts from the dwell's first sample.
    """

    level: FloatArray
    ramp: FloatArray
    faulty: BoolArray


# Without "nnan" and "ninf": a sample that is no number has to make the sum none.
@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def line_sums(line: FloatArray, full_scale: float) -> tuple[float, float, bool]:
    """The sums of one stretch of samples, shape (samples,), contiguous.

    It is faulty when a sample is not finite or its magnitude reaches `full_scale`; its sums mean nothing then.
    """
    level = ramp = 0.0
    over = 0
    for at in range(0, line.size, _PIECE):
        piece = line[at : at + _PIECE]
        of_piece = ramp_of_piece = index = 0.0
        for i in range(piece.size):
            sample = piece[i]
            of_piece += sample
            ramp_of_piece += index * sample
            index += 1.0
            over += abs(sample) >= full_scale
        level += of_piece
        ramp += ramp_of_piece + at * of_piece
    return level, ramp, over > 0 or not math.isfinite(level)


@njit(cache=True, nogil=True, error_model="numpy")
def _of_periods(
    line: FloatArray,
    start: int,
    stop: int,
    period: int,
    full_scale: float,
    level: FloatArray,
    ramp: FloatArray,
    faulty: BoolArray,
) -> None:
    for i in range(level.size):
        first = i * period
        level[i], ramp[i], faulty[i] = line_sums(line[first + start : first + stop], full_scale)


def dwell_sums(line: FloatArray, start: int, stop: int, period: int, full_scale: float = np.inf) -> DwellSums:
    """The sums of samples `start` to `stop` of each whole `period` of `line`, shape (samples,), contiguous."""
    periods = line.size // period
    found = DwellSums(np.empty(periods), np.empty(periods), np.empty(periods, dtype=np.bool_))
    _of_periods(line, start, stop, period, full_scale, *found)
    return found
