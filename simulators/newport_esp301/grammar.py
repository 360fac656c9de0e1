"""The wire: lines `xxAAnn;xxAAnn` ended by CR in, values ended by CR LF out."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass

from simulators.newport_esp301.errors import Refused

_COMMAND = re.compile(r"([0-9]{0,3})\s*([A-Za-z]{2})\s*([^?]*?)\s*(\??)")
_NUMBER = re.compile(r"[+-]?([0-9]{1,15}\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,2})?")


@dataclass(frozen=True)
class Command:
    """One command: axis number (None when left out), two letters in capitals, parameter, and whether it asks."""

    axis: int | None
    code: str
    parameter: str
    query: bool


class LineReader:
    """Cuts a stream of bytes into lines; LF is ignored, an overlong line comes out cut, to be refused."""

    def __init__(self, characters_max: int) -> None:
        self._characters_max = characters_max
        self._pending = ""

    def feed(self, data: bytes) -> Iterator[str]:
        """Every line completed by `data`."""
        *lines, rest = (self._pending + data.decode("latin-1").replace("\n", "")).split("\r")
        # One character more than allowed, which tells that the line is too long.
        self._pending = rest[: self._characters_max + 1]
        for line in lines:
            yield line[: self._characters_max + 1]


@functools.lru_cache(maxsize=1024)
def parse_line(line: str) -> tuple[Command | None, ...]:
    """The commands of a line; None where one cannot be read."""
    return tuple(_parse_command(part.strip()) for part in line.split(";") if part.strip())


def _parse_command(text: str) -> Command | None:
    match = _COMMAND.fullmatch(text)
    if match is None:
        return None
    axis, code, parameter, query = match.groups()
    return Command(int(axis) if axis else None, code.upper(), parameter, bool(query))


def read_number(parameter: str) -> float:
    """A parameter as a number; refuses with 38 when it is missing, 7 when it is none."""
    if not parameter:
        raise Refused(38)
    if _NUMBER.fullmatch(parameter) is None:
        raise Refused(7)
    return float(parameter)


def format_number(value: float, decimals: int) -> str:
    """Fixed decimals, no negative zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"
