"""Effects made from a column whose shape has a parameter that must be scanned: a period, a rate, a place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.units import power
from rigctl.experiments.table.model.form import PLAIN, Choice, Form, too_few
from rigctl.experiments.table.observe.readings import Column

# Neighbours on a grid lie so close that midway between them no more than 5 % of an effect's power is lost.
_PHASE_STEP_RAD = 0.14
_RATE_RATIO = 1.3
_SHORT_OF_NYQUIST = 0.25
# Of a period: beyond, a wave's harmonics fill the spectrum and stand for anything.
_HARMONIC, _MOST_HARMONICS = "harmonic", 6
_STEP_LOGIT = 0.05
# Fewer readings beyond a step are outliers.
_ROWS_BESIDE_A_STEP = 3
_SLOWEST_RATE, _FASTEST_RATE = 0.5, 1e3
_MODEST_EXPONENT = 30.0
_FAR_FROM_ZERO = 3.0


@dataclass(frozen=True)
class _OfColumn(Form):
    column: Column
    kind: ClassVar[str]
    scanned: ClassVar[str]
    first: ClassVar[bool]
    """Whether the scanned parameter is listed before the linear ones."""

    @property
    def id(self) -> str:
        """As in commands."""
        return f"{self.kind}[{self.column.name}]"

    @property
    def columns(self) -> tuple[Column, ...]:
        """Its only one."""
        return (self.column,)

    def scanned_unit(self) -> str:
        """Of the scanned parameter."""
        return self.column.unit

    def trivial(self) -> list[FloatArray]:
        """A constant and a line."""
        return [np.ones(self.column.values.size), self.column.values - self.column.mean]


@dataclass(frozen=True)
class Periodic(_OfColumn):
    """cos and sin of 2 pi h (C - origin) / period, for h = 1 and the harmonics that are chosen.

    The origin is 0 unless the column is far from it.
    """

    kind = "periodic"
    scanned = "period"
    first = True

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something repeats with {self.column.name}."

    def untestable(self) -> str:
        """Why not, or ""."""
        return too_few(self.column, 5) if self.column.distinct.size < 5 else ""

    def names(self, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Two quadratures of each harmonic."""
        numbers = ["" if h == 1 else str(h) for h in _harmonics(choice)]
        return tuple(f".{quadrature}{number}" for number in numbers for quadrature in ("cos", "sin"))

    def grid(self, points_max: int) -> FloatArray:
        """Periods from twice the spacing to twice the span, equally spaced in frequency (as Lomb and Scargle)."""
        column = self.column
        low = 0.5 / column.span
        # Short of the Nyquist frequency, at which evenly spaced values show one quadrature only.
        high = max(column.frequency_max - _SHORT_OF_NYQUIST / column.span, 2.0 * low)
        # Midway between neighbours the phase is off by so much, rms over the readings.
        step = 2.0 * _PHASE_STEP_RAD / (2.0 * np.pi * column.standard_deviation)
        points = min(int(np.ceil((high - low) / step)) + 1, points_max)
        return np.asarray(1.0 / (low + step * np.arange(points)[::-1]))

    def neighbourhood(self, period: float) -> tuple[float, float]:
        """Periods of frequencies no farther away than one more or less in the span, twice the span the longest."""
        span = self.column.span
        return 1.0 / (1.0 / period + 1.0 / span), 1.0 / max(1.0 / period - 1.0 / span, 0.5 / span)

    def full_choice(self, value: float) -> dict[str, float]:
        """Period and origin."""
        # Counted from far away (years since 0) the phase would turn with every digit of the period.
        middle = 0.5 * float(self.column.distinct[0] + self.column.distinct[-1])
        return {"period": value, "origin": middle if abs(middle) > _FAR_FROM_ZERO * self.column.span else 0.0}

    def basis(self, choice: Choice) -> FloatArray:
        """Shape (n, 2 harmonics)."""
        phase, harmonics = self._phase(choice), _harmonics(choice)
        columns = np.empty((phase.size, 2 * len(harmonics)))
        for place, harmonic in enumerate(harmonics):
            np.cos(harmonic * phase, out=columns[:, 2 * place])
            np.sin(harmonic * phase, out=columns[:, 2 * place + 1])
        return columns

    def scan(self, choices: Sequence[Choice]) -> FloatArray:
        """The bases of many choices of one origin, shape (n, choices, 2)."""
        frequencies = 1.0 / np.array([choice["period"] for choice in choices])
        phase = 2.0 * np.pi * np.outer(self.column.values - choices[0]["origin"], frequencies)
        return np.stack([np.cos(phase), np.sin(phase)], axis=2)

    def slope(self, choice: Choice, linear: FloatArray, basis: FloatArray) -> FloatArray:
        """By the period, with the basis at this choice."""
        number = np.array(_harmonics(choice), dtype=np.float64)
        turned = basis[:, 1::2] @ (number * linear[::2]) - basis[:, ::2] @ (number * linear[1::2])
        return np.asarray(turned * self._phase(choice) / choice["period"])

    def richer(self, choice: Choice) -> list[dict[str, float]]:
        """The same with each of the harmonics that it lacks."""
        lacks = [h for h in self._shown(choice["period"]) if h not in _harmonics(choice)]
        return [{**choice, f"{_HARMONIC}{h}": 1.0} for h in lacks]

    def resolved_from(self, periods: FloatArray, choice: Choice) -> BoolArray:
        """Which of many periods are others than that of a term with this choice and than its harmonics.

        Two that differ by less than an oscillation in the span are one whose amplitude changes: their sum is
        determined, and neither of them.
        """
        frequencies = np.array(self._shown(choice["period"])) / choice["period"]
        apart = np.abs(np.subtract.outer(1.0 / periods, frequencies)).min(axis=1)
        return np.asarray(apart >= 1.0 / self.column.span)

    def _shown(self, period: float) -> list[int]:
        """The fundamental and the harmonics of a period that these values show."""
        fastest = self.column.frequency_max - _SHORT_OF_NYQUIST / self.column.span
        return [1, *(h for h in range(2, _MOST_HARMONICS + 1) if h <= fastest * period)]

    def _phase(self, choice: Choice) -> FloatArray:
        return np.asarray(2.0 * np.pi * (self.column.values - choice["origin"]) / choice["period"])


