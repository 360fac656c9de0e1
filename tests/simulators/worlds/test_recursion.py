"""Recursions against a loop that does what they say, and cut at any place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.worlds.recursion import SecondOrderSection, first_order

B = np.array([0.3, -0.2, 0.7])
EPS = np.finfo(float).eps


def poles(radius: float, angle: float) -> np.ndarray:
    """The denominator of a pair of poles."""
    return np.array([1.0, -2.0 * radius * np.cos(angle), radius**2])


def step_by_step(a: np.ndarray, entering: np.ndarray) -> np.ndarray:
    left = np.zeros_like(entering)
    for n in range(len(entering)):
        left[n] = sum(B[k] * entering[n - k] for k in range(min(n, 2) + 1))
        left[n] -= sum(a[k] * left[n - k] for k in range(1, min(n, 2) + 1))
    return left


@settings(deadline=None)
@given(
    st.integers(1, 200) | st.integers(1020, 1030),
    st.floats(0.0, 0.999),
    st.floats(0.0, np.pi),
    st.lists(st.integers(0, 1030), max_size=6),
    st.integers(0, 2**32 - 1),
)
def test_a_section_does_what_its_coefficients_say_however_it_is_cut(
    count: int, radius: float, angle: float, cuts: list[int], seed: int
) -> None:
    a, entering = poles(radius, angle), np.random.default_rng(seed).standard_normal((count, 3))
    section = SecondOrderSection(B, a, 3)
    parts = np.split(entering, sorted(min(cut, count) for cut in cuts))
    left = np.concatenate([section.filtered(part.T) for part in parts], axis=1).T
    assert np.array_equal(left, SecondOrderSection(B, a, 3).filtered(entering.T).T)
    # Rounding rings as what enters does: to no more than the step's sum of |h|, which is below (n + 1) r^n summed.
    grown = np.cumsum((np.arange(count) + 1) * radius ** np.arange(count))[-1]
    assert np.abs(left - step_by_step(a, entering)).max() <= 20.0 * EPS * grown**2 * np.abs(entering).max()


@pytest.mark.parametrize("kept", [0.9, np.exp(-0.01 + 0.3j), -1.0])
def test_a_first_order_recursion_goes_on_from_what_was_before(kept: complex) -> None:
    rng = np.random.default_rng(2)
    driven = rng.standard_normal(500) + 1j * rng.standard_normal(500)
    y, expected = 0.7 - 0.2j, []
    for each in driven:
        y = kept * y + each
        expected.append(y)
    np.testing.assert_allclose(first_order(kept, driven, 0.7 - 0.2j), expected, rtol=0.0, atol=1e-12)
    begun = first_order(kept, driven[:100], 0.7 - 0.2j)
    assert np.array_equal(
        np.concatenate([begun, first_order(kept, driven[100:], begun[-1])]), first_order(kept, driven, 0.7 - 0.2j)
    )
