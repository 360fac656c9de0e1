"""The syntax of baseline expressions: text to a tree. Nothing is ever evaluated as code."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from rigctl.campaign.recording import TableFlaw
from rigctl.core.bounds import EXPRESSION_CHARACTERS
from rigctl.core.errors import one_line
from rigctl.core.numbers import decimal

FUNCTIONS = ("exp", "log", "sqrt", "sin", "cos", "tan")
CONSTANTS = ("pi",)
OPERATIONS_MAX, DEPTH_MAX, NESTED_MAX = 1000, 200, 50

_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>[^\W\d]\w*)"
    r"|(?P<sign>\*\*|[-+*/()])|(?P<space>\s+)|(?P<unknown>.)"
)
_BEFORE_OPERATOR = re.compile(r"[ )]*")
_Token = re.Match[str]


@dataclass(frozen=True)
class Number:
    """A number, never negative: a sign is an operation. `at` is the place in the text, from 0."""

    value: float
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Name:
    """A column, a parameter or pi."""

    name: str
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Operation:
    """One of `FUNCTIONS` of one operand, - of one, or + - * / ** of two."""

    name: str
    operands: tuple[Node, ...]
    at: int = field(default=0, compare=False)


Node = Number | Name | Operation


def parse(text: str) -> Node:
    """The tree of an expression: + - * / **, unary minus, parentheses, numbers, names and `FUNCTIONS`.

    Operators bind as in Python. `DataError` names the character where the text stops making sense, and the mend.
    """
    if len(text) > EXPRESSION_CHARACTERS:
        raise flaw(EXPRESSION_CHARACTERS, f"longer than {EXPRESSION_CHARACTERS} characters; write it shorter")
    tokens = {token.start(): token for token in _TOKEN.finditer(text) if token.lastgroup != "space"}
    # Before Python's parser, so that every refusal is ours and names the character.
    _require_order(list(tokens.values()), len(text))
    # Python is given _ for every character of a number or a name. Of the text itself it would take lambda for a
    # keyword, read µ as μ, refuse 010, and count places in bytes. In parentheses a text may begin with a space.
    masked = _TOKEN.sub(_masked, text)
    tree = ast.parse(f"({masked})", mode="eval").body
    _require_shallow(tree)
    return _node(tree, masked, tokens)


def names(node: Node) -> tuple[str, ...]:
    """The names in a tree but the constants, each once, in the order of the text."""
    return tuple(dict.fromkeys(each.name for each in leaves(node) if each.name not in CONSTANTS))


def with_numbers(node: Node, numbers: Mapping[str, float]) -> Node:
    """The tree with numbers in place of names."""
    match node:
        case Name(name, at) if name in numbers:
            size = Number(abs(numbers[name]), at)
            return size if numbers[name] >= 0.0 else Operation("-", (size,), at)
        case Operation(name, operands, at):
            return Operation(name, tuple(with_numbers(operand, numbers) for operand in operands), at)
    return node


def leaves(node: Node) -> Iterator[Name]:
    """Every name in a tree, in the order of the text."""
    if isinstance(node, Name):
        yield node
    elif isinstance(node, Operation):
        for operand in node.operands:
            yield from leaves(operand)


def flaw(at: int, what: str) -> TableFlaw:
    """An error at a character of the expression, counted from 1."""
    return TableFlaw(f"[table] baseline, character {at + 1}: {one_line(what)}", ("table", "baseline"))


def _require_order(tokens: list[_Token], end: int) -> None:
    """`DataError` at the first token that cannot follow what stands before it; at any that has no meaning."""
    for token in tokens:
        if token.lastgroup == "unknown":
            meant = "an expression has names, numbers, + - * / ** and parentheses"
            raise flaw(token.start(), f"{token[0]!r} has no meaning here; {meant}")
    if not tokens:
        raise flaw(0, "the expression is empty; write one such as b0 + b1 * load_lb")
    order = _Order()
    for token, following in zip(tokens, [*(each[0] for each in tokens[1:]), ""], strict=True):
        order.take(token, following)
    order.finish(end)


class _Order:
    """What has been read so far: whether it ends with an operand, and which parentheses are open."""

    def __init__(self) -> None:
        self._operand = False
        self._open: list[int] = []
        self._operations = 0

    def take(self, token: _Token, following: str) -> None:
        """One more token; `following` is the text of the next."""
        if token.lastgroup in {"number", "name"} or token[0] == "(":
            self._begin_operand(token)
            if token.lastgroup == "name":
                self._operand = not _is_function(token, following)
        elif token[0] == ")":
            self._close(token)
        else:
            self._operate(token)

    def finish(self, end: int) -> None:
        """The end of the text."""
        if not self._operand:
            raise flaw(end, "the expression ends where a number, a name or a parenthesis belongs; complete it")
        if self._open:
            raise flaw(self._open[-1], "this parenthesis is never closed; close it")

    def _begin_operand(self, token: _Token) -> None:
        if self._operand:
            raise flaw(token.start(), f"{token[0]!r} follows without an operator; write one of + - * / ** before it")
        self._operand = token[0] != "("
        if token[0] == "(":
            self._open.append(token.start())
            if len(self._open) > NESTED_MAX:
                raise flaw(token.start(), f"nested deeper than {NESTED_MAX} parentheses; write it flatter")

    def _close(self, token: _Token) -> None:
        self._require_operand(token)
        if not self._open:
            raise flaw(token.start(), "a closing parenthesis that none opened; remove it or open one")
        self._open.pop()

    def _operate(self, token: _Token) -> None:
        # These two may be signs and then follow nothing.
        if token[0] not in {"+", "-"}:
            self._require_operand(token)
        self._operand = False
        self._operations += 1
        if self._operations > OPERATIONS_MAX:
            raise flaw(token.start(), f"more than {OPERATIONS_MAX} operations; write it shorter")

    def _require_operand(self, token: _Token) -> None:
        if not self._operand:
            raise flaw(token.start(), f"{token[0]!r} stands where a number, a name or a parenthesis belongs; mend it")


def _is_function(name: _Token, following: str) -> bool:
    """Whether a name is called; `DataError` when it is a function that is not, or none that is."""
    known, called = name[0] in FUNCTIONS, following == "("
    if known and not called:
        raise flaw(name.start(), f"{name[0]} is a function; write {name[0]}(...)")
    if called and not known:
        listed = " ".join(FUNCTIONS)
        raise flaw(name.start(), f"unknown function {name[0]}; the functions are {listed}, and a product needs its *")
    return called


def _masked(token: _Token) -> str:
    if token.lastgroup == "sign":
        return token[0]
    return (" " if token.lastgroup == "space" else "_") * len(token[0])


def _require_shallow(tree: ast.expr) -> None:
    """Walks without recursion, so that what recurses later is safe."""
    level = [tree]
    for _ in range(DEPTH_MAX):
        level = [each for node in level for each in ast.iter_child_nodes(node) if isinstance(each, ast.expr)]
    if level:
        at = level[0].col_offset - 1
        raise flaw(at, f"more than {DEPTH_MAX} operations inside each other; write it shorter")


def _node(node: ast.expr, masked: str, tokens: dict[int, _Token]) -> Node:
    at = node.col_offset - 1
    match node:
        case ast.Name():
            return _leaf(tokens[at])
        case ast.UnaryOp(ast.UAdd(), operand):
            return _node(operand, masked, tokens)
        case ast.UnaryOp(ast.USub(), operand):
            return Operation("-", (_node(operand, masked, tokens),), at)
        case ast.BinOp(left, _, right):
            # The tree does not say where an operator stands: behind the left operand, blanks and closing parentheses.
            found = _BEFORE_OPERATOR.match(masked, (left.end_col_offset or 0) - 1)
            assert found is not None
            operands = (_node(left, masked, tokens), _node(right, masked, tokens))
            return Operation(tokens[found.end()][0], operands, found.end())
        case ast.Call(_, [argument]):
            return Operation(tokens[at][0], (_node(argument, masked, tokens),), at)
    raise flaw(at, "has no meaning here")


def _leaf(token: _Token) -> Node:
    if token.lastgroup == "name":
        return Name(token[0], token.start())
    try:
        return Number(decimal(token[0]), token.start())
    except ValueError as error:
        raise flaw(token.start(), f"{token[0]} is too large or too long; write {error}") from None
