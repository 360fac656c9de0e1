"""Values that belong to numbered pieces, taken piece by piece: of a motion, of a voltage."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from rigctl.core.arrays import BoolArray, IntArray


def stretches(piece_of: IntArray) -> Iterator[tuple[int, slice | BoolArray]]:
    """Each piece that occurs, and where: slices when the pieces come in order, as in times that do; else masks."""
    if not piece_of.size:
        return
    change = np.flatnonzero(np.diff(piece_of.ravel()))
    if piece_of.ndim == 1 and np.all(piece_of[change + 1] > piece_of[change]):
        bounds = [0, *(change + 1).tolist(), len(piece_of)]
        for first, end in itertools.pairwise(bounds):
            yield int(piece_of[first]), slice(first, end)
    else:
        for piece in np.unique(piece_of):
            yield int(piece), piece_of == piece
