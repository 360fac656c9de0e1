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
    return ",".join(_texts(values_mm, decimals))


def shown_mm(values_mm: Iterable[float], decimals: int) -> FloatArray:
    """The numbers a reader of the text gets, NaN where it shows none."""
    return np.array([float(text) if text[1:2].isdigit() else np.nan for text in _texts(values_mm, decimals)])


def _texts(values_mm: Iterable[float], decimals: int) -> list[str]:
    values = np.array(list(values_mm), dtype=np.float64)
    if not (values.size and np.abs(values).max() < 10.0 ** (6 - decimals) - 1.0):
        return [format_value(value, decimals) for value in values.tolist()]
    # All that have their places at once, in a fifth of the time.
    texts = (f"%+08.{decimals}f," * values.size % tuple(values.tolist())).split(",")[:-1]
    for place in np.flatnonzero(np.signbit(values) & (values > -(10.0**-decimals))).tolist():
        texts[place] = format_value(float(values[place]), decimals)  # it may be a negative zero
    return texts
