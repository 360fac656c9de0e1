"""How a SCPI program message is read: units, headers and parameters (SCPI-1999 vol. 1, IEEE 488.2 ch. 7)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

ERROR_TEXTS = {
    0: "No error",
    -102: "Syntax error",
    -103: "Invalid separator",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -114: "Header suffix out of range",
    -131: "Invalid suffix",
    -148: "Character data not allowed",
    -151: "Invalid string data",
    -211: "Trigger ignored",
    -213: "Init ignored",
    -214: "Trigger deadlock",
    -221: "Settings conflict",
    -222: "Data out of range",
    -224: "Illegal parameter value",
    -230: "Data corrupt or stale",
    -350: "Queue overflow",
    -410: "Query INTERRUPTED",
    -420: "Query UNTERMINATED",
}
"""SCPI-1999 vol. 2 ch. 21."""


class ScpiError(Exception):
    """What an instrument puts into its error queue; `detail` is what a maker adds to the standard's text."""

    def __init__(self, code: int, detail: str = "") -> None:
        self.code = code
        self.text = f"{ERROR_TEXTS[code]}; {detail}" if detail else ERROR_TEXTS[code]
        super().__init__(f"{code},{self.text}")

    @property
    def is_command_error(self) -> bool:
        """True for what the parser finds; the rest of the message is then not understood either."""
        return -200 < self.code <= -100


@dataclass(frozen=True)
class Unit:
    """One command or query of a message; the header is upper case and ends with ? when it is a query."""

    header: str
    parameters: tuple[str, ...]


_UNIT = re.compile(
    r"(?P<header>(?::?[A-Z][A-Z0-9_]*(?::[A-Z][A-Z0-9_]*)*|\*[A-Z]+)\??)(?P<rest>.*)",
    re.IGNORECASE | re.DOTALL | re.ASCII,
)
_PATTERN_TOKEN = re.compile(r"(?P<short>[A-Z]+)(?P<rest>[a-z]*)|<n>|[][{}?*]")
_PATTERN_SIGNS = {"[": "(?:", "]": ")?", "{": "(?:", "}": ")", "?": r"\?", "*": r"\*", "<n>": r"(\d*)"}
# IEEE 488.2: all control characters; LF has ended the message before.
_WHITE = "".join(map(chr, range(33)))
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?)\s*([A-Z]*)", re.IGNORECASE | re.ASCII)
_WORD = re.compile(r"[A-Z][A-Z0-9_]*", re.IGNORECASE | re.ASCII)
_DIVISORS = {"": 1.0, "K": 1e-3, "MA": 1e-6, "G": 1e-9, "M": 1e3, "U": 1e6, "N": 1e9, "P": 1e12}
"""Divisors, because 20 us is 20 / 1e6 to the last bit and 20 * 1e-6 is not."""


def split_message(message: str) -> list[str]:
    """The units of a message, still as text; -151 when a string is not closed."""
    return [part for part in (p.strip(_WHITE) for p in _split(message, ";")) if part]


def parse(unit: str) -> Unit:
    """One unit's header and parameters; `ScpiError` when it is none."""
    match = _UNIT.fullmatch(unit.strip(_WHITE))
    if match is None:
        raise ScpiError(-102)
    header, rest = match["header"].upper(), match["rest"]
    if not rest:
        return Unit(header, ())
    if rest[0] not in _WHITE:
        raise ScpiError(-103)
    parameters = tuple(p.strip(_WHITE) for p in _split(rest, ","))
    if not all(parameters):
        raise ScpiError(-109)
    return Unit(header, parameters)


def header_regex(pattern: str) -> re.Pattern[str]:
    """What a manual's `[SENSe:]VOLTage[:DC]:RANGe?` accepts: short or long mnemonics, optional nodes.

    `{A|B}` stands for alternatives and `<n>` for a numeric suffix, which becomes a group.
    """
    return re.compile(_PATTERN_TOKEN.sub(_as_regex, pattern))


def _as_regex(token: re.Match[str]) -> str:
    short, rest = token["short"], token["rest"]
    if short is None:
        return _PATTERN_SIGNS[token[0]]
    return f"{short}(?:{rest.upper()})?" if rest else short


def _split(text: str, separator: str) -> list[str]:
    parts, start, quote = [], 0, ""
    for i, character in enumerate(text):
        if quote:
            # A doubled quote ends the string and begins it again, which for splitting is the same.
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character == separator:
            parts.append(text[start:i])
            start = i + 1
    if quote:
        raise ScpiError(-151)
    return [*parts, text[start:]]


Limit = float | Callable[[], float]
"""A fixed limit, or one that depends on the state."""


