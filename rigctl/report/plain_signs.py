"""What stands for ±, θ and the like on a terminal or in a file whose encoding has no such signs."""

from __future__ import annotations

import codecs
import io
import sys
import unicodedata
from collections.abc import Mapping

SIGNS: Mapping[str, str] = {
    "±": "+-",
    "−": "-",
    "θ": "theta",
    "σ": "sigma",
    "µ": "u",
    "μ": "u",
    "°": "deg",
    "″": '"',
    "′": "'",
    "√": "sqrt",
    "→": "->",
    "…": "...",
}
"""Any other sign gives way to the letter it is made from (ü to u, ² to 2), or else to a question mark."""

_NAME = "rigctl.plain-signs"


def on_standard_streams() -> None:
    """From now on nothing that is printed fails for its encoding: see `SIGNS`."""
    codecs.register_error(_NAME, _plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and codecs.lookup(stream.encoding).name != "utf-8":
            stream.reconfigure(errors=_NAME)


def _plain(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_sign, error.object[error.start : error.end])), error.end


def _sign(sign: str) -> str:
    letters = unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode()
    return SIGNS.get(sign) or letters or "?"
