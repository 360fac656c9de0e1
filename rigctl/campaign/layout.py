"""What the runs of an experiment have: columns, their values and units, what may be absent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import either
from rigctl.core.experiments import experiment_named
from rigctl.core.numbers import NotMeasurable, decimal_or_missing
from rigctl.core.units import ABSOLUTE_ZERO_C, ANGLE_MAX_DEG, HOTTEST_C

Columns = Mapping[str, FloatArray]

# Prefixes that are mistaken for each other: milli, micro, nano, in both directions.
SLIPS = (1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9)
SLIP_WITHIN = 1.4
"""How far an amplitude may be from a thousand times another to be taken for the same one."""

_TIME_IN = {1e3: "ms", 1e6: "us", 1e9: "ns", 1e-3: "ks", 1e-6: "Ms", 1e-9: "Gs"}


@dataclass(frozen=True)
class UnitFindings:
    """`slip`: a column that is not in its unit, and the mend; `contradiction`: why the samples are not those that the
    row describes, for which the run is invalid; `remarks`: what differs otherwise."""

    slip: str | None = None
    remarks: tuple[str, ...] = ()
    contradiction: str | None = None


def slip_between(seen: float, asked: float) -> float | None:
    """The power of a thousand that lies between two quantities, None when there is none."""
    if not (seen > 0 and asked > 0):
        return None
    return next((slip for slip in SLIPS if 1 / SLIP_WITHIN < seen / asked / slip < SLIP_WITHIN), None)


def sample_step_s(t_s: FloatArray) -> float:
    """The median step of time; NaN for a single sample."""
    return float(np.median(np.diff(t_s))) if t_s.size > 1 else math.nan


def time_slip(seen: str, asked: str, slip: float) -> str:
    """What to say when the two differ by this power of a thousand."""
    return f"{seen}, {asked}: t_s looks like {_TIME_IN[slip]}; write it in seconds"


_COUNT_MAX = 10**9

FACES = ("x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True)
class Field:
    """One known column of runs.csv: `parse` raises `ValueError` saying what is expected."""

    parse: Callable[[str], Any]
    missing: float | str = math.nan
    required: bool = False


@dataclass(frozen=True)
class Layout:
    """The runs of one experiment, in a store and in a bundle.

    `samples` are the columns every run file has; `samples_of` those of one run with its conditions.
    `flaw_of_run` says why a row of runs.csv contradicts itself, None when it does not. `period_of` is the
    time [s] a run must at least last. `units_of` compares what was asked for with what the samples show.
    `handles_missing`: the analysis masks gaps and missing samples itself. `patterns`: custom ones in patterns.csv.
    `own_clocks`: the analysis takes channels that have clocks of their own.
    `constants` are those that a result needs, `other_constants` those that it takes into account.
    """

    fields: Mapping[str, Field]
    samples_of: Callable[[Mapping[str, Any]], tuple[str, ...]] = lambda _: ("t_s",)
    flaw_of_run: Callable[[Mapping[str, Any]], str | None] = lambda _: None
    period_of: Callable[[Mapping[str, Any]], float] = lambda _: 0.0
    units_of: Callable[[Mapping[str, Any], Columns, Mapping[str, float]], UnitFindings] = lambda *_: UnitFindings()
    constants: tuple[str, ...] = ()
    other_constants: tuple[str, ...] = ()
    handles_missing: bool = False
    patterns: bool = False
    own_clocks: bool = False

    def doubt_of_constants(self, names: Iterable[str]) -> Iterator[tuple[str, str]]:
        """Of names of constants those that no result reads, each with what is strange about it: a slip of the pen?"""
        read = (*self.constants, *self.other_constants)
        for name in names:
            if name not in read:
                yield name, f"is read by no result of this experiment; those read are {', '.join(read)}"


def number(text: str) -> float:
    """Any number."""
    try:
        return decimal_or_missing(text)
    except NotMeasurable:
        # Before ValueError, of which it is one: its own message says more.
        raise
    except ValueError:
        hint = ", with a decimal point" if "," in text else ""
        raise ValueError(f"a number{hint}") from None


def _number_that(holds: Callable[[float], bool], expected: str) -> Callable[[str], float]:
    """A parser of numbers for which something holds."""

    def parse(text: str) -> float:
        value = number(text)
        if not holds(value):
            raise ValueError(expected)
        return value

    return parse


not_negative = _number_that(lambda value: value >= 0, "a number that is not negative")
positive = _number_that(lambda value: value > 0, "a number above 0")
angle_deg = _number_that(lambda value: abs(value) <= ANGLE_MAX_DEG, f"an angle in degrees, at most {ANGLE_MAX_DEG:g}")
temperature_c = _number_that(
    lambda value: ABSOLUTE_ZERO_C <= value <= HOTTEST_C,
    f"a temperature in degrees Celsius, {ABSOLUTE_ZERO_C:g} to {HOTTEST_C:g}",
)


def whole_number(text: str) -> int:
    """An integer, perhaps written by a spreadsheet as 1.0."""
    value = number(text)
    if not value.is_integer() or abs(value) > _COUNT_MAX:
        raise ValueError("a whole number")
    return int(value)


def sign(text: str) -> int:
    """+1 or -1."""
    if text not in {"+1", "1", "-1", "1.0", "-1.0"}:
        raise ValueError("+1 or -1")
    return int(float(text))


def flag(text: str) -> bool:
    """1 or 0."""
    if text not in {"0", "1", "0.0", "1.0"}:
        raise ValueError("1 or 0")
    return float(text) == 1


def one_of(*choices: str) -> Callable[[str], str]:
    """A parser of one word out of `choices`."""

    def parse(text: str) -> str:
        if text not in choices:
            raise ValueError(either(choices))
        return text

    return parse


face = one_of(*FACES)
COMMON_FIELDS = {"temperature_c": Field(temperature_c), "start_s": Field(number), "valid": Field(flag)}
"""Columns that the runs of every experiment may have."""


def layout_of(experiment: str) -> Layout | None:
    """The columns of an experiment's runs; None where a recording is a table of readings."""
    declared = experiment_named(experiment)
    return declared.load(declared.columns) if declared.columns else None
