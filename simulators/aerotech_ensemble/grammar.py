"""The line grammar: `KEYWORD word, word`, `KEYWORD(word, word)` and `KEYWORD(word) = value`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import lru_cache

LINE_LENGTH_MAX = 256

_KEYWORD = re.compile(r"\s*([A-Z]+)\s*(.*?)\s*", re.ASCII | re.IGNORECASE | re.DOTALL)
_CALL = re.compile(r"\(\s*([^()=]*?)\s*\)\s*(?:=\s*(\S+))?", re.ASCII)
_WORD = r'"[^"]*"|[@\w.+-]+'
_WORDS = re.compile(rf"(?:{_WORD})(?:(?:\s*,\s*|\s+)(?:{_WORD}))*", re.ASCII)
_ONE_WORD = re.compile(_WORD, re.ASCII)
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?"
_A_NUMBER = re.compile(_NUMBER, re.ASCII)


class Invalid(Exception):
    """Not understood: syntax, keyword, or argument."""


@dataclass(frozen=True)
class Command:
    """One understood line: upper case but for quoted words, which keep their quotes."""

    keyword: str
    words: tuple[str, ...] = ()
    value: str | None = None
    called: bool = field(default=False, compare=False)
    """Written with parentheses."""


# A record is read register by register: the same thousand lines after every run.
@lru_cache(maxsize=8192)
def parse(line: bytes) -> Command:
    """The command in a line without its terminator; `Invalid` when it has no such shape."""
    if len(line) > LINE_LENGTH_MAX:
        raise Invalid
    # A byte that is no ASCII is no keyword; it must not end the simulator.
    match = _KEYWORD.fullmatch(line.decode("ascii", errors="replace"))
    if match is None:
        raise Invalid
    keyword, rest = match.groups()
    if not rest.startswith("("):
        return Command(keyword.upper(), _words(rest))
    call = _CALL.fullmatch(rest)
    if call is None:
        raise Invalid
    arguments, value = call.groups()
    return Command(keyword.upper(), _words(arguments), value, called=True)


def _words(text: str) -> tuple[str, ...]:
    if not text:
        return ()
    if _WORDS.fullmatch(text) is None:
        raise Invalid
    return tuple(w if w.startswith('"') else w.upper() for w in _ONE_WORD.findall(text))


def number(word: str) -> float:
    """A finite decimal number."""
    if _A_NUMBER.fullmatch(word.upper()) is None or not math.isfinite(value := float(word)):
        raise Invalid
    return value


def whole(word: str, low: int, high: int) -> int:
    """A whole number in [low, high]; `12.0` is one."""
    value = number(word)
    if not (low <= value <= high and value.is_integer()):
        raise Invalid
    return int(value)


def move_words(
    words: tuple[str, ...], axis_names: frozenset[str], speed_words: frozenset[str]
) -> tuple[float, float | None]:
    """Position and speed of `X 5.0 XF20`, `X 5 XF 20`, `@0 5.0 F 20`, `X5 F20`, `D5 F20`, or without a speed."""
    axes, speeds = ("|".join(sorted(map(re.escape, names))) for names in (axis_names, speed_words))
    shape = rf"(?:{axes})\s*({_NUMBER})(?:\s+(?:{speeds})\s*({_NUMBER}))?"
    match = re.fullmatch(shape, " ".join(words), re.ASCII)
    if match is None:
        raise Invalid
    position, speed = match.groups()
    return number(position), None if speed is None else number(speed)


def none(words: tuple[str, ...]) -> None:
    """Nothing may follow."""
    exactly(0, words)


def exactly(count: int, words: tuple[str, ...]) -> tuple[str, ...]:
    """That many words."""
    if len(words) != count:
        raise Invalid
    return words


def choice(names: dict[str, int], word: str) -> int:
    """The code of a keyword."""
    if word not in names:
        raise Invalid
    return names[word]


def positive(word: str) -> float:
    """A number above zero that leaves a motion finite."""
    value = number(word)
    if not 1e-6 <= value <= 1e9:
        raise Invalid
    return value
