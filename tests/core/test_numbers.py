"""The grammar of numbers in files: what is written plainly is read bit for bit, and nothing else is read."""

import math
import re

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st

from rigctl.cli.io import number
from rigctl.core.numbers import MAGNITUDE_MAX, NotMeasurable, decimal, decimal_or_missing

GRAMMAR = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


@given(st.floats(-MAGNITUDE_MAX, MAGNITUDE_MAX))
def test_what_is_written_is_read_bit_for_bit(value):
    assert math.copysign(1, decimal(repr(value))) == math.copysign(1, value)
    assert decimal(repr(value)) == value == decimal(f"{value:.17e}") == decimal(f"+{value!r}".replace("+-", "-"))


@given(
    st.text(st.sampled_from("0123456789+-.eE_ xinfatyN\t,'٣½\xa0"), max_size=9)
    | st.text(max_size=9)
    | st.from_regex(GRAMMAR, fullmatch=True)
)
def test_nothing_but_decimal_notation_is_a_number(text):
    try:
        value = decimal(text)
    except NotMeasurable:
        assert abs(float(text)) > MAGNITUDE_MAX
    except ValueError:
        assert not GRAMMAR.fullmatch(text) or len(text) > 400
    else:
        assert GRAMMAR.fullmatch(text)
        assert text.isascii()
        assert value == float(text)


@pytest.mark.parametrize("text", ["1_0", "0x10", "٣", " 1", "1\n", "1,5", "", "nan", "1e", "--1", "0" * 401])
def test_other_notations_are_no_numbers(text):
    with pytest.raises(ValueError, match="a number"):
        decimal(text)


@pytest.mark.parametrize("text", ["inf", "-Infinity", "1e400", "-1e308", "9" * 80])
def test_what_nobody_can_have_measured_is_told_apart(text):
    with pytest.raises(NotMeasurable):
        decimal(text)


@pytest.mark.parametrize("text", ["", "nan", "NaN", "-nan"])
def test_missing(text):
    assert math.isnan(decimal_or_missing(text))


@pytest.mark.parametrize("text", ["-", "nan(1)", "na", "n/a", "1_0", "+-nan"])
def test_not_missing(text):
    with pytest.raises(ValueError, match="a number"):
        decimal_or_missing(text)


@pytest.mark.parametrize("text", ["1_0", "٣", "inf", "1e400", ""])
def test_a_command_line_s_numbers_are_of_the_same_grammar(text):
    assert number("-5.5") == -5.5
    with pytest.raises(typer.BadParameter, match="write a number"):
        number(text)
