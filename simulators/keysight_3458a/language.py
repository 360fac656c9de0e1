"""The language's lines: a command and its parameters, several of them between semicolons; and its errors."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

_COMMAND = re.compile(r"([A-Z]+)(\?)?(?:[\s,]+(.*))?", re.ASCII | re.DOTALL)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?", re.ASCII)


class Error(IntEnum):
    """Bits of the error register, by their number."""

    TRIGGER_TOO_FAST = 2
    SYNTAX = 3
    PARAMETER_UNDEFINED = 5
    PARAMETER_RANGE = 6
    MEMORY = 7


class Refused(Exception):
    """Not done, for this reason."""

    def __init__(self, error: Error) -> None:
        super().__init__(error.name)
        self.error = error


@dataclass(frozen=True)
class Command:
    """One command, upper case."""

    keyword: str
    query: bool
    words: tuple[str, ...]


def parse(line: str) -> list[Command | Refused]:
    """The commands of a line; `Refused` in the place of what is none."""
    parts = (part.strip().upper() for part in line.split(";"))
    return [_command(part) for part in parts if part]


def _command(text: str) -> Command | Refused:
    match = _COMMAND.fullmatch(text)
    if match is None:
        return Refused(Error.SYNTAX)
    keyword, query, rest = match.groups()
    return Command(keyword, bool(query), tuple(re.split(r"[\s,]+", rest.strip())) if rest else ())


def number(word: str, low: float, high: float) -> float:
    """A number in [low, high]."""
    if _NUMBER.fullmatch(word) is None:
        raise Refused(Error.PARAMETER_UNDEFINED)
    value = float(word)
    if not (math.isfinite(value) and low <= value <= high):
        raise Refused(Error.PARAMETER_RANGE)
    return value


def whole(word: str, low: int, high: int) -> int:
    """A whole number in [low, high]."""
    value = number(word, low, high)
    if not value.is_integer():
        raise Refused(Error.PARAMETER_RANGE)
    return int(value)


def choice(word: str, *names: str) -> str:
    """One of these words."""
    if word not in names:
        raise Refused(Error.PARAMETER_UNDEFINED)
    return word


def coded(word: str, codes: Mapping[str, int]) -> str:
    """One of these words, or the word of a number, by which a query answers."""
    for name, code in codes.items():
        if word in (name, str(code)):
            return name
    raise Refused(Error.PARAMETER_UNDEFINED)


def real(value: float) -> str:
    """Nine digits, and an exponent that is a multiple of three, as queries answer: `200.000000E-03`."""
    exponent = 3 * math.floor(math.log10(abs(value)) / 3) if value else 0
    mantissa = f"{value / 10.0**exponent:.9f}"
    # The point is no digit.
    return f"{mantissa[: 10 + mantissa.startswith('-')]}E{exponent:+03d}"
