"""The wire: `Name(argument,...)` in, `code,value,...,EndOfAPI` out.

A request has no terminator but its closing parenthesis, and may arrive in pieces.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from simulators.newport_xps.codes import Refused

REQUEST_BYTES_MAX = 65536
_REQUEST = re.compile(r"(\w+)\s*\((.*)\)", re.DOTALL)
_INTEGER = re.compile(r"[+-]?[0-9]{1,18}")
_BOOL = re.compile(r"[01]")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")

WRONG_TYPE = {"bool": -12, "char": -13, "double": -14, "int": -15}


@dataclass(frozen=True)
class Request:
    """A function and its arguments as they were written."""

    name: str
    arguments: tuple[str, ...]


class RequestReader:
    """Cuts a stream of bytes into the texts of requests."""

    def __init__(self) -> None:
        self._pending = ""

    def feed(self, data: bytes) -> Iterator[str]:
        """Every request completed by `data`; an endless one comes out unfinished, to be refused."""
        # Every byte is a character there: nonsense comes out as text, to be refused as such.
        self._pending += data.decode("latin-1")
        while ")" in self._pending or len(self._pending) > REQUEST_BYTES_MAX:
            text, parenthesis, self._pending = self._pending.partition(")")
            yield (text + parenthesis).strip()


@functools.lru_cache(maxsize=1024)
def parse_request(text: str) -> Request:
    """Take a request apart; refuses with -3 (too long) or -4 (not of the form of a call)."""
    if len(text) > REQUEST_BYTES_MAX:
        raise Refused(-3)
    match = _REQUEST.fullmatch(text)
    if match is None:
        raise Refused(-4)
    name, inside = match.groups()
    return Request(name, tuple(a.strip() for a in inside.split(",")) if inside.strip() else ())


def format_reply(code: int, values: Sequence[str] = ()) -> bytes:
    """The reply of a function that ended with `code`; without values the empty field stays."""
    return f"{code},{','.join(values)},EndOfAPI".encode("latin-1")


def format_number(value: float) -> str:
    """Plain decimal with up to twelve digits, no negative zero."""
    return f"{value + 0.0:.12g}"


@dataclass(frozen=True)
class Inputs:
    """The input arguments of a call in their order: numbers apart from words."""

    numbers: tuple[float, ...] = ()
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Signature:
    """What a function takes after the name of its object.

    `inputs` are "double", "int", "bool" or "word", `outputs` the C types of the placeholders. `per_axis`: both repeat
    for each axis of the group. `variadic`: the inputs may repeat any number of times, at least once.
    """

    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    per_axis: bool = False
    variadic: bool = False

    @functools.lru_cache(maxsize=1024)  # noqa: B019 - signatures live as long as the program
    def read(self, arguments: tuple[str, ...], axes: int = 1) -> Inputs:
        """Check count and types of the arguments; refuses with -9 or the code of the type."""
        repeats = self._repeats(arguments, axes)
        inputs = self.inputs * repeats
        outputs = self.outputs * (axes if self.per_axis else 1)
        if len(arguments) != len(inputs) + len(outputs):
            raise Refused(-9)
        for kind, placeholder in zip(outputs, arguments[len(inputs) :], strict=True):
            # `double *`, `double*` and blanks between are all sent by clients in use.
            if re.sub(r"\s", "", placeholder) != f"{kind}*":
                raise Refused(WRONG_TYPE[kind])
        pairs = list(zip(inputs, arguments, strict=False))
        return Inputs(
            numbers=tuple(read_number(kind, text) for kind, text in pairs if kind != "word"),
            words=tuple(text for kind, text in pairs if kind == "word"),
        )

    def _repeats(self, arguments: tuple[str, ...], axes: int) -> int:
        if self.variadic:
            return max(1, len(arguments) - len(self.outputs))
        return axes if self.per_axis else 1


def read_number(kind: str, text: str) -> float:
    """A number of the given C type; refuses with -14 (double), -15 (int) or -12 (bool, which is 0 or 1)."""
    pattern = {"int": _INTEGER, "bool": _BOOL}.get(kind, _NUMBER)
    if pattern.fullmatch(text) is None or not math.isfinite(float(text)):
        raise Refused(WRONG_TYPE[kind])
    return float(text)
