"""Lengths of which transforms are fast, beside those that scipy chooses."""

from hypothesis import given
from hypothesis import strategies as st
from scipy.fft import next_fast_len

from rigctl.analysis.periodograms import fast_length


@given(st.integers(1, 10**9))
def test_the_next_length_of_small_factors_is_scipys(least: int) -> None:
    assert fast_length(least) == next_fast_len(least, real=True)
    assert fast_length(fast_length(least)) == fast_length(least)
