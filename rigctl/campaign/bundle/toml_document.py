"""A parsed TOML file that knows its lines, so that an error can name one; and TOML text from plain values."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date, datetime, time
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


def to_toml(tables: Mapping[str, Any]) -> str:
    """TOML text of nested mappings; a value that is None is left out."""
    return "".join(_table((), tables)).lstrip("\n")


def _table(path: tuple[str, ...], table: Mapping[str, Any]) -> list[str]:
    values = {k: v for k, v in table.items() if not isinstance(v, Mapping) and v is not None}
    lines = [f"\n[{'.'.join(map(_key, path))}]\n"] if path and (values or not table) else []
    lines += [f"{_key(name)} = {_value(value)}\n" for name, value in values.items()]
    for name, value in table.items():
        if isinstance(value, Mapping):
            lines += _table((*path, name), value)
    return lines


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _string(name)


def _string(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    if isinstance(value, int | date | time):
        return str(value)
    if isinstance(value, Mapping):
        pairs = (f"{_key(name)} = {_value(item)}" for name, item in value.items() if item is not None)
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(item) for item in value if item is not None)}]"
    raise TypeError(f"{type(value).__name__} has no TOML")
