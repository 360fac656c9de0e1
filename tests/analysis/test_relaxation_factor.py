"""Noise that relaxes along an order is factorised block by block as its whole matrix would be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.analysis import relaxation_factor
from rigctl.analysis.correlated_groups import MANY, CorrelatedGroups, Factor, log_determinant, variances
from rigctl.analysis.relaxation_factor import BLOCK, RelaxationFactor
from rigctl.core.arrays import FloatArray

Relaxations = list[tuple[float, float]]


def correlation(at: FloatArray, relaxations: Relaxations) -> FloatArray:
    apart = np.abs(at[:, None] - at[None, :])
    return np.eye(len(at)) + np.sum([each * np.exp(-apart / slow) for each, slow in relaxations], axis=0)


def assert_same(factor: RelaxationFactor, matrix: FloatArray) -> None:
    triangle = np.linalg.cholesky(matrix)
    columns = np.random.default_rng(0).standard_normal((len(matrix), 3))
    close = pytest.approx
    for each in (columns, columns[:, 0]):
        assert factor.times(each) == close(triangle @ each, rel=1e-9, abs=1e-9)
        assert factor.transposed_times(each) == close(triangle.T @ each, rel=1e-9, abs=1e-9)
        assert factor.solve(each) == close(np.linalg.solve(triangle, each), rel=1e-9, abs=1e-9)
        assert factor.solve_transposed(each) == close(np.linalg.solve(triangle.T, each), rel=1e-9, abs=1e-9)
    assert log_determinant(factor) == close(0.5 * float(np.linalg.slogdet(matrix)[1]), rel=1e-9, abs=1e-9)
    assert variances(factor) == close(np.diag(matrix), rel=1e-12)


@settings(max_examples=60)
@given(
    places=st.lists(st.integers(0, 60), min_size=1, max_size=40),
    relaxations=st.lists(st.tuples(st.floats(1e-3, 1e3), st.floats(1e-2, 1e4)), min_size=1, max_size=4),
    block=st.integers(1, 12),
)
def test_it_is_the_cholesky_factor_of_the_whole_matrix(
    places: list[int], relaxations: Relaxations, block: int
) -> None:
    """At any places, the same among them, and wherever blocks end."""
    at = np.sort(np.array(places, dtype=np.float64))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(relaxation_factor, "BLOCK", block)
        assert_same(RelaxationFactor(at, relaxations), correlation(at, relaxations))


def test_blocks_as_they_are_used_are_carried_over() -> None:
    at = np.cumsum(np.random.default_rng(1).uniform(0.1, 2.0, 3 * BLOCK + 5))
    relaxations = [(0.3, 1.5), (2.0, 40.0), (10.0, 900.0)]
    assert_same(RelaxationFactor(at, relaxations), correlation(at, relaxations))


@pytest.mark.parametrize("count", [2, MANY + 1])
def test_groups_of_either_kind_act_side_by_side(count: int) -> None:
    places = np.array_split(np.random.default_rng(2).permutation(6 * count), count)
    at, relaxations = np.arange(6 * count, dtype=np.float64), [(2.0, 3.0)]
    factors: list[Factor] = []
    matrix = np.eye(6 * count)
    for number, where in enumerate(map(np.sort, places)):
        own = correlation(at[where], relaxations)
        factors.append((where, RelaxationFactor(at[where], relaxations) if number % 2 else np.linalg.cholesky(own)))
        matrix[np.ix_(where, where)] = own
    columns = np.random.default_rng(3).standard_normal((6 * count, 4))
    groups = CorrelatedGroups(factors, 6 * count)
    white = groups.solve(columns)
    assert white.T @ white == pytest.approx(columns.T @ np.linalg.solve(matrix, columns), abs=1e-12)
    assert groups.times(white) == pytest.approx(columns, abs=1e-12)
    assert groups.solve_transposed(groups.transposed_times(columns)) == pytest.approx(columns, abs=1e-12)
