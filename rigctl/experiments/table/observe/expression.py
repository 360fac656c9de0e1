"""A baseline expression over columns: its values, and their derivatives by its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.experiments.table.observe.syntax import (
    Name,
    Node,
    Number,
    Operation,
    flaw,
    leaves,
    names,
    parse,
    with_numbers,
)

_Columns = Mapping[str, FloatArray]
_Values = Mapping[str, "float | FloatArray"]
"""Of parameters: one for all rows, or one for each."""

_Dual = tuple[FloatArray, dict[str, FloatArray]]
"""Values over the rows, and their derivatives by each parameter they depend on."""


@dataclass(frozen=True)
class Undefined:
    """An operation without a finite result: at which character, why, and in which rows (indices)."""

    at: int
    reason: str
    rows: IntArray


@dataclass(frozen=True)
class Expression:
    """An expression over columns; a name that is no column is a parameter. Constants are numbers in it."""

    tree: Node
    columns: tuple[str, ...]
    parameters: tuple[str, ...]

    @classmethod
    def read(cls, text: str, columns: Collection[str], constants: Mapping[str, float] | None = None) -> Expression:
        """Parse `text` over these columns, with `constants`; `DataError` with the character and the mend."""
        tree = with_numbers(parse(text), constants or {})
        used = names(tree)
        return cls(
            tree,
            tuple(name for name in used if name in columns),
            tuple(name for name in used if name not in columns),
        )

    def position(self, name: str) -> int:
        """The character, from 0, where a name stands first."""
        return next(leaf.at for leaf in leaves(self.tree) if leaf.name == name)

    def evaluate(self, columns: _Columns, values: _Values) -> tuple[FloatArray, FloatArray]:
        """Values, shape (n,), and derivatives by `parameters`, (n, m); NaN or infinite where undefined."""
        rows = _rows(self.columns, columns)
        with np.errstate(all="ignore"):
            # Derivatives go along with the values (forward mode): they are exact and need no steps.
            value, slopes = _dual(self.tree, columns, values, rows)
        none = np.zeros(rows)
        derivative = [np.broadcast_to(slopes.get(name, none), rows) for name in self.parameters]
        matrix = np.stack(derivative, axis=1) if derivative else np.zeros((rows, 0))
        return np.broadcast_to(value, rows).copy(), matrix

    def linear_in(self) -> tuple[str, ...]:
        """Parameters in which it is linear together, the others fixed; collected in the order of the text."""
        linear: list[str] = []
        for name in self.parameters:
            if _degree(self.tree, {*linear, name}) <= 1:
                linear.append(name)
        return tuple(linear)

    def undefined(self, columns: _Columns, values: _Values) -> Undefined | None:
        """The innermost operation without a finite result in some row; None if there is none."""
        rows = _rows(self.columns, columns)
        with np.errstate(all="ignore"):
            return _undefined(self.tree, columns, values, rows)


def refuse_undefined(expression: Expression, columns: _Columns, values: _Values, labels: Sequence[str]) -> None:
    """`DataError` when the expression has no finite value in some row; `labels` name the rows."""
    undefined = expression.undefined(columns, values)
    if undefined is None:
        return
    rows = undefined.rows
    shown = ", ".join(labels[int(i)] for i in rows[:3]) + (f" and {len(rows) - 3} more" if len(rows) > 3 else "")
    at_values = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
    where = f"{shown} (with {at_values})" if at_values else shown
    mend = "mend the readings, the expression or its start values"
    raise flaw(undefined.at, f"{undefined.reason} in {where}; {mend}")


_VALUE: dict[str, Callable[[FloatArray], FloatArray]] = {
    "-": np.negative,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
}
_SLOPE: dict[str, Callable[[FloatArray, FloatArray], FloatArray | float]] = {
    "-": lambda *_: -1.0,
    "exp": lambda _, value: value,
    "log": lambda x, _: 1.0 / x,
    "sqrt": lambda _, value: 0.5 / value,
    "sin": lambda x, _: np.cos(x),
    "cos": lambda x, _: -np.sin(x),
    "tan": lambda _, value: 1.0 + value**2,
}


def _rows(used: tuple[str, ...], columns: Mapping[str, FloatArray]) -> int:
    first = next(iter(columns.values()), np.zeros(1))
    return int(columns[used[0]].size if used else first.size)


def _dual(node: Node, columns: _Columns, values: _Values, rows: int) -> _Dual:
    match node:
        case Number(number):
            return np.full(rows, number), {}
        case Name(name):
            return _leaf(name, columns, values, rows)
        case Operation(name, operands):
            duals = [_dual(operand, columns, values, rows) for operand in operands]
            return _called(name, *duals) if len(duals) == 1 else _combined(name, *duals)


def _leaf(name: str, columns: _Columns, values: _Values, rows: int) -> _Dual:
    if name in columns:
        return columns[name], {}
    if name in values:
        return np.full(rows, values[name]), {name: np.ones(rows)}
    # The one constant: anything else is a column or a parameter.
    return np.full(rows, math.pi), {}


def _called(function: str, argument: _Dual) -> _Dual:
    x, slopes = argument
    value = _VALUE[function](x)
    factor = _SLOPE[function](x, value)
    return value, {name: factor * slope for name, slope in slopes.items()}


def _combined(sign: str, left: _Dual, right: _Dual) -> _Dual:
    (a, da), (b, db) = left, right
    match sign:
        case "+":
            return a + b, _mixed(da, 1.0, db, 1.0)
        case "-":
            return a - b, _mixed(da, 1.0, db, -1.0)
        case "*":
            return a * b, _mixed(da, b, db, a)
        case "/":
            return a / b, _mixed(da, 1.0 / b, db, -a / b**2)
        case _:
            value = np.power(a, b)
            # Limits at zero, where numpy has 0 * infinity.
            by_base = np.where(b == 0.0, 0.0, b * np.power(a, b - 1.0))
            by_exponent = np.where((a == 0.0) & (b > 0.0), 0.0, value * np.log(a))
            return value, _mixed(da, by_base, db, by_exponent)


def _mixed(
    da: dict[str, FloatArray], by_a: FloatArray | float, db: dict[str, FloatArray], by_b: FloatArray | float
) -> dict[str, FloatArray]:
    slopes = {name: by_a * slope for name, slope in da.items()}
    for name, slope in db.items():
        slopes[name] = slopes[name] + by_b * slope if name in slopes else by_b * slope
    return slopes


_NONLINEAR = 2


def _degree(node: Node, variables: Collection[str]) -> int:
    """Degree of a tree in `variables` taken together: 0, 1, or 2 for anything that is not linear."""
    match node:
        case Number():
            return 0
        case Name(name):
            return int(name in variables)
        case Operation(sign, operands):
            return _degree_after(sign, operands, [_degree(operand, variables) for operand in operands])


def _degree_after(sign: str, operands: Sequence[Node], degrees: list[int]) -> int:
    match sign, degrees:
        case (("+" | "-"), _):
            return max(degrees)
        case "*", [a, b]:
            return min(a + b, _NONLINEAR)
        case "/", [a, 0]:
            return a
        case "**", [a, 0] if operands[1] == Number(1.0):
            return a
        case _:
            return _NONLINEAR if any(degrees) else 0


def _undefined(node: Node, columns: _Columns, values: _Values, rows: int) -> Undefined | None:
    parts = node.operands if isinstance(node, Operation) else ()
    for part in parts:
        if inner := _undefined(part, columns, values, rows):
            return inner
    value, slopes = _dual(node, columns, values, rows)
    not_finite = np.flatnonzero(~np.isfinite(value))
    if not_finite.size:
        operands = [float(_dual(part, columns, values, rows)[0][not_finite[0]]) for part in parts]
        return Undefined(node.at, _reason(node, operands), not_finite)
    # The value may be finite where its derivative is not: sqrt(p x) at x = 0.
    steep = ~np.isfinite(sum(slopes.values(), np.zeros(rows)))
    if steep.any():
        return Undefined(node.at, "the derivative by a parameter is infinite", np.flatnonzero(steep))
    return None


def _reason(node: Node, operands: list[float]) -> str:
    match node:
        case Operation(("log" | "sqrt") as function) if operands[0] <= 0.0:
            return f"{function} of {'zero' if operands[0] == 0.0 else 'a negative number'}"
        case Operation("/") if operands[1] == 0.0:
            return "division by zero"
        case Operation("**") if operands[0] < 0.0:
            return "power of a negative number"
        case Operation("**") if operands[0] == 0.0:
            return "negative power of zero"
        case Name():
            return "a value is missing"
        case _:
            return "the result is too large"
