"""TOML that people write, parsed within bounds: a document made to be slow or deep is refused like a misspelt one."""

from __future__ import annotations

import re
import tomllib
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
    pending: list[tuple[Any, int]] = [(document, 0)]
    while pending:
        value, depth = pending.pop()
        if depth > TOML_DEPTH:
            raise TomlFlaw(f"nested deeper than {TOML_DEPTH}; write it flatter")
        if isinstance(value, dict):
            pending += [(each, depth + 1) for each in value.values()]
        elif isinstance(value, list):
            pending += [(each, depth + 1) for each in value]
