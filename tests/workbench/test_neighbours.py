"""Blocks of neighbouring data have the mean and the correlation that sums of these data have."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.verdict.kernels import kernel
from rigctl.workbench.verdict.neighbours import Neighbours, blocks, stretch

SCALES = (0.5, 80.0)


def sums(neighbours: Neighbours, data: int) -> FloatArray:
    """What makes blocks of data, as one matrix."""
    matrix = np.zeros((len(neighbours.first), data))
    for block, own in enumerate(np.split(neighbours.members, neighbours.first[1:])):
        matrix[block, own] = 1.0 / np.sqrt(len(own))
    return matrix


@pytest.mark.parametrize("size", [1, 2, 3, 7])
@pytest.mark.parametrize("name", ["exp 0.2", "exp 30.0", "power 1", "power 2.4"])
def test_blocks_are_correlated_as_sums_of_their_data_are(size: int, name: str) -> None:
    at = np.random.default_rng(size).uniform(0.0, 80.0, 43)
    found = blocks(at, np.zeros(43, dtype=np.intp), size)
    matrix = sums(found, 43)
    apart = np.abs(at[:, None] - at[None, :])
    expected = matrix @ kernel(name, apart, SCALES) @ matrix.T
    assert found.kernel(name, at, SCALES) == pytest.approx(expected, rel=1e-12)
    assert found.of(at) == pytest.approx(matrix @ at, rel=1e-12)
    columns = np.stack([at, at**2], axis=1)[:, :, None]
    assert found.of(columns)[:, 1, 0] == pytest.approx(matrix @ at**2, rel=1e-12)


@pytest.mark.parametrize("size", [2, 4, 5])
def test_each_datum_is_in_one_block_beside_its_neighbours_in_its_group(size: int) -> None:
    rng = np.random.default_rng(size)
    at, group = rng.uniform(0.0, 9.0, 31), rng.integers(0, 3, 31)
    found = blocks(at, group, size)
    assert sorted(found.members) == list(range(31))
    for own in np.split(found.members, found.first[1:]):
        assert 1 <= len(own) <= size
        assert len(set(group[own])) == 1
        assert neighbours_of(at, group, own) == sorted(own)


def neighbours_of(at: FloatArray, group: IntArray, own: IntArray) -> list[int]:
    """All data of the group no earlier and no later than a block's."""
    between = (at >= at[own].min()) & (at <= at[own].max()) & (group == group[own[0]])
    return list(np.flatnonzero(between))


def test_a_stretch_is_in_the_middle_and_in_one_piece() -> None:
    assert list(stretch(10, 4).members) == [3, 4, 5, 6]
    assert stretch(10, 4).of(np.arange(10.0)).tolist() == [3.0, 4.0, 5.0, 6.0]