def _harmonics(choice: Choice) -> list[int]:
    return [1, *sorted(int(name.removeprefix(_HARMONIC)) for name in choice if name.startswith(_HARMONIC))]


@dataclass(frozen=True)
class Exponential(_OfColumn):
    """p exp(rate (C - origin)); the origin is 0, or the end where it is largest where exp would overflow."""

    kind = "exponential"
    scanned = "rate"
    first = False

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something grows or dies out exponentially with {self.column.name}."

    def untestable(self) -> str:
        """Why not, or ""."""
        return too_few(self.column, 4) if self.column.distinct.size < 4 else ""

    def scanned_unit(self) -> str:
        """One over the column's."""
        return power(self.column.unit, -1)

    def grid(self, points_max: int) -> FloatArray:
        """Rates of both signs, equally spaced in their logarithm, from half an e-fold in the span to one a row."""
        span = self.column.span
        # In spans: e-folds from one value to the next, but never so fast that exp leaves its range.
        fastest = min(max(span / self.column.spacing, 20.0), _FASTEST_RATE)
        count = int(np.ceil(np.log(fastest / _SLOWEST_RATE) / np.log(_RATE_RATIO))) + 1
        rates = np.geomspace(_SLOWEST_RATE, fastest, min(count, max(points_max // 2, 2))) / span
        return np.concatenate([-rates[::-1], rates])

    def full_choice(self, value: float) -> dict[str, float]:
        """Rate and origin."""
        low, high = float(self.column.distinct[0]), float(self.column.distinct[-1])
        # exp(30) is 1e13: an amplitude counted from C = 0 would be a number that nobody can read.
        huge = abs(value) * max(abs(low), abs(high)) > _MODEST_EXPONENT
        return {"rate": value, "origin": (high if value > 0.0 else low) if huge else 0.0}

    def basis(self, choice: Choice) -> FloatArray:
        """Shape (n, 1)."""
        return np.asarray(np.exp(choice["rate"] * (self.column.values - choice["origin"])))[:, None]

    def scan(self, choices: Sequence[Choice]) -> FloatArray:
        """The bases of many choices, shape (n, choices, 1)."""
        return np.stack([self.basis(choice) for choice in choices], axis=1)

    def slope(self, choice: Choice, linear: FloatArray, basis: FloatArray) -> FloatArray:
        """By the rate, with the basis at this choice."""
        return np.asarray(linear[0] * (self.column.values - choice["origin"]) * basis[:, 0])


@dataclass(frozen=True)
class Step(_OfColumn):
    """p where C is past `at`, nothing before."""

    kind = "step"
    scanned = "at"
    first = False

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something changes abruptly at a value of {self.column.name}."

    def untestable(self) -> str:
        """Why not, or ""."""
        values, beside = self.column.values, _ROWS_BESIDE_A_STEP
        # Of sorted values the third must be smaller than the third from the end.
        if values.size < 2 * beside or not np.ptp(np.partition(values, [beside - 1, -beside])[[beside - 1, -beside]]):
            return f"{self.column.name} has nowhere {_ROWS_BESIDE_A_STEP} readings on either side of a step"
        return ""

    def grid(self, points_max: int) -> FloatArray:
        """Places between neighbouring values, fewer where neighbours hardly differ."""
        places = self._places()
        below = np.searchsorted(np.sort(self.column.values), places)
        # Two steps correlate by exp(-d / 2), with d the distance of their log odds of lying below.
        logit = np.log(below / (self.column.values.size - below))
        step = max(_STEP_LOGIT, (logit[-1] - logit[0]) / points_max if points_max > 1 else np.inf)
        kept, place = [], 0
        while place < len(places):
            kept.append(places[place])
            last, place = logit[place], max(int(np.searchsorted(logit, logit[place] + step)) - 1, place + 1)
            # Rounded in another way, the sum may be one place short.
            while place < len(places) and logit[place] - last < step:
                place += 1
        return np.array(kept)

    def full_choice(self, value: float) -> dict[str, float]:
        """The place."""
        return {"at": value}

    def basis(self, choice: Choice) -> FloatArray:
        """Shape (n, 1)."""
        return (self.column.values > choice["at"]).astype(np.float64)[:, None]

    def scan(self, choices: Sequence[Choice]) -> FloatArray:
        """The bases of many choices, shape (n, choices, 1)."""
        places = np.array([choice["at"] for choice in choices])
        return (self.column.values[:, None] > places).astype(np.float64)[:, :, None]

    def slope(self, choice: Choice, linear: FloatArray, basis: FloatArray) -> FloatArray:
        """None: it is held."""
        del choice, linear, basis
        return np.zeros(self.column.values.size)

    def places(self, low: float, high: float) -> FloatArray:
        """Every place of a step between two values."""
        places = self._places()
        return np.asarray(places[(places > low) & (places < high)])

    def _places(self) -> FloatArray:
        values = np.sort(self.column.values)
        below = np.arange(_ROWS_BESIDE_A_STEP, values.size - _ROWS_BESIDE_A_STEP + 1)
        # A step stands between two values, never among readings of the same one.
        below = below[values[below - 1] < values[below]] if below.size else below
        return np.asarray(0.5 * (values[below - 1] + values[below]))


Scanned = Periodic | Exponential | Step
"""The scanned forms; of a `Step` the place is held where it was found."""
