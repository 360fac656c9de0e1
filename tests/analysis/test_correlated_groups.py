"""Groups of correlated data, against one matrix of all."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.analysis.correlated_groups import MANY, CorrelatedGroups, Factor
from rigctl.core.arrays import FloatArray

COUNT = 90


def drawn(groups: int, seed: int) -> list[Factor]:
    """Groups without a datum in common, and some data in none."""
    rng = np.random.default_rng(seed)
    places = np.array_split(rng.permutation(COUNT)[: COUNT - 7], groups)
    return [(np.sort(where), triangle(rng, len(where))) for where in places]


def triangle(rng: np.random.Generator, size: int) -> FloatArray:
    share = rng.uniform(0.1, 0.9)
    return np.asarray(np.linalg.cholesky((1.0 - share) * np.eye(size) + share))


def whole(factors: list[Factor]) -> FloatArray:
    """L of all as one matrix: the last group acts first."""
    product = np.eye(COUNT)
    for where, factor in factors:
        one = np.eye(COUNT)
        one[np.ix_(where, where)] = factor
        product = product @ one
    return product


@pytest.mark.parametrize("layers", [[3], [MANY + 4], [MANY + 4, 2], [2, MANY, MANY + 1]])
def test_groups_do_what_one_matrix_of_all_does(layers: list[int]) -> None:
    factors = [factor for seed, groups in enumerate(layers) for factor in drawn(groups, seed)]
    groups, matrix = CorrelatedGroups(factors, COUNT), whole(factors)
    columns = np.random.default_rng(1).standard_normal((COUNT, 5))
    columns[:, 2] *= np.arange(COUNT) == factors[0][0][0]  # which most groups have nothing of
    for given in (columns, columns[:, 0]):
        before = given.copy()
        assert groups.solve(given) == pytest.approx(np.linalg.solve(matrix, given), abs=1e-12)
        assert groups.solve_transposed(given) == pytest.approx(np.linalg.solve(matrix.T, given), abs=1e-12)
        assert groups.times(given) == pytest.approx(matrix @ given, abs=1e-12)
        assert groups.transposed_times(given) == pytest.approx(matrix.T @ given, abs=1e-12)
        assert np.array_equal(given, before)
