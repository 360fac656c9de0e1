"""Numbers as files and command lines may write them: plain decimal notation in ASCII, and nothing else.

One grammar for every reader of text that a person or another program wrote: an optional sign, digits with at most one
point, an optional exponent. Python's `float` takes more (`1_0`, digits of other scripts, `infinity`), and a number
that only one of two programs understands is a wrong number sooner or later.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

CHARACTERS_MAX = 400
"""The longest number: more than any 64-bit float needs when it is written without an exponent."""

MAGNITUDE_MAX = 1e40
"""Larger than any value measured on a bench, and its sixth power, the square of a cube, is still a number."""


class NotMeasurable(ValueError):
    """A number in form, but none that can have been measured: infinite, or beyond `MAGNITUDE_MAX`."""


def decimal(text: str) -> float:
    """The number that `text` writes, finite and at most `MAGNITUDE_MAX`.

    `NotMeasurable` for an infinite or absurdly large one, `ValueError` for what is no decimal number; the message
    ends the sentence "write ...".
    """
    try:
        value = float(text)
    except ValueError:
        raise ValueError("a number") from None
    # float() allows spaces around, underscores between and digits of other scripts; infinities and NaN are words.
    if not text.isascii() or "_" in text or text[0].isspace() or text[-1].isspace() or len(text) > CHARACTERS_MAX:
        raise ValueError("a number in plain digits")
    if math.isnan(value):
        raise ValueError("a number")
    if not abs(value) <= MAGNITUDE_MAX:
        raise NotMeasurable(f"a number that can be measured, at most {MAGNITUDE_MAX:g}")
    return value


def decimal_or_missing(text: str) -> float:
    """The same, and NaN for an empty text or `nan` in capitals or not, with a sign or none."""
    if not text or is_missing(text):
        return math.nan
    return decimal(text)


def is_missing(text: str) -> bool:
    """Whether a field says that there is no value: empty, or `nan` (some programs write `-nan`)."""
    return not text or (len(text) <= 4 and text.lower().removeprefix("-").removeprefix("+") == "nan")


def measurable(values: NDArray[np.generic]) -> bool:
    """Whether every number of an array that is not NaN is finite and at most `MAGNITUDE_MAX`."""
    # NaN compares false, so missing values pass.
    return not bool((abs(values) > MAGNITUDE_MAX).any())
