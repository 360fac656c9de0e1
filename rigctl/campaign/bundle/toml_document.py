"""A parsed TOML file that knows its lines, so that an error can name one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rigctl.campaign.bundle.csv_table import decode
from rigctl.campaign.bundle.place import Place
from rigctl.core.errors import DataError
from rigctl.core.toml import TomlFlaw, parsed

_KEY = r"""(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|'[^']*')"""
_KEY_PATH = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_SECTION = re.compile(rf"\s*\[\[?\s*({_KEY_PATH})\s*\]")
_PAIR = re.compile(rf"\s*({_KEY_PATH})\s*=")


@dataclass(frozen=True)
class TomlDocument:
    """`data` as tomllib gives it; `error` finds the line of a key."""

    place: Place
    text: str
    data: Mapping[str, Any]

    def error(self, keys: tuple[str, ...], message: str) -> DataError:
        """A `DataError` about the value at `keys`; `message` says what is wrong and the mend."""
        return self.place.error(f"{'.'.join(keys)} {message}", self._line_of(keys))

    def _line_of(self, keys: tuple[str, ...]) -> int | None:
        best, depth = None, 0
        section: tuple[str, ...] = ()
        for number, line in enumerate(self.text.split("\n"), 1):
            if match := _SECTION.match(line):
                here = section = _names(match[1])
            elif match := _PAIR.match(line):
                here = (*section, *_names(match[1]))
            else:
                continue
            if len(here) > depth and keys[: len(here)] == here:
                best, depth = number, len(here)
        return best


def _names(path: str) -> tuple[str, ...]:
    return tuple(name.strip("\"'") for name in re.findall(_KEY, path))


def parse_toml(place: Place, data: bytes) -> TomlDocument:
    """Parse a TOML file; `DataError` with the line of what is not TOML, or is nested as nobody nests."""
    text = decode(place, data)
    try:
        return TomlDocument(place, text, parsed(text))
    except TomlFlaw as flaw:
        raise place.error(str(flaw), flaw.line) from flaw
