"""Numbers on the wire: what is plain decimal notation is taken, nothing else."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.numbers import CHARACTERS_MAX, decimal, whole

ODD = ["", " 1", "1 ", "1_0", "0x10", "1e", "e5", ".", "+", "--1", "1.2.3", "1,5", "inf", "-Infinity", "nan", "1e999",
       "1e-9999", "٣", "²", "1\n", "1\0", "9" * 1000, "True"]  # fmt: skip


@pytest.mark.parametrize("text", ODD)
@pytest.mark.parametrize("parse", [decimal, whole])
def test_what_is_no_decimal_notation_is_refused(text: str, parse: object) -> None:
    assert callable(parse)
    with pytest.raises(ValueError, match="is no"):
        parse(text)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_finite_number_comes_back(value: float) -> None:
    assert decimal(repr(value)) == value


@given(st.integers(-(2**53), 2**53))
def test_every_whole_number_comes_back(value: int) -> None:
    assert whole(f"{value:+d}") == whole(f"{value}.000") == value


@given(st.text(max_size=60) | st.from_regex(r"[+\-.0-9eE_ ]{1,50}"))
def test_only_finite_numbers_in_ascii_come_out(text: str) -> None:
    try:
        value = decimal(text)
    except ValueError:
        return
    assert math.isfinite(value)
    assert len(text) <= CHARACTERS_MAX
    assert re.fullmatch(r"[+\-.0-9eE]+", text)


@pytest.mark.parametrize("text", ["1.5", "1e300", "9007199254740993.5", "1e16"])
def test_a_fraction_or_what_no_double_holds_is_no_whole_number(text: str) -> None:
    with pytest.raises(ValueError, match="no whole number"):
        whole(text)
