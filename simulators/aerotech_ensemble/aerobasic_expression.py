"""Expressions of AeroBasic: numbers, variables, registers, arithmetic, comparison and logic."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from typing import Protocol

from simulators.aerotech_ensemble.grammar import Invalid

_NUMBER, _NAME, _SIGN = r"(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?", r"[A-Z_]\w*", r"<=|>=|<>|[-+*/()<>=,]"
TOKEN = re.compile(rf"\s*(?:{_NUMBER}|{_NAME}|{_SIGN})", re.ASCII | re.IGNORECASE)

Expression = Callable[["Variables"], float]


class Variables(Protocol):
    """Where an expression's names get their values."""

    def value(self, name: str) -> float:
        """A variable or a constant; `Invalid` when there is none of this name."""
        ...

    def register(self, kind: str, index: float) -> float:
        """IGLOBAL or DGLOBAL."""
        ...


def tokens_of(text: str) -> list[str]:
    """The words, numbers and signs of a line, in upper case."""
    found, place, text = [], 0, text.rstrip()
    while place < len(text):
        match = TOKEN.match(text, place)
        if match is None:
            raise Invalid
        found.append(match.group().strip().upper())
        place = match.end()
    return found


def expression(tokens: Sequence[str]) -> Expression:
    """What all these tokens mean together."""
    parser = _Parser(tokens)
    parsed = parser.parse(0)
    if parser.left:
        raise Invalid
    return parsed


BINARY: tuple[dict[str, Callable[[float, float], float]], ...] = (
    {"OR": lambda a, b: float(bool(a) or bool(b))},
    {"AND": lambda a, b: float(bool(a) and bool(b))},
    {
        "=": lambda a, b: float(a == b),
        "<>": lambda a, b: float(a != b),
        "<": lambda a, b: float(a < b),
        ">": lambda a, b: float(a > b),
        "<=": lambda a, b: float(a <= b),
        ">=": lambda a, b: float(a >= b),
    },
    {"+": operator.add, "-": operator.sub},
    {"*": operator.mul, "/": operator.truediv},
)
"""From what binds least to what binds most."""
UNARY: dict[str, tuple[Callable[[float], float], int]] = {
    "-": (operator.neg, len(BINARY)),
    "NOT": (lambda a: float(not a), 2),
}
"""With the level of what follows: NOT takes a whole comparison."""
OPEN, CLOSED = "()"
REGISTERS = ("IGLOBAL", "DGLOBAL")


class _Parser:
    def __init__(self, tokens: Sequence[str]) -> None:
        self._tokens = list(tokens)

    @property
    def left(self) -> bool:
        return bool(self._tokens)

    def parse(self, level: int) -> Expression:
        if level == len(BINARY):
            return self._factor()
        result = self.parse(level + 1)
        while self._tokens and self._tokens[0] in BINARY[level]:
            act, one, other = BINARY[level][self._next()], result, self.parse(level + 1)
            result = _both(act, one, other)
        return result

    def _factor(self) -> Expression:
        token = self._next()
        if token == OPEN:
            return self._until_closed()
        if token in UNARY:
            act, level = UNARY[token]
            operand = self.parse(level)
            return lambda v: act(operand(v))
        if token in REGISTERS:
            if self._next() != OPEN:
                raise Invalid
            index = self._until_closed()
            return lambda v: v.register(token, index(v))
        if token[0].isdigit() or token[0] == ".":
            number = float(token)
            return lambda _: number
        return lambda v: v.value(token)

    def _until_closed(self) -> Expression:
        inner = self.parse(0)
        if self._next() != CLOSED:
            raise Invalid
        return inner

    def _next(self) -> str:
        if not self._tokens:
            raise Invalid
        return self._tokens.pop(0)


def _both(act: Callable[[float, float], float], one: Expression, other: Expression) -> Expression:
    return lambda v: act(one(v), other(v))
