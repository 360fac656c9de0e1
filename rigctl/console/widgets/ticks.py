"""Scales of an axis, and ticks at round values with labels that tell them apart."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.report.picture import Scale

LONGEST = 8
"""Characters of a label."""

_STEPS = (1.0, 2.0, 5.0)
# Of the span: a tick that rounding puts beyond the end of the axis is on it.
_ON_AXIS = 1e-9


@dataclass(frozen=True)
class Tick:
    """A place on an axis, on its scale (of a logarithmic one the logarithm), and what is written there."""

    at: float
    label: str


def on_scale(scale: Scale, values: FloatArray) -> FloatArray:
    """Values as they stand on an axis; NaN for those that a logarithmic axis leaves out."""
    if scale == "linear":
        return values
    if scale == "symlog":
        return np.asarray(np.sign(values) * np.log10(1.0 + np.abs(values)))
    positive = values > 0.0
    return np.where(positive, np.log10(np.where(positive, values, 1.0)), np.nan)


def ticks_of(scale: Scale, low: float, high: float, most: int) -> list[Tick]:
    """Ticks between two places on an axis."""
    return {"linear": linear_ticks, "log": log_ticks, "symlog": symlog_ticks}[scale](low, high, most)


def linear_ticks(low: float, high: float, most: int) -> list[Tick]:
    """The finest round ticks from `low` to `high` that are at most so many, but no fewer than two where two fit."""
    if not high > low:
        return [Tick(low, _label(low, 0.0))]
    span = high - low
    exponent = math.floor(math.log10(span)) + 1
    chosen: list[Tick] = []
    # From coarse to fine.
    for power in range(exponent, exponent - 4, -1):
        for step in reversed(_STEPS):
            finer = list(_multiples(low, high, step * 10.0**power))
            if len(finer) > max(most, 2):
                return chosen
            chosen = finer
    return chosen


def log_ticks(low: float, high: float, most: int) -> list[Tick]:
    """Ticks of an axis of logarithms to base ten: every so many decades, and between them where there is room."""
    decades = range(math.ceil(low - _ON_AXIS), math.floor(high + _ON_AXIS) + 1)
    for factors in ((1, 2, 5), (1, 3)):
        inner = [
            Tick(at, _power(factor, decade))
            for decade in range(math.floor(low), decades.stop)
            for factor in factors
            if low - _ON_AXIS <= (at := decade + math.log10(factor)) <= high + _ON_AXIS
        ]
        if 2 <= len(inner) <= max(most, 2):
            return inner
    if len(decades) < 2:  # less than a decade: round values of the numbers themselves
        inside = [each.at for each in linear_ticks(10.0**low, 10.0**high, most) if each.at > 0.0]
        step = min((b - a for a, b in itertools.pairwise(inside)), default=0.0)
        return [Tick(math.log10(value), _label(value, step)) for value in inside]
    every = max(1, math.ceil(len(decades) / max(most, 2)))
    return [Tick(float(decade), _power(1, decade)) for decade in decades if decade % every == 0]


def symlog_ticks(low: float, high: float, most: int) -> list[Tick]:
    """Zero, and powers of ten to either side, with threes where there is room."""
    chosen = [Tick(0.0, "0")]
    for factors in ((3,), (1,), (1, 3)):
        values = [factor * 10**power for power in range(9) for factor in factors]
        at = on_scale("symlog", np.array([*values, *(-value for value in values)], dtype=np.float64))
        labels = [*map(str, values), *(f"-{value}" for value in values)]
        inside = [Tick(float(x), f"{label:.8}") for x, label in zip(at, labels, strict=True) if low <= x <= high]
        if 1 + len(inside) <= max(most, 3):
            chosen = [Tick(0.0, "0"), *inside]
    return [each for each in chosen if low <= each.at <= high]


def _multiples(low: float, high: float, step: float) -> Iterator[Tick]:
    margin = _ON_AXIS * (high - low)
    for count in range(math.ceil((low - margin) / step), math.floor((high + margin) / step) + 1):
        yield Tick(count * step, _label(count * step, step))


def _label(value: float, step: float) -> str:
    """With as many digits as neighbours need, as a power of ten where it is long; a single one with four."""
    if not step > 0.0:
        return f"{value:.4g}"
    if abs(value) < 0.5 * step:
        return "0"
    decimals = max(0, -math.floor(math.log10(step) + _ON_AXIS))
    plain = f"{value:.{decimals}f}"
    if len(plain) <= LONGEST - 1 and decimals <= 5:
        return plain
    digits = max(0, math.floor(math.log10(abs(value))) - math.floor(math.log10(step) + _ON_AXIS))
    mantissa, _, exponent = f"{value:.{digits}e}".partition("e")
    return f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}e{int(exponent)}"


def _power(factor: int, decade: int) -> str:
    if -4 < decade < 5:
        return f"{factor * 10.0**decade:g}"
    return f"{factor}e{decade}"
