"""Numbers as instruments send and take them: plain decimal notation in ASCII, not all that Python takes for one."""

from __future__ import annotations

import math
import re

CHARACTERS_MAX = 40
LARGEST_WHOLE = 2**53
"""Beyond, not every whole number is a double."""

_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)


def decimal(text: str) -> float:
    """A finite number, as in `+1.25`, `-.5`, `1E-3`; `ValueError` for all else, spaces, `inf` and `1_0` among it."""
    if len(text) > CHARACTERS_MAX or not _DECIMAL.fullmatch(text) or not math.isfinite(value := float(text)):
        raise ValueError(f"{text[:CHARACTERS_MAX]!r} is no number")
    return value


def whole(text: str) -> int:
    """A number without a fraction, as in `+215`, `7.000`; `ValueError` for all else."""
    value = decimal(text)
    if not value.is_integer() or abs(value) > LARGEST_WHOLE:
        raise ValueError(f"{text!r} is no whole number")
    return int(value)


def plain(value: float, places: int = 6) -> str:
    """A number without exponent or negative zero; the last place is far below any stage's resolution."""
    # -0.0 + 0.0 is 0.0: no minus sign before a zero.
    return f"{round(value, places) + 0.0:.{places}f}".rstrip("0").rstrip(".")
