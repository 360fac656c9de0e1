"""TOML read and written. Reading is bounded: a document made to be slow or deep is refused like a misspelt one."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from datetime import date, datetime, time
from typing import Any

from rigctl.core.bounds import TOML_DEPTH, TOML_DOTS_SQUARED

_SYNTAX = re.compile(r"(.*) \(at (?:line (\d+), column \d+|end of document)\)")


class TomlFlaw(ValueError):
    """What is wrong with a document, and the mend; `line` is None where no line is to blame."""

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


def parsed(text: str) -> dict[str, Any]:
    """The document; `TomlFlaw` for what is not TOML, or nested as nobody nests."""
    _require_few_dots(text)
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = _SYNTAX.fullmatch(str(error))
        what = match[1] if match else str(error)
        # At the end of the document tomllib names no line.
        line = int(match[2]) if match and match[2] else text.count("\n") + 1
        raise TomlFlaw(f"not TOML ({what}); mend the line", line) from None
    except RecursionError:
        raise TomlFlaw(f"nested deeper than {TOML_DEPTH}; write it flatter") from None
    except ValueError:  # what Python says of a number of thousands of digits
        raise TomlFlaw("a number of more than 4000 digits; write fewer") from None
    _require_shallow(document)
    return document


def _require_few_dots(text: str) -> None:
    """A key of n parts takes tomllib n squared steps."""
    left = TOML_DOTS_SQUARED
    for number, line in enumerate(text.split("\n"), 1):
        dots = line.count(".")
        left -= dots * dots
        if left < 0:
            raise TomlFlaw(f"{dots} dots in one line; write long arrays on several lines, and keys shorter", number)


def _require_shallow(document: dict[str, Any]) -> None:
    # A list instead of recursion: depth is what has to be bounded here.
    pending: list[tuple[Any, int]] = [(document, 0)]
    while pending:
        value, depth = pending.pop()
        if depth > TOML_DEPTH:
            raise TomlFlaw(f"nested deeper than {TOML_DEPTH}; write it flatter")
        if isinstance(value, dict):
            pending += [(each, depth + 1) for each in value.values()]
        elif isinstance(value, list):
            pending += [(each, depth + 1) for each in value]


def to_toml(tables: Mapping[str, Any]) -> str:
    """TOML text of nested mappings; a value that is None is left out. Floats read back bit for bit."""
    return "".join(_table("", tables)).lstrip("\n")


def _table(path: str, table: Mapping[str, Any]) -> Iterator[str]:
    """The values of a table and, after them, the tables in it."""
    # Values first: written behind the header of a sub-table they would belong to that.
    for key, value in table.items():
        if not _has_header(value) and value is not None:
            yield f"{_key(key)} = {to_toml_value(value)}\n"
    for key, value in table.items():
        place = f"{path}{_key(key)}"
        if isinstance(value, Mapping):
            # A table that holds nothing but tables is said by their headers.
            if not value or not all(map(_has_header, value.values())):
                yield f"\n[{place}]\n"
            yield from _table(f"{place}.", value)
        elif _has_header(value):
            for each in value:
                yield f"\n[[{place}]]\n"
                yield from _table(f"{place}.", each)


def _has_header(value: object) -> bool:
    """Whether a value is written as tables of their own: a mapping, or an array of nothing but mappings."""
    if isinstance(value, list | tuple) and value:
        return all(isinstance(each, Mapping) for each in value)
    return isinstance(value, Mapping)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else to_toml_value(name)


def to_toml_value(value: object) -> str:
    """One value as it stands behind a key: a number, a text, a time, an array or an inline table."""
    match value:
        # Before int, of which it is one in Python.
        case bool():
            return str(value).lower()
        case float():
            # The shortest text that reads back as the same float; inf and nan are written the same in TOML.
            return repr(value)
        case str():
            # TOML's basic strings are those of JSON, but DEL must be escaped.
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case datetime():
            return value.isoformat().replace("+00:00", "Z")
        case int() | date() | time():
            return str(value)
        case Mapping():
            pairs = (f"{_key(key)} = {to_toml_value(each)}" for key, each in value.items() if each is not None)
            return f"{{ {', '.join(pairs)} }}"
        case list() | tuple():
            return f"[{', '.join(to_toml_value(each) for each in value if each is not None)}]"
    raise TypeError(f"{type(value).__name__} has no TOML")
