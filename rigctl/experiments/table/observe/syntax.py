"""The syntax of baseline expressions: text to a tree and back. Nothing is ever evaluated as code."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from rigctl.core.bounds import EXPRESSION_CHARACTERS
from rigctl.core.errors import DataError
from rigctl.core.messages import one_line

FUNCTIONS = ("exp", "log", "sqrt", "sin", "cos", "tan")
CONSTANTS = ("pi",)
MAX_DEPTH, MAX_NESTED = 200, 50

_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>[^\W\d]\w*)|(?P<sign>\*\*|[-+*/()])"
)


@dataclass(frozen=True)
class Number:
    """A number, never negative: a sign is an operation."""

    value: float
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Name:
    """A column, a parameter or pi."""

    name: str
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Negative:
    """- operand"""

    operand: Node
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Binary:
    """left sign right, where sign is one of + - * / **"""

    sign: str
    left: Node
    right: Node
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Call:
    """function(argument)"""

    function: str
    argument: Node
    at: int = field(default=0, compare=False)


Node = Number | Name | Negative | Binary | Call


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    at: int


def parse(text: str) -> Node:
    """The tree of an expression: + - * / **, unary minus, parentheses, numbers, names and `FUNCTIONS`.

    Operators bind as in Python. `DataError` names the character where the text stops making sense, and the mend.
    """
    return _Parser(text).whole()


def write(node: Node) -> str:
    """The text of a tree, with no parenthesis it can do without; `parse` makes the same tree of it."""
    return _written(node)[0]


def names(node: Node) -> tuple[str, ...]:
    """The names in a tree but the constants, each once, in the order of the text."""
    return tuple(dict.fromkeys(each.name for each in leaves(node) if each.name not in CONSTANTS))


def leaves(node: Node) -> Iterator[Name]:
    """Every name in a tree, in the order of the text."""
    match node:
        case Name():
            yield node
        case Negative(operand):
            yield from leaves(operand)
        case Binary(_, left, right):
            yield from leaves(left)
            yield from leaves(right)
        case Call(_, argument):
            yield from leaves(argument)


def flaw(at: int, what: str) -> DataError:
    """An error at a character of the expression, counted from 1."""
    return DataError(f"recording.toml, [table] baseline, character {at + 1}: {one_line(what)}")


class _Parser:
    def __init__(self, text: str) -> None:
        if len(text) > EXPRESSION_CHARACTERS:
            raise flaw(EXPRESSION_CHARACTERS, f"longer than {EXPRESSION_CHARACTERS} characters; write it shorter")
        self._tokens = list(_tokens(text))
        self._next = 0
        self._nested = 0

    def whole(self) -> Node:
        if self._sees("end"):
            raise flaw(0, "the expression is empty; write one such as b0 + b1 * load_lb")
        node = self._sum()
        token = self._token
        if token.text == ")":
            raise flaw(token.at, "a closing parenthesis that none opened; remove it or open one")
        if token.kind != "end":
            raise flaw(token.at, f"{token.text!r} follows without an operator; write one of + - * / ** before it")
        _require_shallow(node)
        return node

    @property
    def _token(self) -> _Token:
        return self._tokens[self._next]

    def _sees(self, *kinds_or_texts: str) -> bool:
        return self._token.kind in kinds_or_texts or self._token.text in kinds_or_texts

    def _take(self) -> _Token:
        token = self._token
        self._next += 1
        return token

    def _sum(self) -> Node:
        node = self._product()
        while self._sees("+", "-"):
            sign = self._take()
            node = Binary(sign.text, node, self._product(), sign.at)
        return node

    def _product(self) -> Node:
        node = self._signed()
        while self._sees("*", "/"):
            sign = self._take()
            node = Binary(sign.text, node, self._signed(), sign.at)
        return node

    def _signed(self) -> Node:
        signs: list[_Token] = []
        while self._sees("-", "+"):
            signs.append(self._take())
        node = self._power()
        for sign in reversed(signs):
            node = Negative(node, sign.at) if sign.text == "-" else node
        return node

    def _power(self) -> Node:
        base = self._atom()
        if not self._sees("**"):
            return base
        sign = self._take()
        self._deeper(sign)
        node = Binary("**", base, self._signed(), sign.at)
        self._nested -= 1
        return node

    def _atom(self) -> Node:
        token = self._take()
        if token.kind == "number":
            value = float(token.text)
            if value == math.inf:
                raise flaw(token.at, f"{token.text} is too large for a number; write a smaller one")
            return Number(value, token.at)
        if token.kind == "name":
            return self._named(token)
        if token.text == "(":
            return self._parenthesis(token)
        if token.kind == "end":
            raise flaw(token.at, "the expression ends where a number, a name or a parenthesis belongs; complete it")
        raise flaw(token.at, f"{token.text!r} stands where a number, a name or a parenthesis belongs; mend it")

    def _named(self, token: _Token) -> Node:
        if not self._sees("("):
            if token.text in FUNCTIONS:
                raise flaw(token.at, f"{token.text} is a function; write {token.text}(...)")
            return Name(token.text, token.at)
        if token.text not in FUNCTIONS:
            raise flaw(
                token.at,
                f"unknown function {token.text}; the functions are {' '.join(FUNCTIONS)}, and a product needs its *",
            )
        return Call(token.text, self._parenthesis(self._take()), token.at)

    def _parenthesis(self, opening: _Token) -> Node:
        self._deeper(opening)
        node = self._sum()
        if not self._sees(")"):
            if self._sees("end"):
                raise flaw(opening.at, "this parenthesis is never closed; close it")
            raise flaw(self._token.at, f"{self._token.text!r} follows without an operator; write one before it")
        self._take()
        self._nested -= 1
        return node

    def _deeper(self, token: _Token) -> None:
        self._nested += 1
        if self._nested > MAX_NESTED:
            raise flaw(token.at, f"nested deeper than {MAX_NESTED}; write it flatter")


def _tokens(text: str) -> Iterator[_Token]:
    at = 0
    while at < len(text):
        if text[at].isspace():
            at += 1
            continue
        found = _TOKEN.match(text, at)
        if found is None:
            raise flaw(
                at, f"{text[at]!r} has no meaning here; an expression has names, numbers, + - * / ** and parentheses"
            )
        assert found.lastgroup is not None
        yield _Token(found.lastgroup, found[0], at)
        at = found.end()
    yield _Token("end", "", len(text))


def _require_shallow(node: Node) -> None:
    """Walks without recursion, so that what recurses later is safe."""
    pending = [(node, 1)]
    while pending:
        each, depth = pending.pop()
        if depth > MAX_DEPTH:
            raise flaw(each.at, f"more than {MAX_DEPTH} operations hang on each other; write it shorter")
        match each:
            case Negative(operand):
                pending.append((operand, depth + 1))
            case Binary(_, left, right):
                pending += [(left, depth + 1), (right, depth + 1)]
            case Call(_, argument):
                pending.append((argument, depth + 1))


_SUM, _PRODUCT, _SIGNED, _POWER, _ATOM = range(5)
_LEVEL = {"+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "**": _POWER}


def _written(node: Node) -> tuple[str, int]:
    """Text, and how tightly its outermost operation binds."""
    match node:
        case Number(value):
            return repr(float(value)), _ATOM
        case Name(name):
            return name, _ATOM
        case Call(function, argument):
            return f"{function}({write(argument)})", _ATOM
        case Negative(operand):
            return f"-{_enclosed(operand, _SIGNED)}", _SIGNED
        case Binary("**", left, right):
            return f"{_enclosed(left, _ATOM)} ** {_enclosed(right, _SIGNED)}", _POWER
        case Binary(sign, left, right):
            level = _LEVEL[sign]
            return f"{_enclosed(left, level)} {sign} {_enclosed(right, level + 1)}", level


def _enclosed(node: Node, level: int) -> str:
    text, own = _written(node)
    return text if own >= level else f"({text})"