@dataclass(frozen=True)
class Number:
    """A numeric parameter with its limits; takes MIN, MAX, DEF and a unit."""

    minimum: Limit
    maximum: Limit
    default: Limit
    unit: str = ""

    def parse(self, text: str) -> float:
        """The value; -222 outside the limits."""
        value = self.read(text)
        if not _now(self.minimum) <= value <= _now(self.maximum):
            raise ScpiError(-222)
        return value

    def clip(self, text: str) -> tuple[float, str]:
        """The value within the limits, and which of them it was put to: "upper", "lower" or neither."""
        value = self.read(text)
        if value > _now(self.maximum):
            return _now(self.maximum), "upper"
        return (_now(self.minimum), "lower") if value < _now(self.minimum) else (value, "")

    def read(self, text: str) -> float:
        """The number as it was sent."""
        return self.limit(text) if _WORD.fullmatch(text) else _quantity(text, self.unit)

    def limit(self, text: str) -> float:
        """What MIN, MAX or DEF stand for now; -148 for another word."""
        for word, value in (("MINimum", self.minimum), ("MAXimum", self.maximum), ("DEFault", self.default)):
            if header_regex(word).fullmatch(text.upper()):
                return _now(value)
        raise ScpiError(-148)

    def format(self, value: float) -> str:
        """NR3 with nine digits, as the maker's instruments send it."""
        return f"{value:+.8E}"


@dataclass(frozen=True)
class Integer(Number):
    """A whole number; fractions are rounded."""

    infinity: bool = False

    def parse(self, text: str) -> float:
        """The value; infinite for INF where that is allowed."""
        if self.infinity and header_regex("INFinity").fullmatch(text.upper()):
            return math.inf
        return float(round(super().parse(text)))

    def format(self, value: float) -> str:
        """NR1 with its sign; 9.9E37 for infinity."""
        return f"{int(value):+d}" if math.isfinite(value) else "+9.90000000E+37"


@dataclass(frozen=True)
class Choice:
    """One word of several, written as in a manual: `("IMMediate", "TIMer")`; the value is the short form."""

    words: tuple[str, ...]

    def parse(self, text: str) -> str:
        """The short form; -224 for another word, -104 for what is no word."""
        if not _WORD.fullmatch(text):
            raise ScpiError(-104)
        for word in self.words:
            if header_regex(word).fullmatch(text.upper()):
                return _short(word)
        raise ScpiError(-224)

    def format(self, value: str) -> str:
        """The short form."""
        return value


@dataclass(frozen=True)
class Boolean:
    """ON, OFF or a number, of which only zero is off."""

    def parse(self, text: str) -> bool:
        """The state; -224 for another word."""
        if text.upper() in ("ON", "OFF"):
            return text.upper() == "ON"
        if _WORD.fullmatch(text):
            raise ScpiError(-224)
        # A number is rounded first (SCPI-99, 7.3).
        return abs(_quantity(text, "")) >= 0.5

    def format(self, value: bool) -> str:
        """1 or 0."""
        return str(int(value))


@dataclass(frozen=True)
class OnOffOnce:
    """ON, OFF, a number, of which only zero is off, or ONCE: the value is ON, OFF or ONCE."""

    def parse(self, text: str) -> str:
        """The word; -224 for another one."""
        if text.upper() == "ONCE":
            return "ONCE"
        return "ON" if Boolean().parse(text) else "OFF"

    def format(self, value: str) -> str:
        """The word."""
        return value


@dataclass(frozen=True)
class Text:
    """A quoted string; within it a doubled quote stands for one."""

    def parse(self, text: str) -> str:
        """What is between the quotes; -104 when there are none."""
        quote = text[0]
        if quote not in "'\"" or len(text) < 2 or text[-1] != quote:
            raise ScpiError(-104)
        return text[1:-1].replace(quote * 2, quote)

    def format(self, value: str) -> str:
        """The string in double quotes."""
        return '"' + value.replace('"', '""') + '"'


def _now(limit: Limit) -> float:
    return limit() if callable(limit) else limit


def _short(word: str) -> str:
    return re.sub("[a-z]", "", word)


def _quantity(text: str, unit: str) -> float:
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ScpiError(-104)
    suffix = match[2].upper()
    multiplier = suffix.removesuffix(unit) if unit else suffix
    # A multiplier alone is no unit: `3 M` is neither mega nor metres.
    if (suffix and not unit) or multiplier not in _DIVISORS or (multiplier and multiplier == suffix):
        raise ScpiError(-131)
    return float(match[1]) / _DIVISORS[multiplier]
