"""Singular values of any finite matrix, also where the fast way gives up."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from rigctl.analysis.decomposition import basis_by_gram, svd


@given(arrays(float, array_shapes(min_dims=2, max_dims=2, max_side=8), elements=st.floats(-1e3, 1e3)))
def test_the_parts_make_the_whole(matrix: np.ndarray) -> None:
    left, s, right = svd(matrix)
    assert s.shape == (min(matrix.shape),)
    np.testing.assert_allclose((left * s) @ right, matrix, atol=1e-10 * max(1.0, s[0]))


@pytest.mark.parametrize("shape", [(7, 3), (3, 7), (4, 4)])
def test_where_the_fast_way_gives_up_another_is_gone(shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    matrix = np.random.default_rng(1).standard_normal(shape)
    expected = np.linalg.svd(matrix, compute_uv=False)

    def gives_up(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", gives_up)
    left, s, right = svd(matrix)
    np.testing.assert_allclose(s, expected, rtol=1e-12)
    np.testing.assert_allclose((left * s) @ right, matrix, atol=1e-12)


def test_what_is_not_finite_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        svd(np.array([[1.0, np.nan], [0.0, 1.0]]))


def unit_columns(rows: int, columns: int, alike: float) -> np.ndarray:
    """Columns of unit length of which the last two differ by so little."""
    made = np.random.default_rng(5).standard_normal((rows, columns))
    made[:, -1] = made[:, -2] + alike * made[:, -1]
    return np.asarray(made / np.linalg.norm(made, axis=0))


@pytest.mark.parametrize("alike", [1.0, 1e-3])
def test_a_basis_by_products_is_orthonormal_to_rounding_and_spans_the_columns(alike: float) -> None:
    unit = unit_columns(60_000, 10, alike)
    scale = np.linspace(0.5, 9.0, 10)
    basis = basis_by_gram(unit * scale, scale)
    assert basis is not None
    np.testing.assert_allclose(basis.T @ basis, np.eye(10), atol=1e-13)
    # What the less alike of two columns leaves is 1e-3: rounding divided by that.
    np.testing.assert_allclose(basis @ (basis.T @ unit), unit, atol=1e-15 / alike)


def test_columns_too_alike_for_products_are_left_to_singular_values() -> None:
    assert basis_by_gram(unit_columns(60_000, 10, 1e-5), np.ones(10)) is None
    assert basis_by_gram(unit_columns(600, 10, 1.0), np.ones(10)) is None
