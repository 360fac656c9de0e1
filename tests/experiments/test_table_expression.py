"""Baseline expressions: what is written is what is meant, derivatives are exact, and nothing is run as code."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.core.errors import DataError
from rigctl.experiments.table.observe.expression import Expression, refuse_undefined
from rigctl.experiments.table.observe.syntax import FUNCTIONS, Name, Node, Number, Operation, parse

NUMBERS = st.floats(0.0, 1e40, allow_nan=False, allow_infinity=False).map(Number)
LEAVES = NUMBERS | st.sampled_from(["load_lb", "b0", "pi", "é_1", "exponent", "lambda", "µ", "in"]).map(Name)


def _branches(inner: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    return (
        inner.map(lambda operand: Operation("-", (operand,)))
        | st.builds(Operation, st.sampled_from(["+", "-", "*", "/", "**"]), st.tuples(inner, inner))
        | st.builds(Operation, st.sampled_from(FUNCTIONS), st.tuples(inner))
    )


TREES: st.SearchStrategy[Node] = st.recursive(LEAVES, _branches, max_leaves=20)


def _written(node: Node) -> str:
    match node:
        case Number(value):
            return repr(value)
        case Name(name):
            return name
        case Operation(name, (operand,)):
            return f"{name}({_written(operand)})"
        case Operation(name, (left, right)):
            return f"({_written(left)}) {name} ({_written(right)})"
    raise AssertionError(node)


@given(TREES)
def test_a_tree_survives_being_written_and_parsed(tree: Node) -> None:
    assert parse(_written(tree)) == tree


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-2**2", -4.0),
        ("2**3**2", 512.0),
        ("2**-1", 0.5),
        ("8/4/2", 1.0),
        ("1 - 2 - 3", -4.0),
        ("2 + 3*4", 14.0),
        ("(2 + 3)*4", 20.0),
        ("1e-6 * 1E+6", 1.0),
        (".5 + 1.", 1.5),
        ("--3", 3.0),
        ("+3", 3.0),
        (" 010", 10.0),
        ("cos(pi)", -1.0),
        ("exp(log(7))", 7.0),
        ("sqrt(16) + sin(0) + tan(0)", 4.0),
    ],
)
def test_operators_bind_as_in_python(text: str, value: float) -> None:
    found, _ = Expression.read(text, []).evaluate({}, {})
    assert found == pytest.approx([value], rel=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "character 1: the expression is empty"),
        ("b0 + sine(x)", "character 6: unknown function sine; the functions are exp log sqrt sin cos tan"),
        ("(b0 + x", "character 1: this parenthesis is never closed"),
        ("b0 + x)", "character 7: a closing parenthesis that none opened"),
        ("b0 b1", "character 4: 'b1' follows without an operator"),
        ("(b0 2)", "character 5: '2' follows without an operator"),
        ("b0 +", "character 5: the expression ends where a number"),
        ("b0 * / x", "character 6: '/' stands where a number"),
        ("b0 ^ 2", "character 4: '^' has no meaning here"),
        ("exp + 1", "character 1: exp is a function; write exp(...)"),
        ("b0 * 1e999", "character 6: 1e999 is too large"),
        ("__import__('os').system('id')", 'character 12: "\'" has no meaning here'),
        ("b0.__class__", "character 3: '.' has no meaning here"),
        ("x[0]", "character 2: '[' has no meaning here"),
        ("2 + 1_0", "character 6: '_0' follows without an operator"),
        ("0x10", "character 2: 'x10' follows without an operator"),
        ("2 * 1j", "character 6: 'j' follows without an operator"),
        ("b0 // x", "character 5: '/' stands where a number"),
        ("b0 * ()", "character 7: ')' stands where a number"),
        ("exp(*x)", "character 5: '*' stands where a number"),
        ("exp(x, x)", "character 6: ',' has no meaning here"),
        ("(exp)(x)", "character 2: exp is a function; write exp(...)"),
        ("b0 < x", "character 4: '<' has no meaning here"),
        ("(b0 := x)", "character 5: ':' has no meaning here"),
        ("lambda: 1", "character 7: ':' has no meaning here"),
        ("b0 if x else 1", "character 4: 'if' follows without an operator"),
        ("(" * 60 + "x" + ")" * 60, "character 51: nested deeper than 50"),
        ("x" + " + x" * 400, "more than 200 operations"),
        ("-" * 5000 + "x", "character 1001: more than 1000 operations"),
        ("x**" * 3000 + "x", "character 3002: more than 1000 operations"),
        ("1" * 20_000, "character 10001: longer than 10000 characters"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_its_place(text: str, message: str) -> None:
    with pytest.raises(DataError) as caught:
        Expression.read(text, ["x"])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.text(max_size=40))
def test_any_text_is_parsed_or_refused_in_one_line(text: str) -> None:
    try:
        tree = parse(text)
    except DataError as error:
        said = str(error)
    else:
        said = _written(tree)
        assert parse(said) == tree
    assert len(said.splitlines()) == 1


def test_names_that_are_no_columns_are_parameters_in_the_order_of_the_text() -> None:
    expression = Expression.read("k * pi * exp(-x / tau) + k * y + offset", ["x", "y"])
    assert expression.columns == ("x", "y")
    assert expression.parameters == ("k", "tau", "offset")


SMOOTH = "a*exp(-b*x) + c*x**b / (1 + a*x**2) + sin(c*x)*cos(b) - sqrt(a + x)*log(b + x) + tan(a*x/9) + 2**(b*x)"


@settings(max_examples=30)
@given(st.lists(st.floats(0.2, 1.2), min_size=3, max_size=3))
def test_derivatives_are_those_of_the_values(values: list[float]) -> None:
    x = np.linspace(0.1, 2.0, 7)
    expression = Expression.read(SMOOTH, ["x"])
    at = dict(zip("abc", values, strict=True))
    _, slopes = expression.evaluate({"x": x}, at)
    for column, name in enumerate(expression.parameters):
        step = 1e-6
        up, _ = expression.evaluate({"x": x}, {**at, name: at[name] + step})
        down, _ = expression.evaluate({"x": x}, {**at, name: at[name] - step})
        assert slopes[:, column] == pytest.approx((up - down) / (2 * step), rel=1e-6, abs=1e-7)


def test_power_of_zero_has_a_derivative() -> None:
    _, slopes = Expression.read("b * x**n", ["x"]).evaluate({"x": np.array([0.0, 2.0])}, {"b": 1.0, "n": 2.0})
    assert slopes == pytest.approx(np.array([[0.0, 0.0], [4.0, 4.0 * math.log(2.0)]]))


@pytest.mark.parametrize(
    ("text", "linear"),
    [
        ("b0 + b1*x", ("b0", "b1")),
        ("b1*(1 - exp(-b2*x))", ("b1",)),
        ("b0*b1*x", ("b0",)),
        ("(b0 + b1*x)/(1 + b2*x)", ("b0", "b1")),
        ("b0**2 + b1", ("b1",)),
        ("b0**1 - -b1/3", ("b0", "b1")),
        ("log(b0) + x", ()),
    ],
)
def test_linear_parameters_are_recognised(text: str, linear: tuple[str, ...]) -> None:
    assert Expression.read(text, ["x"]).linear_in() == linear


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("b0 + log(x)", "character 6: log of a negative number in row 1 (with b0 = 2)"),
        ("b0 + sqrt(x)", "character 6: sqrt of a negative number in row 1"),
        ("b0 / (x - 3)", "character 4: division by zero in row 3"),
        ("b0 * x**0.5", "character 7: power of a negative number in row 1"),
        ("b0 * (x + 2)**-1", "character 13: negative power of zero in row 1"),
        ("exp(b0 * 1000 * x**2)", "character 1: the result is too large in row 1, row 2, row 3"),
    ],
)
def test_where_a_value_is_undefined_is_said(text: str, message: str) -> None:
    expression = Expression.read(text, ["x"])
    with pytest.raises(DataError) as caught:
        refuse_undefined(expression, {"x": np.array([-2.0, 1.0, 3.0])}, {"b0": 2.0}, ["row 1", "row 2", "row 3"])
    assert message in str(caught.value)
