"""How an LK-G writes a measured value: 8 characters, sign and point among them."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from rigctl.core.arrays import FloatArray

NO_VALUE = "XXXXXXXX"
OVER_RANGE = "+FFFFFFF"
UNDER_RANGE = "-FFFFFFF"


def format_value(value_mm: float, decimals: int) -> str:
    """NaN is no valid value, infinite is out of range; fewer decimals where the integer part needs the place."""
    if math.isnan(value_mm):
        return NO_VALUE
    for places in range(decimals if math.isfinite(value_mm) else 0, 0, -1):
        text = f"{value_mm:+08.{places}f}"
        if len(text) == 8:
            # The display has no negative zero.
            return text if text.strip("-0.") else text.replace("-", "+")
    return OVER_RANGE if value_mm > 0 else UNDER_RANGE


def format_values(values_mm: Iterable[float], decimals: int) -> str:
    """Comma-separated values."""
    return ",".join([format_value(value, decimals) for value in values_mm])


def shown_mm(values_mm: Iterable[float], decimals: int) -> FloatArray:
    """The numbers a reader of the text gets, NaN where it shows none."""
    texts = [format_value(value, decimals) for value in values_mm]
    return np.array([float(text) if text[1:2].isdigit() else np.nan for text in texts])
