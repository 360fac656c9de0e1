"""Means of neighbouring data along an order: what is slow in many data, told by few numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.verdict.kernels import kernel, relaxations


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Data of a pool in blocks: `members` are their places, block by block, of which each begins at one of `first`.

    A block stands for its data as their sum over the root of their number: independent data of unit variance are
    such blocks as well. Blocks of one are the data themselves. `size` is the most that a block has.
    """

    members: IntArray
    first: IntArray
    size: int

    def of(self, columns: FloatArray) -> FloatArray:
        """The blocks of columns (pool, ...), (blocks, ...)."""
        here = columns[self.members]
        if self.size == 1:
            return here
        roots = np.sqrt(self._counts).reshape(-1, *[1] * (columns.ndim - 1))
        return np.asarray(np.add.reduceat(here, self.first, axis=0) / roots)

    def kernel(self, name: str, at: FloatArray, scales: tuple[float, float]) -> FloatArray:
        """How blocks are correlated whose data, at these places on the order (pool,), have this kernel."""
        at = at[self.members]
        if self.size == 1:
            return kernel(name, np.abs(at[:, None] - at[None, :]), scales)
        begin, end = at[self.first], at[self.first + self._counts - 1]
        block = np.repeat(np.arange(len(self.first)), self._counts)
        before, after, gaps = at - end[block], begin[block] - at, self._gaps(at)
        # Blocks of one group follow each other.
        across = np.maximum(begin[None, :] - end[:, None], 0.0)
        found, own = np.zeros_like(across), np.zeros(len(begin))
        for share, constant in relaxations(name, scales):
            # From a datum to the end of its block, across to another, into that: a product of exponentials.
            to_end = np.add.reduceat(np.exp(before / constant), self.first)
            from_begin = np.add.reduceat(np.exp(after / constant), self.first)
            found += share * to_end[:, None] * from_begin * np.exp(-across / constant)
            own += share * self._pairs(np.exp(-gaps / constant))
        later, roots = np.triu(found, 1), np.sqrt(self._counts)
        return np.asarray((later + later.T + np.diag(own)) / (roots[:, None] * roots))

    def _gaps(self, at: FloatArray) -> FloatArray:
        """From each datum of a block to the next, (size - 1, blocks); infinite where it has fewer."""
        gaps = np.full((self.size - 1, len(self.first)), np.inf)
        for place in range(self.size - 1):
            there = self._counts > place + 1
            gaps[place, there] = at[self.first[there] + place + 1] - at[self.first[there] + place]
        return gaps

    def _pairs(self, kept: FloatArray) -> FloatArray:
        """Sum over all pairs of data of each block, (blocks,), of what is `kept` across the gaps between them."""
        total, of_all_before = self._counts.astype(np.float64), np.zeros(len(self.first))
        for each in kept:
            of_all_before = (of_all_before + 1.0) * each
            total += 2.0 * of_all_before
        return total

    @cached_property
    def _counts(self) -> IntArray:
        return np.diff(np.append(self.first, len(self.members)))


def stretch(data: int, count: int) -> Neighbours:
    """So many of the data, in one piece from their middle: a correlation shows between neighbours."""
    first = (data - count) // 2
    return Neighbours(np.arange(first, first + count), np.arange(count), 1)


def blocks(at: FloatArray, group: IntArray, size: int) -> Neighbours:
    """All data, no more than `size` of a group that are next to each other `at` places on the order (data,)."""
    members = np.lexsort((at, group))
    counts = np.unique(group, return_counts=True)[1]
    begins = np.concatenate([[0], np.cumsum(counts)])
    parts = [
        begin + np.arange(number) * count // number
        for begin, count in zip(begins, counts, strict=False)
        for number in [-(-count // size)]
    ]
    return Neighbours(members, np.concatenate(parts), size)
