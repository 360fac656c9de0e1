"""What the runs of an experiment have: columns, their values, what may be absent."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rigctl.campaign.unit_checks import Columns, UnitFindings
from rigctl.core.experiments import experiment_named
from rigctl.core.messages import either
from rigctl.core.numbers import NotMeasurable, decimal_or_missing
from rigctl.core.plausible import ABSOLUTE_ZERO_C, ANGLE_MAX_DEG, HOTTEST_C

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
    """

    fields: Mapping[str, Field]
    samples_of: Callable[[Mapping[str, Any]], tuple[str, ...]] = lambda _: ("t_s",)
    flaw_of_run: Callable[[Mapping[str, Any]], str | None] = lambda _: None
    period_of: Callable[[Mapping[str, Any]], float] = lambda _: 0.0
    units_of: Callable[[Mapping[str, Any], Columns, Mapping[str, float]], UnitFindings] = lambda *_: UnitFindings()
    constants: tuple[str, ...] = ()
    handles_missing: bool = False
    patterns: bool = False


def number(text: str) -> float:
    """Any number."""
    try:
        return decimal_or_missing(text)
    except NotMeasurable:
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
