"""Scales of an axis: where a value stands, and which values have a tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.report.chart.text import power_of_ten, signed

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_LARGE, _SMALL = 5, -4
"""Powers of ten from which, and up to which, ticks leave their common factor to the axis."""
_ADDED = 10.0 / 9.0
"""Of symmetric-logarithmic axes: the linear part is as long as one decade beside it."""
_OUTWARDS = 1e-9
"""A tick on the frame is a tick, whatever rounding makes of its place."""


@dataclass(frozen=True)
class Ticks:
    """Places with their labels, and the factor that all labels share; `minor` places have none."""

    places: Sequence[float]
    labels: Sequence[str]
    factor: str = ""
    minor: Sequence[float] = ()


@dataclass
class Scale:
    """An axis, "linear", "log" or "symlog": limits as far as they are set, ticks as far as they are chosen."""

    kind: str = "linear"
    linear_up_to: float = 1.0
    low: float | None = None
    high: float | None = None
    inverted: bool = False
    margin: float = 0.05
    integer: bool = False
    plain: bool = False
    chosen: Ticks | None = None
    format: Callable[[float], str] | None = None
    data: list[FloatArray] = field(default_factory=list)

    def values_of(self, values: FloatArray) -> FloatArray:
        """Values as lengths along the axis, in no unit; not a number where a logarithm has none."""
        if self.kind == "linear":
            return values
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.kind == "log":
                return np.where(values > 0.0, np.log10(np.where(values > 0.0, values, 1.0)), np.nan)
            size = np.abs(values) / self.linear_up_to
            beyond = _ADDED + np.log10(np.maximum(size, 1.0))
            return np.asarray(np.sign(values) * np.where(size <= 1.0, size * _ADDED, beyond))

    def limits(self, others: Sequence[Scale] = ()) -> tuple[float, float]:
        """What the axis shows: what was set, else the data of this and of the axes that share it, and some room."""
        scales = [self, *others]
        low = next((each.low for each in scales if each.low is not None), None)
        high = next((each.high for each in scales if each.high is not None), None)
        data = np.concatenate([np.zeros(0), *(np.ravel(part) for each in scales for part in each.data)])
        data = data[np.isfinite(data) & ((data > 0.0) if self.kind == "log" else True)]
        first, last = (float(data.min()), float(data.max())) if data.size else (1.0, 10.0)
        if self.kind == "log":
            room = (last / first) ** self.margin if last > first else 2.0
            return low or first / room, high or last * room
        room = self.margin * (last - first) or 0.05 * abs(first) or 0.5
        return first - room if low is None else low, last + room if high is None else high

    def ticks(self, low: float, high: float, most: int) -> Ticks:
        """Between two limits, at most so many; those that were chosen as far as they are within."""
        low, high = min(low, high), max(low, high)
        if self.chosen is not None:
            return _within(self.chosen, low, high)
        if self.kind == "log":
            return _decades(low, high, most, plain=self.plain)
        if self.kind == "symlog":
            return self._symmetric(low, high)
        return self._linear(low, high, most)

    def _linear(self, low: float, high: float, most: int) -> Ticks:
        step = _step(high - low, max(most, 1), whole=self.integer)
        places = step * np.arange(math.ceil(low / step - _OUTWARDS), math.floor(high / step + _OUTWARDS) + 1)
        if self.integer and not len(places):
            places = np.array([round(0.5 * (low + high))])
        if self.format is not None:
            return Ticks(places.tolist(), [self.format(place) for place in places])
        largest = float(np.abs(places).max(initial=0.0))
        power = math.floor(math.log10(largest)) if largest else 0
        power = 0 if _SMALL < power < _LARGE else power
        decimals = max(0, power - math.floor(math.log10(step) + _OUTWARDS) + (step_digits(step) - 1))
        labels = [signed(f"{place / 10.0**power + 0.0:.{decimals}f}") for place in places]
        return Ticks(places.tolist(), labels, f"×{power_of_ten(power)}" if power else "")

    def _symmetric(self, low: float, high: float) -> Ticks:
        first = math.ceil(math.log10(self.linear_up_to) - _OUTWARDS)
        places = [10.0**k for k in range(first, math.floor(math.log10(max(high, -low, 1.0))) + 1)]
        both = sorted({0.0, *places, *(-place for place in places)})
        shown = [place for place in both if low <= place <= high]
        return Ticks(shown, [signed(f"{place:g}") for place in shown])


def step_digits(step: float) -> int:
    """How many significant digits a step of ticks has: 2.5 has two."""
    leading = step / 10.0 ** math.floor(math.log10(step) + _OUTWARDS)
    return 1 if abs(leading - round(leading)) < 1e-6 else 2


def _step(span: float, most: int, *, whole: bool) -> float:
    rough = span / most or 1.0
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(each * power for each in _STEPS if each * power >= rough * (1.0 - _OUTWARDS))
    if not whole:
        return step
    whole_steps = (each for each in (step, 2.0 * step, 5.0 * step) if each >= 1.0 and each == round(each))
    return max(1.0, next(whole_steps, math.ceil(step)))


def _decades(low: float, high: float, most: int, *, plain: bool) -> Ticks:
    first, last = math.ceil(math.log10(low) - _OUTWARDS), math.floor(math.log10(high) + _OUTWARDS)
    decades = [10.0**k for k in range(first, last + 1)]
    between = [
        round(d, 12) * 10.0**k for k in range(first - 1, last + 1) for d in range(2, 10) if low <= d * 10.0**k <= high
    ]
    if len(decades) >= 2 and not plain:
        apart = max(1, math.ceil(len(decades) / max(most, 1)))
        shown = decades[::apart]
        labels = [power_of_ten(round(math.log10(place))) for place in shown]
        return Ticks(shown, labels, minor=between if apart == 1 else [])
    # Few decades: their halves and fifths too, then whatever there is.
    for leading in ((1, 2, 5), (1, 2, 3, 4, 5, 6, 8)):
        shown = [d * 10.0**k for k in range(first - 1, last + 1) for d in leading if low <= d * 10.0**k <= high]
        if len(shown) >= 2:
            apart = max(1, math.ceil(len(shown) / max(most, 1)))
            shown = shown[::apart]
            return Ticks(shown, [signed(f"{place:.3g}") for place in shown], minor=between)
    step = Scale()._linear(low, high, most)
    return Ticks([place for place in step.places if place > 0.0], step.labels, step.factor)


def _within(ticks: Ticks, low: float, high: float) -> Ticks:
    room = _OUTWARDS * (high - low)
    pairs = [
        (place, label)
        for place, label in zip(ticks.places, ticks.labels, strict=True)
        if low - room <= place <= high + room
    ]
    return Ticks([place for place, _ in pairs], [label for _, label in pairs])
